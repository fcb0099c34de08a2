"""A run's folder, opened for review: everything that the run said is there again, to the last bit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from ispom_app.engine.history.record import ExposureRecord
from ispom_app.engine.history.series import Series
from ispom_app.engine.playback import Playback
from ispom_app.session.review.folder import read_stored

from ispom.errors import InputError
from tests.app.helpers import build_full, open_source, ran
from tests.sequences.kitti_folder import make_drive


@pytest.fixture
def run(tmp_path: Path) -> Path:
    drive = str(make_drive(tmp_path / "kitti", 14))
    return ran(drive, tmp_path / "run", "--stereo-every", "2", "--no-recording", builder=build_full)


def live(folder: Path) -> tuple[Playback, list[ExposureRecord], Series]:
    """What the run was while it went on."""
    playback = read_stored(folder, open_source, build_full).playback
    records, series = [], Series(playback.methods)
    while not playback.done:
        records.append(ExposureRecord.of(playback.step(), records[-1] if records else None))
        series.append(records[-1])
    return playback, records, series


def test_every_quantity_is_what_the_live_run_had(run: Path) -> None:
    playback, records, expected = live(run)
    stored, found = list(read_stored(run, open_source, build_full).records()), Series(playback.methods)
    for record in stored:
        found.append(record)
    assert len(stored) == len(records) == 21
    for name in expected.quantities:
        if not name.endswith(".seconds"):
            np.testing.assert_array_equal(found.values(name), expected.values(name), name)
    for method in playback.methods:
        assert [found.stepped([method], i) for i in range(21)] == [expected.stepped([method], i) for i in range(21)]


def test_decisions_poses_placements_and_statuses_are_those_of_the_live_run(run: Path) -> None:
    _, records, _ = live(run)
    for read, record in zip(read_stored(run, open_source, build_full).records(), records, strict=True):
        assert (read.time_ns, read.kind, read.statuses, read.errors_m) == (
            record.time_ns,
            record.kind,
            record.statuses,
            record.errors_m,
        )
        assert [s.decisions for s in read.steps] == [s.decisions for s in record.steps]
        for mine, step in zip(read.steps, record.steps, strict=True):
            assert (mine.method, mine.status, mine.frame, mine.key_frame) == (
                step.method,
                step.status,
                step.frame,
                step.key_frame,
            )
            assert (mine.world_from_frame is None) == (step.world_from_frame is None)
            if mine.world_from_frame is not None and step.world_from_frame is not None:
                np.testing.assert_allclose(mine.world_from_frame.matrix, step.world_from_frame.matrix, atol=1e-15)
        for name, placement in record.placements.items():
            assert read.placements[name].scale == placement.scale
            np.testing.assert_allclose(read.placements[name].pose.matrix, placement.pose.matrix, atol=1e-15)


def test_without_its_source_the_run_is_reviewed_from_its_files_alone(run: Path, tmp_path: Path) -> None:
    _, records, _ = live(run)
    (tmp_path / "kitti").rename(tmp_path / "elsewhere")
    found = read_stored(run, open_source, build_full)
    assert "is not there" in found.unavailable and "computed anew" in found.unavailable
    read = list(found.records())
    assert [(r.index, r.time_ns, r.kind) for r in read] == [(r.index, r.time_ns, r.kind) for r in records]
    assert found.playback.truth is not None and len(found.playback.truth)
    with pytest.raises(InputError, match="computed anew"):
        found.playback.step()


def test_another_source_in_its_place_is_noticed(run: Path, tmp_path: Path) -> None:
    times = tmp_path / "kitti" / "sequences" / "07" / "times.txt"
    times.write_text("".join(f"{i / 9:e}\n" for i in range(14)))
    assert "other times" in read_stored(run, open_source, build_full).unavailable


def test_final_trajectories_are_those_that_the_run_gave(run: Path) -> None:
    playback, _, _ = live(run)
    final, finished = read_stored(run, open_source, build_full).final, playback.finish()
    for method, trajectory in finished.trajectories.items():
        assert final[method].frame == trajectory.frame
        np.testing.assert_array_equal(final[method].times_ns, trajectory.times_ns)
        np.testing.assert_allclose(final[method].translations, trajectory.translations, atol=3e-9)


@pytest.mark.parametrize(
    ("name", "before", "after", "said"),
    [
        ("steps.csv", ",tracking,", ",dancing,", "status is 'dancing'"),
        ("steps.csv", "\n0,", "\n999999999,", "not as `ispom run` writes it"),
        ("run.yaml", "\n  scale: ", "\n  scale: -", "placement"),
    ],
)
def test_a_damaged_folder_is_refused_in_one_sentence(run: Path, name: str, before: str, after: str, said: str) -> None:
    content = (run / name).read_text()
    (run / name).write_text(content.replace(before, after, 1))
    with pytest.raises(InputError, match=said) as caught:
        list(read_stored(run, open_source, build_full).records())
    assert "\n" not in str(caught.value)
