"""Points of every kind of target in simulated images, whose truth is exact; and what is rejected."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.calibration.detection import detect
from ispom.calibration.detection.hint import hint
from ispom.calibration.targets import parse_target
from ispom.geometry import Pose
from ispom.simulation.board import Exposing, board_image
from ispom.simulation.filming import LEFT, board_poses
from tests.calibration.pictures import picture_of

SPECS = {
    "chessboard:9x6:0.0242": 0.08,
    "chessboard:7x7:0.03": 0.08,
    "charuco:8x5:0.03:0.022": 0.08,
    "aprilgrid:6x6:0.03:0.3": 0.08,
    "apriltag:4x3:0.05:0.01": 0.12,
    "aruco:5x4:0.04:0.012": 0.12,
    "circles:7x5:0.03": 0.6,
    "acircles:4x11:0.02": 0.6,
}
"""Targets, and how far their points may be off at the median [px]: centres of circles are not corrected here."""


@pytest.mark.parametrize("spec", SPECS)
def test_points_are_where_the_board_has_them(spec: str) -> None:
    target = parse_target(spec)
    picture = picture_of(target)
    away, spread, seen = [], [], 0
    for seed, pose in enumerate(board_poses(LEFT, target.size_m, 3, seed=4)):
        found = detect(target, board_image(picture, LEFT, pose, Exposing(seed=seed)))
        if not found.reason:
            truth = LEFT.project(pose.apply(target.xyz_in_board[found.ids]))
            away.append(np.linalg.norm(found.uv - truth, axis=1))
            spread.append(found.sigma_px)
            seen += 1
    assert seen >= 2
    error, sigma = np.concatenate(away), np.concatenate(spread)
    assert np.median(error) < SPECS[spec]
    if not target.disc_radius_m:
        ratio = np.median(error) / 1.18 / np.median(sigma)  # of a Rayleigh distribution
        assert 0.3 < ratio < 2


def test_a_board_that_is_not_there_is_rejected_by_name() -> None:
    grey = board_image(
        picture_of(parse_target("circles:7x5:0.03")), LEFT, Pose(translation=np.array([-0.1, -0.1, 0.4]))
    )
    for spec in ("chessboard:9x6:0.0242", "aprilgrid:6x6:0.03:0.3", "acircles:4x11:0.02"):
        assert detect(parse_target(spec), grey).reason in ("no board found", "no tag found")


def test_a_larger_chessboard_is_not_taken_for_a_smaller_one() -> None:
    target = parse_target("chessboard:9x6:0.0242")
    grey = board_image(picture_of(target), LEFT, Pose(translation=np.array([-0.1, -0.08, 0.35])))
    for spec in ("chessboard:8x6:0.0242", "chessboard:9x5:0.0242", "chessboard:6x5:0.0242"):
        found = detect(parse_target(spec), grey)
        assert found.reason.startswith(("the board continues", "no board"))


def test_tags_of_another_board_are_named() -> None:
    grey = board_image(
        picture_of(parse_target("aprilgrid:6x6:0.03:0.3")), LEFT, Pose(translation=np.array([-0.12, -0.12, 0.4]))
    )
    assert "tags that the target does not have" in detect(parse_target("aprilgrid:3x3:0.03:0.3"), grey).reason


def test_blurred_images_are_rejected() -> None:
    target = parse_target("chessboard:9x6:0.0242")
    start, end = np.array([-0.1, -0.08, 0.35]), np.array([-0.07, -0.08, 0.35])
    poses = tuple(Pose(translation=start + share * (end - start)) for share in np.linspace(0, 1, 12))
    assert detect(target, board_image(picture_of(target), LEFT, poses)).reason


@pytest.mark.parametrize("spec", ["aprilgrid:6x6:0.03:0.3", "charuco:8x5:0.03:0.022"])
def test_a_mirrored_board_is_told(spec: str) -> None:
    target = parse_target(spec)
    x, y = (-side / 2 for side in target.size_m)
    grey = board_image(picture_of(target), LEFT, Pose(translation=np.array([x, y, 0.5])))
    mirrored = np.ascontiguousarray(grey[:, ::-1])
    assert not detect(target, grey).reason and detect(target, mirrored).reason
    assert "mirrored" in hint(target, mirrored) and "mirrored" not in hint(target, grey)


def test_a_board_of_another_size_is_told() -> None:
    shown = parse_target("chessboard:8x6:0.025")
    grey = board_image(picture_of(shown), LEFT, Pose(translation=np.array([-0.09, -0.06, 0.35])))
    assert "a chessboard of 8x6 inner corners" in hint(parse_target("chessboard:9x6:0.0242"), grey)
