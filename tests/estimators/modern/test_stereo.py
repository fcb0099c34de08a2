"""The modern stereo estimator on the simulator and on real drives; bounds with some room above what was measured."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from ispom.estimators.modern.stereo import ModernStereo, ModernStereoConfig
from ispom.evaluation.kitti import kitti_errors
from ispom.sequences import open_sequence
from ispom.types import Exposure, Sequence, Status, Step, StereoPair, TrackStatus, Trajectory

DATA = Path(__file__).parents[4] / "shared" / "data"
ABSENT = "the shared recordings are not here"


def run(estimator: ModernStereo, exposures: list[Exposure]) -> tuple[Trajectory, list[Step]]:
    state, steps = estimator.start(), []
    for exposure in exposures:
        if estimator.uses(exposure):
            state, step = estimator.step(state, exposure)
            steps.append(step)
    return estimator.finish(state), steps


def errors_m(found: Trajectory, truth: Trajectory) -> np.ndarray:
    """Distances from the truth, the first poses laid upon each other."""
    pairs = [(p, q) for t, p in found.items() if (q := truth.at(t)) is not None]
    placed = pairs[0][1] @ pairs[0][0].inverse()
    return np.array([np.linalg.norm((placed @ p).translation - q.translation) for p, q in pairs])


def test_the_simulated_flight_is_metric(flight: Sequence, exposures: list[Exposure]) -> None:
    found, steps = run(ModernStereoConfig().build(flight.rig), exposures)
    assert flight.truth is not None and len(found) == flight.kinds.count("stereo")
    assert errors_m(found, flight.truth).max() < 0.006 * flight.truth.length
    assert all(s.covariance is not None and np.linalg.eigvalsh(s.covariance)[0] > 0 for s in steps[2:])


def test_threads_of_opencv_change_nothing(flight: Sequence, exposures: list[Exposure]) -> None:
    before, found = cv2.getNumThreads(), []
    try:
        for threads in (1, 2):
            cv2.setNumThreads(threads)
            found.append(run(ModernStereoConfig().build(flight.rig), exposures[:12])[0])
    finally:
        cv2.setNumThreads(before)
    assert np.array_equal(found[0].translations, found[1].translations)
    assert np.array_equal(found[0].rotations, found[1].rotations)


def test_a_stretch_without_texture_is_lost_and_recovered_from(flight: Sequence, exposures: list[Exposure]) -> None:
    pairs = [e for e in exposures if isinstance(e, StereoPair)]
    grey = np.full_like(pairs[0].left, 128)
    broken: list[Exposure] = [StereoPair(p.time_ns, grey, grey) if i in (3, 4) else p for i, p in enumerate(pairs)]
    found, steps = run(ModernStereoConfig().build(flight.rig), broken)
    assert [s.status for s in steps[3:6]] == [Status.LOST, Status.LOST, Status.TRACKING]
    assert flight.truth is not None and errors_m(found, flight.truth).max() < 0.02 * flight.truth.length


def test_a_drive_on_which_nothing_is_seen_any_more_begins_anew(flight: Sequence, exposures: list[Exposure]) -> None:
    pairs = [e for e in exposures if isinstance(e, StereoPair)]
    grey = np.full_like(pairs[0].left, 128)
    turned = [StereoPair(p.time_ns, p.left[::-1].copy(), p.right[::-1].copy()) for p in pairs[4:]]
    config = ModernStereoConfig(max_lost_pairs=0)
    exposures = [*pairs[:3], StereoPair(pairs[3].time_ns, grey, grey), *turned]
    found, steps = run(config.build(flight.rig), exposures)
    assert steps[3].status is Status.INITIALISING and any("pairs lost" in str(d) for d in steps[3].decisions)
    assert steps[-1].status is Status.TRACKING and len(found) == len(exposures) - 1


def test_ended_tracks_say_why(flight: Sequence, exposures: list[Exposure]) -> None:
    _, steps = run(ModernStereoConfig().build(flight.rig), exposures)
    seen = {int(s) for step in steps for s in step.tracks["left"].status}
    assert {TrackStatus.ALIVE, TrackStatus.NEW, TrackStatus.REPROJECTION} <= seen
    assert all(len(np.unique(s.tracks["left"].ids)) == len(s.tracks["left"]) for s in steps)


@pytest.mark.skipif(not (DATA / "kitti").exists(), reason=ABSENT)
def test_kitti_06_is_within_its_limit() -> None:
    sequence = open_sequence(str(DATA / "kitti" / "sequences" / "06"))
    pairs = [sequence[i] for i, kind in enumerate(sequence.kinds) if kind == "stereo"]
    found, steps = run(ModernStereoConfig().build(sequence.rig), pairs)
    assert sequence.truth is not None and len(found) == 51
    errors = kitti_errors(found, sequence.truth)
    assert errors is not None and errors.t_err_percent < 0.85
    assert any("disparity offset" in str(d) for d in steps[-1].decisions + steps[-2].decisions)


@pytest.mark.skipif(not (DATA / "euroc_v1_01_start").exists(), reason=ABSENT)
def test_a_drone_at_rest_stays_where_it_is() -> None:
    sequence = open_sequence(str(DATA / "euroc_v1_01_start"))
    pairs = [sequence[i] for i, kind in enumerate(sequence.kinds) if kind == "stereo"]
    found, _ = run(ModernStereoConfig().build(sequence.rig), pairs)
    assert np.linalg.norm(found.translations - found.translations[0], axis=1).max() < 0.0005
