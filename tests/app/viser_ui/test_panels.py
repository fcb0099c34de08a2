"""The panels, on viser without a browser: what they show of a state, and what they ask of the session."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import viser
from ispom_app.engine.history.record import ExposureRecord
from ispom_app.engine.options import SourceOptions
from ispom_app.features.explain.panel import ExplainPanel, report
from ispom_app.features.layers.commands import Hide
from ispom_app.features.layers.panel import ViewPanel, legend
from ispom_app.features.methods.panel import MethodsPanel
from ispom_app.features.playback.panel import BACK, FORWARD, PAUSE, PLAY, RunPanel
from ispom_app.features.recording.commands import Record
from ispom_app.features.recording.panel import RecordPanel
from ispom_app.features.sources.panel import MARK, UP, SourcePanel
from ispom_app.session import commands as do
from ispom_app.session.sources.folders import Folders
from ispom_app.session.state import Kept, Recording, State

from ispom.methods import Config
from ispom.types import Decision, Status, Step

HOSTILE = '<iframe srcdoc="<script>parent.hit = 1</script>"></iframe>'
STATE = State("double:20", phase="ready", name="double", run=1, total=20, methods=("stereo",))


@pytest.fixture(scope="module")
def gui(server: viser.ViserServer) -> viser.GuiApi:
    return server.gui


@pytest.fixture
def session(tmp_path: Path) -> Any:
    asked: list[do.Command] = []
    return SimpleNamespace(
        state=STATE, opened=None, run=None, post=asked.append, asked=asked, folders=Folders(tmp_path)
    )


def record(index: int, *decisions: Decision) -> ExposureRecord:
    step = Step(0, Status.TRACKING, decisions=decisions, seconds={"track": 0.004}, method="stereo")
    return ExposureRecord(index, 0, "stereo", (step,), {}, {}, {})


def by_hand(handle: Any, value: Any) -> None:
    """As a message of a browser."""
    handle._impl.value = value
    for callback in handle._impl.update_cb:
        callback(SimpleNamespace(client_id=1))


def press(handle: Any) -> None:
    for callback in handle._impl.update_cb:
        callback(SimpleNamespace())


def test_the_slider_shows_the_exposure_and_asks_only_where_a_hand_moved_it(gui, session):
    panel = RunPanel(gui, session)
    panel.show(replace(STATE, displayed=record(7)))
    assert panel._slider.value == 7 and panel._slider.max == 19 and not session.asked
    by_hand(panel._slider, 3)
    assert session.asked == [do.Seek(3)]


def test_an_exposure_can_be_asked_for_that_the_program_had_shown_before(gui, session):
    panel = RunPanel(gui, session)
    panel.show(replace(STATE, displayed=record(7)))
    by_hand(panel._slider, 3)
    panel.show(replace(STATE, displayed=record(3)))
    by_hand(panel._slider, 7)
    assert session.asked == [do.Seek(3), do.Seek(7)]


def test_a_live_source_that_grows_does_not_move_the_slider(gui, session):
    panel = RunPanel(gui, session)
    panel.show(replace(STATE, displayed=record(7)))
    panel.show(replace(STATE, displayed=record(7), total=40))
    assert panel._slider.value == 7 and panel._slider.max == 39 and not session.asked


def test_a_shorter_source_takes_the_slider_back(gui, session):
    panel = RunPanel(gui, session)
    panel.show(replace(STATE, displayed=record(15)))
    panel.show(replace(STATE, total=5, run=2))
    assert panel._slider.value == 0 and panel._slider.max == 4 and not session.asked


def test_a_move_asked_for_while_a_source_is_opened_is_answered_and_not_kept(gui, session):
    """It was kept until then, without a word: Step opened the source paused."""
    panel, told = RunPanel(gui, session), list[str]()
    client = SimpleNamespace(add_notification=lambda title, body, **_: told.append(f"{title}: {body}"))
    by_client = SimpleNamespace(client=client, client_id=1)
    movers = [panel._buttons, panel._slider, *panel._moves.values()]
    asking = [callback for mover in movers for callback in mover._impl.update_cb]
    asking += [callback for command in panel._commands for callback in command._impl.trigger_cb]
    for phase in ("opening", "ready"):
        session.state = replace(STATE, phase=phase)
        for callback in asking:
            callback(by_client)
        assert len(asking) > 15 and len(told) == len(asking)
        assert len(session.asked) == (0 if phase == "opening" else len(asking))
    assert set(told) == {"Not open yet: The source is still being opened: moves work once it is."}


def test_the_play_button_says_what_it_will_do(gui, session):
    panel = RunPanel(gui, session)
    panel.show(STATE)
    assert panel._buttons.options == (BACK, PLAY, FORWARD)
    panel.show(replace(STATE, playing=True))
    assert panel._buttons.options == (BACK, PAUSE, FORWARD)
    panel._buttons.value = PAUSE
    assert session.asked[-1] == do.Play(False)


@pytest.mark.parametrize("changes", [{"phase": "opening", "total": 0, "source": HOSTILE}, {"notes": (HOSTILE,)}])
def test_names_and_notes_of_a_source_are_never_markup(gui, session, changes):
    panel = RunPanel(gui, session)
    panel.show(replace(STATE, **changes))
    assert "&lt;iframe" in panel._text.content and "<iframe" not in panel._text.content


def test_names_that_are_not_utf_8_are_told_by_their_escapes(gui, session):
    """viser has no message for them: all panels would be missing."""
    cafe = os.fsdecode(b"caf\xe9")
    run, recordings = RunPanel(gui, session), RecordPanel(gui, session)
    run.show(replace(STATE, notes=(f"{cafe} is not the source that the run had",)))
    recordings.show(replace(STATE, unfinished=(f".part-{cafe}.rrd",)))
    assert all("caf\\udce9" in panel._text.content for panel in (run, recordings))


def test_names_of_recordings_are_never_markup(gui, session):
    panel = RecordPanel(gui, session)
    panel.show(replace(STATE, recordings=(Kept(f"{HOSTILE}.rrd", 1_200_000, HOSTILE, HOSTILE, HOSTILE, note=HOSTILE),)))
    assert "<iframe" not in panel._text.content and "1.2 MB" in panel._text.content
    panel.show(replace(STATE, recording=Recording(HOSTILE, 0, 0)))
    assert "<iframe" not in panel._text.content and panel._name.disabled
    press(panel._button)
    assert session.asked == [Record("")]


def test_decisions_are_never_markup_and_a_trigger_is_no_failure():
    triggers = [Decision(n, 0.1, 0.5, False, question="New keyframe?", kind="trigger") for n in (HOSTILE, "turn")]
    text = report(replace(STATE, displayed=record(0, *triggers)))
    assert "No: 0 of 2 triggers" in text and "✕" not in text and "<iframe" not in text


@pytest.mark.parametrize("has_stereo", [True, False])
def test_moves_by_stereo_exposures_are_offered_where_there_are_some(gui, session, has_stereo: bool):
    panel = RunPanel(gui, session)
    session.opened = SimpleNamespace(sequence=SimpleNamespace(rig=SimpleNamespace(has_stereo=has_stereo)))
    panel.show(STATE)
    assert panel._moves["stereo"].visible is has_stereo and panel._moves["key frame"].visible


def test_a_method_whose_settings_are_not_the_defaults_says_so_on_its_folder(gui, session):
    session.state = replace(STATE, config=Config({"stereo": replace(Config().of("stereo"), max_tracks=123)}))
    panel = MethodsPanel(gui, session)
    assert panel._folders["stereo"].label == "Stereo settings · 1 not default"
    assert panel._folders["monocular"].label == "Monocular settings"
    panel._defaults(None)
    assert panel._folders["stereo"].label == "Stereo settings"


def test_explain_names_the_settings_that_are_not_the_defaults():
    shown = replace(STATE, displayed=record(0), methods=("stereo",), config=Config())
    assert "Settings other than the defaults" not in report(shown)
    settings = replace(Config().of("stereo"), max_tracks=123)
    text = report(replace(shown, config=Config({"stereo": settings})))
    assert "other than the defaults" in text and "123" in text and "stereo.max-tracks" in text


def test_explain_begins_with_the_verdict_of_the_frame_as_it_is_counted_everywhere(gui, session):
    panel = ExplainPanel(gui, session)
    panel.show(STATE)
    assert "No frame is processed yet" in panel._verdicts.content
    panel.show(replace(STATE, displayed=record(7, Decision("inliers", 8, 12, False, consequence="no pose"))))
    text = panel._verdicts.content
    assert text.index("Frame 7") < text.index('class="headline') < text.index("needed: at least 12 · 4 too low")
    assert "✕" in panel._details["checks.html"].content and "no pose" in text


def test_hiding_a_layer_asks_for_it(gui, session):
    panel = ViewPanel(gui, session)
    panel.show(STATE)
    assert panel._boxes["monocular"].disabled and not panel._boxes["stereo"].disabled
    panel._boxes["clouds"].value = False
    assert session.asked == [Hide(frozenset({"clouds"}))]
    assert "Stereo" in legend() and "truth" in legend()


def test_a_source_is_found_in_folders_and_opened_with_its_options(gui, session, tmp_path: Path):
    (tmp_path / "films").mkdir()
    for name in ("roof.mp4", "street.mp4"):
        (tmp_path / "films" / name).write_bytes(b"")
    panel = SourcePanel(gui, session)
    panel.show(replace(STATE, recent=("sim:city",)))
    assert panel._recent.options == ("choose …", "sim:city") and UP not in panel._browse.options
    panel._browse.value = "films"
    assert UP in panel._browse.options
    panel._browse.value = f"{MARK}roof.mp4"
    panel._options._inputs["stereo_every"].value = 5
    panel._options._inputs["max_exposures"].value = 100
    panel._open(None)
    (asked,) = session.asked
    assert asked.source == str((tmp_path / "films" / "roof.mp4").resolve())
    assert (asked.options.stereo_every, asked.options.max_exposures, asked.options.camera) == (5, 100, None)
    panel._recent.value = "sim:city"
    assert panel._source.value == "sim:city"


def test_options_of_the_source_that_is_shown_are_not_those_of_another(gui, session):
    """A calibration or a stereo rate went on to the next source, out of sight."""
    panel = SourcePanel(gui, session)
    own = SourceOptions(stereo_every=3, camera=Path("mine.yaml"))
    panel.show(replace(session.state, run=7, source_options=own))
    assert panel._options.value == own
    by_hand(panel._options._inputs["max_exposures"], 40)
    by_hand(panel._source, "double:1")
    by_hand(panel._source, "double:15")
    panel._open(None)
    assert session.asked == [do.Open("double:15", SourceOptions(max_exposures=40))]
    by_hand(panel._options._inputs["stereo_every"], 3)  # chosen for this one
    by_hand(panel._source, "double:16")
    panel._open(None)
    assert session.asked[-1] == do.Open("double:16", SourceOptions(max_exposures=40, stereo_every=3))


def test_a_folder_that_a_page_cannot_name_is_told_by_its_escapes(gui, session, tmp_path: Path):
    home = tmp_path / os.fsdecode(b"caf\xe9")
    home.mkdir()
    session.folders = Folders(home)
    assert SourcePanel(gui, session)._browse.value == "in caf\\udce9: choose …"


def test_before_the_first_exposure_explain_says_what_to_do_or_to_wait(gui, session):
    panel = ExplainPanel(gui, session)
    panel.show(STATE)
    assert "Press Play, or step forward" in panel._verdicts.content
    panel.show(replace(STATE, playing=True))
    assert "Waiting for the first frame" in panel._verdicts.content
