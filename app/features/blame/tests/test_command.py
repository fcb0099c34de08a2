"""`ispom blame`: of a run's folder, beside what a rerun without the tracks gives."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from ispom_app.cli.main import main
from ispom_app.engine.inspection.selection import MOST, Selection, parsed
from ispom_app.engine.playback import Playback
from ispom_app.features.blame.found import PoseBlame, pose_blames
from ispom_app.features.blame.view import method_blame

from ispom.errors import InputError
from ispom.methods import Config
from ispom.sequences import open_sequence

AT = 12
"""The second stereo frame, and the second keyframe of `stereo`."""
LATER = 32
"""A frame at which `monocular` has a map."""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("blame") / "run"
    arguments = ["run", "sim:tiny", "--methods", "stereo", "--max-exposures", "24", "--no-recording"]
    assert main([*arguments, "--out", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def playback() -> Playback:
    """Before the frame."""
    found = Playback(open_sequence("sim:tiny"), ("stereo",), Config())
    while found.position < AT:
        found.step()
    return found


@pytest.fixture(scope="module")
def found(playback: Playback) -> PoseBlame:
    (blamed,) = pose_blames(playback, ("stereo",), {})
    return blamed


def test_the_answer_comes_first_and_the_file_has_every_part(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    out = tmp_path / "out"
    assert main(["blame", str(run), "--at", str(AT), "--check", "--out", str(out)]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert "this pose by" in printed[0]
    with (out / "blame.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {"track", "group", "prior"} <= {row["kind"] for row in rows}
    moved = [float(row["moved_m"]) for row in rows]
    assert moved == sorted(moved, reverse=True)


def test_what_cannot_be_answered_is_one_sentence(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for arguments in (["--at", "13"], ["--at", "99"], ["--at", "-1"], ["--at", "12", "--method", "monocular"]):
        assert main(["blame", str(run), *arguments]) == 2
        assert capsys.readouterr().err.count("\n") == 1


def test_asking_changes_nothing_of_the_step(playback: Playback, found: PoseBlame) -> None:
    again = playback.reported_problems()["stereo"][0]
    step = next(s for s in playback.ensemble.step(playback.snapshot.states, playback.sequence[AT])[1])
    for reported in (found.step, again):
        assert reported.world_from_frame is not None and step.world_from_frame is not None
        np.testing.assert_array_equal(reported.world_from_frame.matrix, step.world_from_frame.matrix)


def test_a_rerun_without_the_tracks_of_a_group_agrees(playback: Playback, found: PoseBlame) -> None:
    for each in found.found.of("group")[:3]:
        step = playback.without_tracks("stereo", np.array(each.part.tracks))
        assert step is not None and (again := found.between(step)) is not None
        assert np.linalg.norm(each.shift.position - again.position) < 0.2 * again.size


def test_a_rerun_of_one_camera_without_the_tracks_of_a_group_agrees() -> None:
    one = Playback(open_sequence("sim:tiny"), ("monocular",), Config())
    while one.position < LATER:
        one.step()
    (found,) = pose_blames(one, ("monocular",), {})
    group = found.found.of("group")[0]
    ids = np.array(group.part.tracks)
    step = one.without_tracks("monocular", ids)
    assert step is not None and not np.isin(step.tracks["video"].ids, ids).any()
    again = found.between(step)
    assert again is not None and np.linalg.norm(group.shift.position - again.position) < 0.2 * again.size


def test_a_frame_without_a_pose_is_refused() -> None:
    begun = Playback(open_sequence("sim:tiny"), ("stereo",), Config())
    with pytest.raises(InputError):
        pose_blames(begun, ("stereo",), {})


def test_a_click_on_a_row_selects_its_tracks(found: PoseBlame) -> None:
    group = found.found.of("group")[0]
    written = str(Selection.of_tracks("stereo", group.part.tracks))
    assert written in [row.select for row in method_blame(found).rows]
    selection = parsed(written)
    assert selection is not None and selection.tracks == group.part.tracks


def test_several_tracks_are_written_as_one_selection() -> None:
    assert parsed("tracks:stereo:5,7") == Selection("tracks", "stereo", 5, (7,))
    assert str(Selection.of_tracks("stereo", (5,))) == "track:stereo:5"
    assert len(Selection.of_tracks("stereo", tuple(range(2 * MOST))).tracks) == MOST
    for text in ("track:stereo:5,7", "tracks:stereo:", "tracks:stereo:5,", "key_frame:stereo:1,2"):
        with pytest.raises(InputError):
            parsed(text)
