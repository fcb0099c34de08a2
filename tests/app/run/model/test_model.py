"""The run model: a version never changes, the past is as it was known then, no frame costs more than others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from ispom_app.engine.model.points import HALVED_EVERY, NEW_PER_STEP, PointMap
from ispom_app.engine.model.poses import POSES_PER_BLOCK, Times
from ispom_app.engine.model.run_model import RunModel
from numpy.testing import assert_array_equal

from ispom.geometry import Pose
from ispom.types import Landmarks, Status, Step, Trajectory


def place(time_ns: int, version: int) -> Pose:
    return Pose(translation=np.array([float(time_ns), float(version), 0.0]))


def step(index: int, revised: Sequence[int] = (), key_frame: bool = False) -> Step:
    """At the time `index`; each pose tells the frame that gave it."""
    again = Trajectory.of([(t, place(t, index)) for t in revised])
    found = Landmarks(np.array([index]), np.array([[float(index), 0, 0]]), np.zeros((1, 3), np.uint8))
    return Step(
        method="m",
        time_ns=index,
        status=Status.TRACKING,
        world_from_frame=place(index, index),
        revised=again,
        key_frame=key_frame,
        landmarks=found,
    )


def flight(count: int, closures: dict[int, range] | None = None) -> list[Step]:
    """Each step revises the five before it, every tenth is a keyframe; `closures` revise more."""
    window = [range(max(0, i - 5), i) for i in range(count)]
    return [step(i, (closures or {}).get(i, window[i]), i % 10 == 0) for i in range(count)]


def models(steps: list[Step]) -> list[RunModel]:
    found = [RunModel.start(["m"])]
    for i, said in enumerate(steps):
        found.append(found[-1].after(i, said.time_ns, (said,)))
    return found[1:]


def versions(model: RunModel) -> list[float]:
    """Of every time with a pose: which frame gave it."""
    blocks = model.methods["m"].poses.blocks
    return [v for block in blocks for v in block.positions[block.known, 1].tolist()]


def test_a_version_never_changes() -> None:
    steps = flight(250)
    kept = models(steps)
    for i in (0, 4, 99, 100, 180):
        assert versions(kept[i]) == [min(t + 5, i) for t in range(i + 1)]


@pytest.mark.parametrize("closures", [{}, {700: range(700)}, {400: range(0, 120), 700: range(50, 300)}])
def test_the_past_is_as_it_was_known_then(closures: dict[int, range]) -> None:
    steps = flight(800, closures)
    kept = models(steps)
    for k in (0, 7, 99, 104, 350, 401, 500, 699, 701, 799):
        past = kept[-1].as_known_at(k, lambda i: (steps[i],))
        assert versions(past) == versions(kept[k])
        assert past.times.count == kept[k].times.count == k + 1
        assert_array_equal(past.methods["m"].points.landmarks().ids, np.arange(k + 1))
        keys = [past.methods["m"].poses.key_frame_rows(b) for b in range(len(past.methods["m"].poses.blocks))]
        assert np.concatenate(keys).tolist() == list(range(0, k + 1, 10))


def test_the_past_needs_the_steps_about_it_only() -> None:
    steps, read = flight(3000, {2900: range(0, 150)}), list[int]()
    last = models(steps)[-1]
    for k in (1999, 2000, 2050):
        read.clear()
        last.as_known_at(k, lambda i: (read.append(i), (steps[i],))[1])
        assert 0 < len(read) <= POSES_PER_BLOCK + 5 and min(read) >= k - POSES_PER_BLOCK


def test_an_exposure_changes_a_bounded_part_however_long_the_run() -> None:
    kept = models(flight(3000))
    for before, after in pairwise(kept):
        changed = after.methods["m"].poses.changed_blocks(before.methods["m"].poses)
        points = after.methods["m"].points.changed_blocks(before.methods["m"].points)
        assert len(changed) <= 2 and len(points) <= 1


def test_two_runs_from_one_value_do_not_mix() -> None:
    """A fork: both go on from the same version."""
    steps = flight(130)
    base = models(steps)[-1]
    one, other = base.after(130, 130, (step(130),)), base.after(130, 131, (step(131),))
    assert one.times.times_ns(slice(-1, None)).tolist() == [130]
    assert other.times.times_ns(slice(-1, None)).tolist() == [131]
    assert [len(m.methods["m"].points.landmarks()) for m in (base, one, other)] == [130, 131, 131]
    assert other.methods["m"].points.landmarks().ids[-1] == 131


def test_times_of_both_kinds_of_exposure_count_once() -> None:
    times = Times.none()
    for index, time_ns in enumerate((10, 10, 20, 30, 30)):
        times = times.with_exposure(index, time_ns)
    assert times.count == 3 and times.indices(slice(None)).tolist() == [0, 2, 3]
    assert times.rows(np.array([10, 30])).tolist() == [0, 2] and times.rows_until(2) == 2


def test_lines_join_their_blocks() -> None:
    poses = models(flight(2 * POSES_PER_BLOCK + 50))[-1].methods["m"].poses
    assert poses.lines(1)[-1][:, 0].tolist() == list(range(POSES_PER_BLOCK - 1, 2 * POSES_PER_BLOCK))
    assert poses.last_known() == 2 * POSES_PER_BLOCK + 49


def test_no_line_leads_to_a_segment_of_its_own() -> None:
    model = RunModel.start(["m"])
    for i in range(POSES_PER_BLOCK + 20):
        model = model.after(i, i, (replace(step(i), restarted=i in (40, POSES_PER_BLOCK)),))
    poses = model.methods["m"].poses
    assert [line[[0, -1], 0].tolist() for line in poses.lines(0)] == [[0, 39], [40, POSES_PER_BLOCK - 1]]
    assert [line[0, 0] for line in poses.lines(1)] == [POSES_PER_BLOCK - 1, POSES_PER_BLOCK]


def test_without_poses_for_a_while_a_line_joins_what_was_before() -> None:
    model = RunModel.start(["m"])
    for i in range(3 * POSES_PER_BLOCK):
        steps = (step(i),) if i < 10 or i >= 250 else ()
        model = model.after(i, i, steps)
    poses = model.methods["m"].poses
    assert poses.drawn_blocks() == {0, 2} and poses.lines(2)[-1][0, 0] == 9
    found = poses.second_before(model.times, 10**9 + 240)
    assert found is not None and found[0] == 9


def test_final_trajectories_replace_what_was_known() -> None:
    last = models(flight(150))[-1]
    final = last.with_final({"m": Trajectory.of([(t, place(t, 999)) for t in range(150)])})
    assert versions(final) == [999.0] * 150
    assert final.methods["m"].poses.changed_blocks(last.methods["m"].poses) == {0, 1}


def landmarks(ids: range, x: float = 1.0) -> Landmarks:
    return Landmarks(np.array(ids), np.full((len(ids), 3), x), np.zeros((len(ids), 3), np.uint8))


def test_points_are_replaced_by_id_and_nowhere_is_no_place() -> None:
    first = PointMap().with_points(landmarks(range(3)), 0)
    second = first.with_points(landmarks(range(1, 2), 5.0), 1).with_points(landmarks(range(9, 11), np.nan), 2)
    assert second.landmarks().xyz_in_world[:, 0].tolist() == [1, 5, 1] and second.count == 3
    assert first.landmarks().xyz_in_world[:, 0].tolist() == [1, 1, 1]


def test_a_map_for_drawing_takes_fewer_and_fewer_of_very_many() -> None:
    points, counts = PointMap(thinned=True), list[int]()
    for i in range(20 * HALVED_EVERY // NEW_PER_STEP):
        points = points.with_points(landmarks(range(i * NEW_PER_STEP, (i + 1) * NEW_PER_STEP)), i)
        counts.append(points.count)
    assert counts[HALVED_EVERY // NEW_PER_STEP - 1] == HALVED_EVERY and counts[-1] < 4.5 * HALVED_EVERY
