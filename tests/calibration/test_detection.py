"""Points of every kind of target in simulated images, whose truth is exact; and what is rejected."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.calibration.detection.detect import common_hint, detect, hint, layout_fault
from ispom.calibration.targets.layouts import parse_target
from ispom.geometry import Pose
from ispom.simulation.filmed_board import LEFT, Exposing, board_image, board_poses
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
    assert "tags" in detect(parse_target("aprilgrid:3x3:0.03:0.3"), grey).reason


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
    assert "chessboard of 8x6" in hint(parse_target("chessboard:9x6:0.0242"), grey)


def test_of_boards_that_are_cut_the_size_of_most_views_is_told() -> None:
    """The first view shows 7 of 9 columns, another one 8."""
    shown, given = parse_target("chessboard:9x6:0.025"), parse_target("chessboard:8x5:0.025")
    start = np.array([-0.12, -0.08, 0.4])
    whole = [
        board_image(picture_of(shown), LEFT, Pose(translation=start + np.array([0, 0, z]))) for z in (0, 0.01, 0.02)
    ]
    cut = [whole[0][:, 300:], *whole, whole[0][:, 270:]]
    said = [hint(given, np.ascontiguousarray(image)) for image in cut]
    assert len(set(said)) > 1 and "9x6" not in said[0]
    assert "chessboard of 9x6" in common_hint(given, cut)
    assert common_hint(given, []) == ""


@pytest.mark.parametrize(
    ("filmed", "given", "said", "better"),
    [
        ("aprilgrid:6x6:0.03:0.3", "aprilgrid:6x6:0.03:0.009", "not metres", "aprilgrid:6x6:0.03:0.3"),
        ("aprilgrid:6x6:0.03:0.3", "aprilgrid:7x6:0.03:0.3", "has 6 tags in a row, not 7", "aprilgrid:6x6:0.03:0.3"),
        ("aprilgrid:6x6:0.03:0.3", "aprilgrid:5x6:0.03:0.3", "has 6 tags in a row, not 5", "aprilgrid:6x6:0.03:0.3"),
        ("apriltag:4x3:0.05:0.01", "apriltag:4x3:0.05:0.2", "in metres, not a share", "apriltag:4x3:0.05:0.01"),
        ("aruco:5x7:0.04:0.01", "aruco:7x5:0.04:0.01", "has 5 tags in a row, not 7", "aruco:5x7:0.04:0.01"),
        ("aprilgrid:6x6:0.03:0.3", "aprilgrid:6x6:0.03:0.3", "", ""),
        ("aruco:5x7:0.04:0.01", "aruco:5x7:0.04:0.01", "", ""),
        ("charuco:8x5:0.03:0.022", "charuco:8x5:0.03:0.022", "", ""),
    ],
)
def test_a_target_whose_tags_sit_otherwise_is_named(filmed: str, given: str, said: str, better: str) -> None:
    target = parse_target(filmed)
    poses = board_poses(LEFT, target.size_m, 4, 1)
    images = [board_image(picture_of(target), LEFT, pose) for pose in poses]
    fault = layout_fault(parse_target(given), images)
    assert said in fault and better in fault and bool(fault) == bool(said)
