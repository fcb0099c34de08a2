"""The position errors at the frames of a run and its forks: a frame that they share has one error."""

from __future__ import annotations

import numpy as np
import pytest
from ispom_app.engine.error_curve import Part, family_curves
from ispom_app.session.branches.accuracy import with_curves
from ispom_app.session.branches.branches import NOTHING, Branch, Measured

from ispom.evaluation.trajectory_error import TrajectoryError
from ispom.geometry import Pose, so3_exp
from ispom.types import Trajectory

SHARED, RNG = 20, np.random.default_rng(3)
TURNED = Pose(so3_exp(np.array([0.1, -0.3, 0.2])), np.array([3.0, -1.0, 2.0]))


def truth(count: int) -> Trajectory:
    t = np.arange(count) / 10
    places = np.stack([2 * np.sin(t), 0.3 * np.cos(3 * t), t], axis=1)
    return Trajectory(np.arange(count) * 10**8, np.tile(np.eye(3), (count, 1, 1)), places)


def estimated(count: int, drift: float, noise: float = 0.01) -> Trajectory:
    """In a world of its own; the first SHARED poses are always the same."""
    true, rng = truth(count), np.random.default_rng(5)
    off = rng.normal(0, noise, (count, 3))
    off[SHARED:, 0] += drift * np.arange(count - SHARED)
    return Trajectory(true.times_ns, true.rotations, TURNED.apply(true.translations + off))


def error(count: int, drift: float, kind="se3") -> TrajectoryError:
    return TrajectoryError(estimated(count, drift), truth(count), kind)


def test_of_one_run_the_root_mean_square_is_the_ate() -> None:
    one = error(40, 0.02)
    curve = family_curves({0: Part(one, None)})[0]
    assert np.sqrt(np.mean(curve.metres**2)) == pytest.approx(one.ate_m, rel=1e-12)
    assert curve.aligned == "SE(3)" and curve.at(-1) is None
    assert curve.at(int(one.estimate.times_ns[7])) == curve.at(int(one.estimate.times_ns[7]) + 1) == curve.metres[7]


@pytest.mark.parametrize("kind", ["se3", "sim3"])
@pytest.mark.parametrize(("longer", "shorter"), [(40, 60), (60, 25)])
def test_a_fork_and_its_parent_have_one_error_at_the_frames_that_they_share(
    kind: str, longer: int, shorter: int
) -> None:
    parent, fork = error(longer, 0.001, kind), error(shorter, 0.05, kind)
    assert not np.allclose(parent.position_errors_m[:SHARED], fork.position_errors_m[:SHARED]), "each by its own"
    found = family_curves({0: Part(parent, None), 3: Part(fork, 0, SHARED * 10**8)})
    assert np.array_equal(found[0].metres[:SHARED], found[3].metres[:SHARED])
    assert [len(found[n].metres) for n in (0, 3)] == [longer, shorter] and found[0].branches == 2
    assert found[0].aligned == found[3].aligned != family_curves({0: Part(parent, None)})[0].aligned


def test_a_fork_of_a_fork_reads_each_frame_of_the_branch_that_computed_it() -> None:
    parts = {
        0: Part(error(50, 0.001), None),
        1: Part(error(50, 0.01), 0, SHARED * 10**8),
        2: Part(error(50, 0.03), 1, 30 * 10**8),
    }
    found = family_curves(parts)
    assert np.array_equal(found[0].metres[:SHARED], found[2].metres[:SHARED])
    assert np.array_equal(found[1].metres[:30], found[2].metres[:30])
    assert not np.allclose(found[1].metres[30:], found[2].metres[30:])


def test_where_the_parent_had_no_unit_yet_each_is_aligned_by_itself() -> None:
    """One number said 0.2 m in the dock where the ATE was 4 mm: the parent never had a map."""
    fork = error(50, 0.001, "sim3")
    still = Trajectory(fork.estimate.times_ns, fork.estimate.rotations, np.zeros((50, 3)))
    parts = {0: Part(TrajectoryError(still, truth(50), "sim3"), None), 1: Part(fork, 0, SHARED * 10**8)}
    found = family_curves(parts)
    assert np.array_equal(found[1].metres, fork.position_errors_m) and found[1].branches == 1


def test_runs_that_share_nothing_are_aligned_by_themselves() -> None:
    own = error(40, 0.0), error(40, 0.05)
    found = family_curves({0: Part(own[0], None), 1: Part(own[1], None), 2: Part(own[1], 7, SHARED * 10**8)})
    assert all(np.array_equal(found[n].metres, own[min(n, 1)].position_errors_m) for n in (0, 1, 2))


def test_a_branch_that_computed_all_frames_itself_is_aligned_by_itself() -> None:
    measured = [Measured({"stereo": error(40, drift)}) for drift in (0.001, 0.05)]
    branches = Branch(0, "first run", measured=measured[0]), Branch(1, "stored", 0, 0, measured=measured[1])
    found = with_curves(branches, lambda _: 0)
    for each, known in zip(found, measured, strict=True):
        curve = each.measured.curves["stereo"]
        assert curve.branches == 1 and np.array_equal(curve.metres, known.errors["stereo"].position_errors_m)


def test_branches_get_their_curves_together_and_one_that_was_not_measured_stays_so() -> None:
    measured = [Measured({"stereo": error(count, drift)}) for count, drift in ((40, 0.001), (60, 0.05))]
    branches = Branch(0, "first run", measured=measured[0]), Branch(1, "fork", 0, SHARED, measured=measured[1])
    found = with_curves((*branches, Branch(2, "new", 0, 30)), lambda branch: branch.at * 10**8)
    shared = [branch.measured.curves["stereo"].metres[:SHARED] for branch in found[:2]]
    assert np.array_equal(*shared) and found[2].measured is NOTHING
    assert [b.measured.errors["stereo"].ate_m for b in found[:2]] == [m.errors["stereo"].ate_m for m in measured]
    alone = with_curves(found[1:2], lambda branch: branch.at * 10**8)
    assert alone[0].measured.curves["stereo"].branches == 1, "its parent was deleted"
