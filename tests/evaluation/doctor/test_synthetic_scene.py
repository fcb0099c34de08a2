"""What freed calibrations say of an exact scene that two cameras and a pair see with a wrong rig."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from ispom.evaluation.doctor import counterfactual
from ispom.evaluation.doctor.adjustment import Promise, placed, uncertainties
from ispom.evaluation.doctor.counterfactual import Outcome
from ispom.evaluation.doctor.examination import Examination
from ispom.evaluation.doctor.finding import Finding
from ispom.evaluation.doctor.hypothesis import Change, change_of
from ispom.evaluation.doctor.scene import CAMERAS, Observations, Scene, predicted
from ispom.evaluation.doctor.start import SIGNIFICANT, Start, significance
from ispom.evaluation.doctor.suspects.calibration import CALIBRATION
from ispom.evaluation.sensitivity.perturbation import Perturbation
from ispom.geometry import Pose, so3_exp
from ispom.simulation.cameras import simulated_rig

NOISE_PX = 0.15
FOCAL_PX = 226.0
POINTS, KNOTS = 100, 12
RIG = simulated_rig(0.5)


def scene(farther: float = 1.0) -> Scene:
    """A flight of 3 m with bends, past points at distances of 4 to 40 m, times `farther`."""
    rng = np.random.default_rng(0)
    times_s = np.linspace(0, 1.5, KNOTS)
    turns = np.radians(2.5) * np.sin(np.outer(times_s, [5.0, 3.0, 4.0]) + np.array([0.3, 1.1, 2.0]))
    positions = np.stack([0.3 * np.sin(2 * times_s), 0.1 * np.sin(3 * times_s), 2 * times_s], axis=1)
    depths = farther * rng.uniform(4, 40, POINTS)
    points = np.stack([rng.uniform(-0.5, 0.5, POINTS) * depths, rng.uniform(-0.4, 0.4, POINTS) * depths, depths + 3], 1)
    return Scene(times_s, so3_exp(turns), positions, points)


def start(farther: float = 1.0) -> Start:
    """The exact scene, and what the cameras of RIG saw of it, with noise; the points with an even number are held
    out."""
    world = scene(farther)
    parts = []
    for name, times_s in (
        ("video", world.times_s),
        *((side, np.linspace(0.05, 1.45, 5)) for side in ("left", "right")),
    ):
        point, frame = (a.ravel() for a in np.meshgrid(np.arange(POINTS), np.arange(len(times_s)), indexing="ij"))
        parts.append((np.full(len(point), CAMERAS.index(name)), times_s[frame], point))
    camera, time_s, point = (np.concatenate(values) for values in zip(*parts, strict=True))
    empty = Observations(camera, time_s, point, np.zeros((len(camera), 2)))
    uv = -predicted(world, RIG, Change(), empty, derivatives=False).residuals
    size = np.array([[RIG.camera(name).width, RIG.camera(name).height] for name in CAMERAS])[camera]
    inside = np.asarray(((uv > 0) & (uv < size)).all(axis=1))
    noisy = uv + np.random.default_rng(1).normal(0, NOISE_PX, uv.shape)
    seen = Observations(camera, time_s, point, noisy).select(inside)
    return Start(world, seen, np.arange(POINTS) % 2 == 0, np.arange(KNOTS))


def outcomes(wrong: Change, *subsets: tuple[str, ...]) -> list[Outcome]:
    """Returns what freeing these numbers does where the rig is stated with this change."""
    stated = wrong.of_rig(RIG)
    base = counterfactual.baseline(start(), stated)
    return [counterfactual.tested(base, names) for names in subsets]


TURN = ("turn_x_deg", "turn_y_deg", "turn_z_deg")
BASELINE = ("baseline_percent",)
CENTRE = ("video_centre_x_px", "video_centre_y_px")


def test_a_turned_mount_is_found_by_its_size_and_explains_more_than_a_principal_point() -> None:
    turned, centre = outcomes(Change(Perturbation(turn_y_deg=1.0)), TURN, CENTRE)
    assert turned.change.perturbation.turn_y_deg == pytest.approx(-1.0, abs=0.05)
    assert turned.gain > centre.gain + 0.01 and turned.z > 10


def test_a_principal_point_is_found_by_its_size_and_explains_more_than_a_turned_mount() -> None:
    turned, centre = outcomes(Change(Perturbation(video_centre_x_px=6.0)), TURN, CENTRE)
    assert centre.change.perturbation.video_centre_x_px == pytest.approx(-6.0, abs=0.2)
    assert centre.gain > turned.gain + 0.01 and centre.z > 10


def test_a_baseline_is_found_by_the_distance_of_the_video_camera_from_the_pair() -> None:
    (found,) = outcomes(Change(Perturbation(baseline_percent=30.0)), ("baseline_percent",))
    assert found.change.perturbation.baseline_percent == pytest.approx(100 / 1.3 - 100, abs=2.5)
    assert found.gain > 0.025 and found.z > 2.5


def test_a_right_rig_leaves_nothing_to_explain() -> None:
    for found in outcomes(Change(), TURN, CENTRE, ("baseline_percent",)):
        assert found.gain < 0.01


def finding(key: str, stated: Change, seen: Start | None = None) -> Finding | None:
    """Returns what a suspect of the calibration finds where the rig is stated with this change."""
    suspect = next(each for each in CALIBRATION if each.key == key)
    examined = Examination(stated.of_rig(RIG), (), np.zeros(0, np.int64))
    examined.__dict__["start"] = start() if seen is None else seen
    return suspect.examine(examined)


WRONG = {
    "video-focal": ("video_focal_percent", 3.0, 100 / 1.03 - 100),
    "video-centre": ("video_centre_x_px", 6.0, -6.0),
    "distortion": ("k1", 0.1, -0.1),
    "mount-turned": ("turn_y_deg", 1.0, -1.0),
    "pair-turned": ("right_x_deg", 0.3, -0.3),
    "baseline": ("baseline_percent", 30.0, 100 / 1.3 - 100),
}


@pytest.mark.parametrize("key", WRONG)
def test_a_wrong_number_is_found_with_an_interval_that_has_it(key: str) -> None:
    name, wrong, right = WRONG[key]
    found = finding(key, change_of((name,), np.array([wrong])))
    assert found is not None and found.found
    assert abs(found.values[name] - right) < 2 * found.values[f"{name}_sigma"] < abs(right)


def test_a_lens_that_is_off_in_the_corners_does_not_accuse_the_focal_length() -> None:
    """Both coefficients are wrong and nearly cancel each other where most points are; the focal length takes it up."""
    found = finding("video-focal", Change(k1=0.12, k2=-0.12))
    assert found is None or not found.found


def test_held_out_points_are_found_again_from_far_too_deep() -> None:
    """A narrow loss leaves them where they are, for all that was seen of them seems wrong."""
    first = start()
    _, there = placed(first.scene, RIG, Change(), first.seen)
    _, deeper = placed(replace(first.scene, points=4 * first.scene.points), RIG, Change(), first.seen)
    assert np.nanmean(deeper) == pytest.approx(np.nanmean(there), rel=0.02)


def test_what_is_known_of_a_baseline_is_less_in_a_far_scene() -> None:
    known = []
    for farther in (1.0, 30.0):
        base = counterfactual.baseline(start(farther), RIG)
        promise = counterfactual.promising(base, {BASELINE: BASELINE})[BASELINE]
        known.append(promise.sigmas[0])
        found = counterfactual.tested(base, ("baseline_percent",)).change.perturbation.baseline_percent
        assert abs(found) < 4 * known[-1]
    assert known[1] > 3 * known[0]


def test_the_uncertainty_of_a_baseline_is_that_of_a_linear_fit() -> None:
    """Of exact observations: by difference quotients of all unknowns, without any damping. It was understated by half,
    for damping held the distances of the points."""
    world, seen, points = scene(), start().seen, 40
    seen = seen.select(seen.point < points)
    exact = replace(seen, uv=seen.uv - predicted(world, RIG, Change(), seen, derivatives=False).residuals)

    def residuals(step: np.ndarray) -> np.ndarray:
        moves = np.concatenate([step[6 * KNOTS : -1].reshape(-1, 3), np.zeros((POINTS - points, 3))])
        moved = world.moved(step[: 6 * KNOTS].reshape(-1, 6), moves)
        return predicted(moved, RIG, change_of(BASELINE, step[-1:]), exact, derivatives=False).residuals.ravel()

    ends = 1e-4 * np.eye(6 * KNOTS + 3 * points + 1)[6:]
    jacobian = np.column_stack([(residuals(end) - residuals(-end)) / 2e-4 for end in ends])
    scale = 1 / np.linalg.norm(jacobian, axis=0)
    root = np.asarray(np.linalg.qr(jacobian * scale, mode="r"))
    linear = NOISE_PX * scale[-1] / abs(root[-1, -1])
    (sigma,) = uncertainties(world, RIG, seen, BASELINE, Change())
    assert sigma == pytest.approx(linear, rel=0.3)


def test_a_pose_without_observations_changes_nothing_that_is_known_of_a_baseline() -> None:
    first = start()
    known = uncertainties(first.scene, RIG, first.seen, BASELINE, Change())
    world = first.scene
    longer = Scene(
        np.append(world.times_s, world.times_s[-1] + 1),
        np.concatenate([world.rotations, world.rotations[-1:]]),
        np.concatenate([world.positions, world.positions[-1:]]),
        world.points,
    )
    np.testing.assert_allclose(uncertainties(longer, RIG, first.seen, BASELINE, Change()), known, rtol=1e-3)


@pytest.mark.parametrize(("sigma", "silent"), [(1.0, False), (4.0, True)])
def test_a_baseline_that_the_tracks_do_not_know_is_not_cleared(sigma: float, silent: bool) -> None:
    suspect = next(each for each in CALIBRATION if each.key == "baseline")
    seen = SimpleNamespace(rig=RIG, baseline=object(), promises={("baseline_percent",): Promise(0.0, (sigma,))})
    finding = suspect.examine(cast(Examination, seen))
    assert (finding is None) == silent
    assert finding is None or not finding.found


def rays(moved_m: float) -> tuple[np.ndarray, np.ndarray, Pose]:
    """Tracks in two views, as normalised coordinates with noise, and b_from_a."""
    rng = np.random.default_rng(2)
    b_from_a = Pose.from_rotvec(np.radians([1.0, 3.0, -2.0]), moved_m * np.array([0.8, 0.0, -0.6]))
    depths = rng.uniform(5, 30, 100)
    a = np.column_stack([rng.uniform(-0.6, 0.6, (100, 2)) * depths[:, None], depths])
    b = b_from_a.apply(a)
    u, v = (x[:, :2] / x[:, 2:] + rng.normal(0, NOISE_PX / FOCAL_PX, (100, 2)) for x in (a, b))
    return u, v, b_from_a


def test_a_small_parallax_of_good_tracks_is_significant() -> None:
    u, v, b_from_a = rays(0.2)
    assert significance(u, v, b_from_a, FOCAL_PX) > SIGNIFICANT


def test_the_noise_of_a_camera_that_only_turns_is_no_parallax() -> None:
    u, v, turned = rays(0.0)
    for axis in np.eye(3):  # wherever noise makes one see the camera go
        assert significance(u, v, Pose(turned.rotation, axis), FOCAL_PX) < SIGNIFICANT
