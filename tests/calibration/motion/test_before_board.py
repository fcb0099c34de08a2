"""The video camera's place and clock from views of a board at times of their own, against the truth."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.calibration.adjust.problem import Estimate, Observations, Unknowns
from ispom.calibration.adjust.solve import solve
from ispom.calibration.motion.before_board import Placed, placed, views_of
from ispom.calibration.targets.layouts import parse_target
from ispom.geometry import Pose
from ispom.simulation.filmed_board import Filming, filming_rig
from tests.calibration.filmed import FIRST_S, around, filmed, video_from_left

BOARD = parse_target("aprilgrid:6x6:0.03:0.3")
OFFSET_S = 0.035
PAIRS, PAIR_S, VIDEO_S = 30, 0.4, 1 / 30
SEEDS = 50


def found_by(seed: int, noise_px: float) -> tuple[Placed, Pose]:
    """As placed, and the truth."""
    film = Filming.of(filming_rig(), BOARD.size_m, PAIRS * PAIR_S + 0.5, seed, OFFSET_S)
    pairs_s = FIRST_S + PAIR_S * np.arange(PAIRS)
    video_s = around(pairs_s, VIDEO_S, 2)
    left, right, video = filmed(BOARD, film, seed, pairs_s, video_s, noise_px)
    blank = [type(left.detections[0])()]
    seen = Observations.of(
        BOARD,
        [
            [*left.detections, *blank * len(video_s)],
            [*right.detections, *blank * len(video_s)],
            [*blank * PAIRS, *video.detections],
        ],
    )
    rig = film.rig
    poses = [film.left_from_board_at(t) for t in pairs_s]
    poses += [film.video_from_board_at(t + OFFSET_S) for t in video_s]
    right_from_left = rig.rig_from_right.inverse() @ rig.rig_from_left
    cameras = tuple(rig.camera(name) for name in ("left", "right", "video"))
    start = Estimate.of(cameras, (Pose(), right_from_left, Pose()), poses)
    solution, _ = solve(start, seen, Unknowns.all_of(start, apart=2))
    truth = video_from_left(film)
    own = np.isin(np.arange(len(video_s)) + PAIRS, solution.seen.view)
    pair_views, video_views = np.arange(PAIRS), PAIRS + np.flatnonzero(own)
    best = placed(
        views_of(solution, pair_views, pairs_s),
        views_of(solution, video_views, video_s[own] + OFFSET_S),
        solution.covariance,
        Pose.exp(np.array([0.005, -0.004, 0.003, 0.004, 0.003, -0.004])) @ truth,
        -OFFSET_S + 0.003,
    )
    assert best is not None
    return best, truth


def test_place_and_clock_are_found_without_noise() -> None:
    best, truth = found_by(0, 1e-4)
    error = (best.video_from_left @ truth.inverse()).log()
    assert np.linalg.norm(error[:3]) < 2e-4
    assert np.degrees(np.linalg.norm(error[3:])) < 0.005
    assert best.offset_s == pytest.approx(-OFFSET_S, abs=2e-5)


@pytest.mark.slow
def test_place_and_clock_are_within_three_standard_errors_in_95_percent_of_seeds() -> None:
    shares, turned, late = [], [], []
    for seed in range(SEEDS):
        best, truth = found_by(seed, 0.2)
        error = np.append((best.video_from_left @ truth.inverse()).log(), best.offset_s + OFFSET_S)
        shares.append(np.abs(error) / np.sqrt(np.diag(best.covariance)))
        turned.append(np.degrees(np.linalg.norm(error[3:6])))
        late.append(abs(error[6]))
    assert np.mean(np.array(shares) <= 3, axis=0).min() >= 0.95
    assert np.median(turned) < 0.03
    assert np.percentile(turned, 90) < 0.05
    assert max(late) < 0.001
