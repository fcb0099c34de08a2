"""The study of the scale itself, on made steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from ispom.geometry import Pose
from ispom.types import Status, Step, Trajectory

from .honest_scale import LEAST_STEPS, print_scales, scales

COUNT = 8 * LEAST_STEPS + 1


def run(units: np.ndarray, *, sigma: float = 0.01, begin: tuple[int, ...] = ()) -> tuple[list[Step], Trajectory]:
    """Steps of such lengths along a line, where the true ones are 1, each with the stated standard deviation."""
    places = np.concatenate([[0.0], np.cumsum(units)])
    steps = [
        Step(
            i,
            Status.TRACKING,
            "video",
            Pose(translation=np.array([x, 0.0, 0.0])),
            scale_sigma=sigma,
            restarted=i in begin,
        )
        for i, x in enumerate(places)
    ]
    truth = [(i, Pose(translation=np.array([0.0, float(i), 0.0]))) for i in range(len(places))]
    return steps, Trajectory.of(truth, "video")


def changed(factor: float) -> np.ndarray:
    """The last quarter of the steps has another unit."""
    return 5.0 * np.where(np.arange(COUNT - 1) < 0.75 * (COUNT - 1), 1.0, factor)


def test_one_unit_is_honest_whatever_it_is() -> None:
    (found,) = scales(*run(changed(1.0)))
    assert found.honest and found.parts == 8 and found.factor == pytest.approx(1.0)


@pytest.mark.parametrize("factor", [0.03, 0.7, 1.5])
def test_a_unit_that_changes_within_a_segment_is_not(factor: float) -> None:
    (found,) = scales(*run(changed(factor)))
    assert (
        not found.honest and found.factor == pytest.approx(max(factor, 1 / factor)) and found.at >= 0.75 * (COUNT - 1)
    )


def test_it_is_honest_where_a_segment_begins() -> None:
    found = scales(*run(changed(0.03), begin=(round(0.75 * (COUNT - 1)),)))
    assert len(found) == 2 and all(scale.honest for scale in found)


def test_a_part_that_joins_a_segment_is_judged_with_it() -> None:
    begin = round(0.75 * (COUNT - 1))
    for factor in (1.0, 0.5):
        steps, truth = run(changed(factor), begin=(begin,))
        steps[begin] = replace(steps[begin], joins=0)
        (found,) = scales(steps, truth)
        assert found.honest == (factor == 1.0)


def test_a_stated_uncertainty_excuses_no_more_than_the_promised_factor() -> None:
    (small,), (large,) = scales(*run(changed(1.15), sigma=0.1)), scales(*run(changed(1.5), sigma=0.5))
    assert small.honest and large.sigmas < 3 and not large.honest
    assert not scales(*run(changed(1.15), sigma=0.001))[0].honest


def test_frames_without_a_pose_and_ways_that_return_are_no_evidence() -> None:
    steps, truth = run(changed(0.03))
    assert scales([Step(s.time_ns, Status.LOST, "video") for s in steps], truth) == []
    turned = Trajectory.of([(i, Pose(translation=np.array([i % 2, 0.0, 0.0]))) for i in range(COUNT)], "video")
    (found,) = scales(steps, turned)
    assert found.parts == 0 and found.honest


def test_the_table_names_each_recording() -> None:
    (found,) = scales(*run(changed(0.5)))
    console = Console(record=True, width=200)
    row = {"recording": "made", "frames": COUNT, "located": COUNT, "honest": found.honest}
    print_scales(console, [{**row, **{k: getattr(found, k) for k in ("parts", "factor", "sigmas", "at")}}])
    assert "made" in console.export_text()
