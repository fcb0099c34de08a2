"""Poses before an integration's first fit: they are marked, and no live error is stated of them."""

from __future__ import annotations

import csv
import shutil
from pathlib import Path

import pytest
from ispom_app.engine.history.record import ExposureRecord
from ispom_app.engine.playback import Playback
from ispom_app.engine.run_folder.step_reader import stored_steps
from ispom_app.session.review.folder import read_stored

from ispom.sequences import open_sequence
from ispom.types import Sequence
from tests.app.helpers import build_full, open_source
from tests.app.review.test_folder import run  # noqa: F401  (a fixture)


@pytest.fixture(scope="module")
def tiny() -> Sequence:
    return open_sequence("sim:tiny").truncated(30)


@pytest.mark.parametrize("method", ["integrated", "integrated.paper"])
def test_before_the_first_fit_a_pose_is_provisional_and_has_no_live_error(tiny: Sequence, method: str) -> None:
    playback = Playback(tiny, (method,))
    events = [playback.step() for _ in range(30)]
    steps = [event.steps[0] for event in events]
    fitted = next(i for i, step in enumerate(steps) if step.key_frame)
    before = [i for i, step in enumerate(steps) if step.world_from_frame is not None and i < fitted]
    assert before and all(steps[i].provisional and not events[i].errors_m for i in before)
    after = [i for i, step in enumerate(steps) if step.world_from_frame is not None and i >= fitted]
    assert after and not any(steps[i].provisional for i in after)
    assert all(events[i].errors_m[method] < (0.01 if method == "integrated" else 0.1) for i in after)
    record = ExposureRecord.of(events[before[0]], None)
    assert record.statuses[method].provisional and record.values_by_method[method]["provisional"] is True


def test_a_run_of_an_earlier_version_is_read_without_the_mark(run: Path, tmp_path: Path) -> None:  # noqa: F811
    old = shutil.copytree(run, tmp_path / "old")
    with (run / "steps.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    with (old / "steps.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, [name for name in rows[0] if name != "provisional"], extrasaction="ignore")
        writer.writeheader()
        writer.writerows(rows)
    with stored_steps(old) as steps:
        assert {step.values["provisional"] for step in steps} == {None}
    before, now = (list(read_stored(folder, open_source, build_full).records()) for folder in (old, run))
    assert len(before) == len(now)
