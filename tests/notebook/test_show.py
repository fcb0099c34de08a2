"""`run.show` and `stepper.show`: what a view in a cell holds, what is chosen in it, and that it needs nothing else."""

from __future__ import annotations

import json
import re
from base64 import b64decode
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import ispom

FRAMES = 36
ADDRESS = re.compile(r"\b(?:https?|wss?|ftp):|\bsrc\s*=|\bimport\s*\(|\burl\s*\(|[\"'(=]//", re.IGNORECASE)
"""How a page could ask for anything outside itself."""


@pytest.fixture(scope="module")
def run() -> ispom.Run:
    return ispom.run("sim:tiny", "stereo", frames=FRAMES, max_tracks=300)


def data_of(view: Any) -> dict[str, Any]:
    """What the page's script reads."""
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', view.html, re.DOTALL)
    assert found is not None
    return json.loads(found[1])


def image_of(frame: dict[str, Any]) -> Any:
    kind, _, content = frame["image"].partition(",")
    assert kind == "data:image/jpeg;base64"
    return cv2.imdecode(np.frombuffer(b64decode(content), np.uint8), cv2.IMREAD_COLOR)


def sent(view: Any, monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """What the view tells its page from now on."""
    found: list[Any] = []
    monkeypatch.setattr(view, "send", found.append)
    return found


def test_it_has_all_steps_with_image_tracks_and_checks(run: ispom.Run) -> None:
    pair = run.sequence.kinds.index("stereo", 1)
    view = run.show(frame=pair)
    data = data_of(view)
    assert (view.frame, view.tracks, data["start"], data["tracks"]) == (pair, [], pair, [])
    assert [frame["frame"] for frame in data["frames"]] == [
        i for i, kind in enumerate(run.sequence.kinds) if kind == "stereo"
    ]
    for frame, step in zip(data["frames"], run.steps, strict=True):
        tracks = step.tracks["left"]
        assert frame["ids"] == tracks.ids.tolist() and frame["status"] == tracks.status.tolist()
        height, width = image_of(frame).shape[:2]
        assert [width, height] == frame["size"] and frame["camera"] == "left"
        scale = width / run.rig.camera("left").width
        np.testing.assert_allclose(np.reshape(frame["xy"], (-1, 2)), (tracks.uv + 0.5) * scale, atol=0.051)
        assert len(frame["checks"]) == len(step.decisions) and frame["headline"]
    assert data["path"][0] == [frame["frame"] for frame in data["frames"]] and len(data["truth"][0]) > 3


def test_what_is_chosen_is_checked(run: ispom.Run) -> None:
    view = run.show()
    assert run.step_at(view.frame) is run.steps[-1]
    view.tracks = [3, 4]
    view.frame = run.sequence.kinds.index("stereo")
    assert data_of(view)["start"] == view.frame and data_of(view)["tracks"] == [3, 4]
    with pytest.raises(ispom.InputError, match="nearest"):
        view.frame = 1 + view.frame
    assert run.step_at(view.frame) is run.steps[0]


@pytest.mark.parametrize("frame", [-1, 2, 500, "3", 1.5, True])
def test_a_frame_without_a_step_is_refused_in_one_sentence(run: ispom.Run, frame: Any) -> None:
    with pytest.raises(ispom.InputError) as refused:
        run.show(frame=frame)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("max_mb", [0, -1, "2", True, float("nan")])
def test_a_size_that_is_none_is_refused(run: ispom.Run, max_mb: Any) -> None:
    with pytest.raises(ispom.InputError, match="max_mb"):
        run.show(max_mb=max_mb)


def test_it_takes_no_more_than_was_allowed_and_keeps_the_frame(run: ispom.Run) -> None:
    first = run.sequence.kinds.index("stereo")
    whole = data_of(run.show(first))["frames"]
    half = run.show(first, max_mb=0.5 * len(json.dumps(whole)) * 1e-6)
    kept = [frame["frame"] for frame in data_of(half)["frames"]]
    assert first in kept and 1 < len(kept) <= len(whole) / 2 and len(np.unique(np.diff(kept))) <= 1
    assert data_of(half)["note"] and data_of(half)["path"] == data_of(run.show(first))["path"]
    alone = run.show(first, max_mb=1e-6)
    assert [frame["frame"] for frame in data_of(alone)["frames"]] == [first]


def test_the_page_asks_for_nothing_outside_itself(run: ispom.Run) -> None:
    view = run.show()
    assert ADDRESS.findall(view.html) == [] and "default-src 'none'" in view.html
    assert ADDRESS.findall(view._esm) == []
    assert view._repr_html_().count("<iframe") == 1 and len(view._repr_html_()) < 1.5 * len(view.html)


def test_the_text_of_a_recording_is_no_markup(run: ispom.Run) -> None:
    bad = "</script><script>alert(1)</script><!--"
    steps = tuple(replace(s, decisions=(ispom.Decision(bad, 1, 0, False, key="bad"),)) for s in run.steps)
    view = replace(run, source=bad, steps=steps, truth=None).show()
    assert bad not in view.html and data_of(view)["source"] == bad
    assert view.html.count("</script>") == 2 and "<script" not in view._repr_html_()


def test_a_stored_run_shows_its_recording_and_says_that_it_knows_no_tracks(run: ispom.Run, tmp_path: Path) -> None:
    stored = ispom.read_run(run.save(tmp_path / "saved"))
    mine, found = data_of(run.show()), data_of(stored.show(frame=stored.steps[-1].frame))
    assert found["unknown"] and not mine["unknown"]
    for ours, theirs in zip(mine["frames"], found["frames"], strict=True):
        alike = ("frame", "camera", "size", "status", "severity", "headline", "checks")
        assert [ours[name] for name in alike] == [theirs[name] for name in alike]
        np.testing.assert_allclose(ours["xy"], theirs["xy"], atol=0.11)
        assert theirs["ids"] is None and image_of(theirs).shape == image_of(ours).shape
    np.testing.assert_allclose(found["path"], mine["path"], atol=1e-3)
    (stored.folder / "run.rrd").unlink()
    assert {frame["image"] for frame in data_of(stored.show())["frames"]} == {""}


def test_a_run_in_any_cameras_shows_one_of_them() -> None:
    found = ispom.run("sim:tiny", "integrated", frames=12)
    frames = data_of(found.show())["frames"]
    assert {frame["camera"] for frame in frames} >= {"video"} and all(frame["ids"] for frame in frames)


def test_a_stepper_brings_each_step_into_its_view(run: ispom.Run, monkeypatch: pytest.MonkeyPatch) -> None:
    walk = ispom.stepper(run.sequence, "stereo", max_tracks=300)
    view = walk.show()
    assert view.frame is None and data_of(view)["frames"] == []
    messages = sent(view, monkeypatch)
    steps = [next(walk) for _ in range(3)]
    at = [message["added"]["frame"]["frame"] for message in messages]
    assert view.frame == at[-1] and [run.step_at(frame).time_ns for frame in at] == [step.time_ns for step in steps]
    assert data_of(view)["frames"] == data_of(run.show())["frames"][:3]
    walk.back()
    assert messages[-1]["dropped"] == at[-1:] and view.frame == at[-2]
    assert data_of(view)["path"][0] == at[:2]
    walk.back(2)
    assert view.frame is None and data_of(view)["frames"] == []


def test_a_view_of_steps_drops_the_oldest(run: ispom.Run, monkeypatch: pytest.MonkeyPatch) -> None:
    two = 2.5e-6 * max(len(json.dumps(frame)) for frame in data_of(run.show())["frames"])
    walk = ispom.stepper(run.sequence, "stereo", max_tracks=300)
    view = walk.show(max_mb=two)
    messages = sent(view, monkeypatch)
    count = len(list(walk))
    data = data_of(view)
    assert len(data["frames"]) == 2 < count == len(data["path"][0])
    assert sum(len(message["dropped"]) for message in messages) == count - 2


def test_a_page_that_began_late_gets_what_it_missed(run: ispom.Run, monkeypatch: pytest.MonkeyPatch) -> None:
    view = run.show()
    numbers = [frame["frame"] for frame in data_of(view)["frames"]]
    messages = sent(view, monkeypatch)
    view._handle_custom_msg({"known": numbers[1:]}, [])
    assert [message["added"]["frame"]["frame"] for message in messages] == numbers[:1]
    for wrong in ({"known": 3}, {"other": []}, [], None):
        view._handle_custom_msg(wrong, [])
    assert len(messages) == 1


def test_a_cell_gets_the_page_and_the_link(run: ispom.Run, monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[Any] = []
    monkeypatch.setattr("IPython.display.display", lambda bundle, **_: shown.append(bundle))
    view = run.show()
    view._ipython_display_()
    page, link = shown
    assert page["text/html"] == view._repr_html_() and 20 < len(page["text/plain"]) < 200
    assert "application/vnd.jupyter.widget-view+json" in link and view.page == ""
