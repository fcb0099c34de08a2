"""The window of a generalised camera: exact on exact points, and sure of its scale only where something gives it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.geometry import Array, Pose, so3_exp
from ispom.solvers.generalised import (
    Cameras,
    Observations,
    Window,
    adjust,
    distances_px,
    errors_of,
    points_in_world,
    reanchored,
    resect,
    scaled,
)
from ispom.types import Camera, Rig

CAMERA = Camera(320, 240, 200.0, 200.0, 159.5, 119.5)
STRAIGHT = [Pose(translation=np.array([0.0, 0.0, 0.4 * k])) for k in range(5)]
TURNING = [Pose.from_rotvec(np.array([0.0, 0.15 * k, 0.0]), np.array([0.0, 0.0, 0.4 * k])) for k in range(5)]

ANGLES = 0.15 * np.arange(5)


def rig(count: int) -> Rig:
    """Cameras that look outwards from a circle of 0.5 m."""
    values: dict[str, Camera | Pose] = {f"c{k}": CAMERA for k in range(count)}
    for k in range(count):
        turned = so3_exp(np.array([0.0, 2 * np.pi * k / count, 0.0]))
        values[f"rig_from_c{k}"] = Pose(turned, turned @ np.array([0.0, 0.0, 0.5]))
    return Rig.of(**values)


def exact(poses: list[Pose], count: int = 4, overlap: bool = False) -> tuple[Window, Cameras, Array]:
    """Points around all cameras as they are seen exactly, and where they are; with `overlap`, each by the next one."""
    cameras = Cameras.of(rig(count), tuple(rig(count).cameras))
    rng, per_camera = np.random.default_rng(0), 15
    camera = np.repeat(np.arange(count), per_camera)
    in_camera = rng.uniform((-2, -1.5, 4), (2, 1.5, 9), (len(camera), 3))
    middle = poses[len(poses) // 2]
    xyz = np.array([(middle @ rig(count).rig_from(f"c{c}")).apply(p) for c, p in zip(camera, in_camera, strict=True)])
    own, other_xy = np.full((len(poses), len(camera), 2), np.nan), np.full((len(poses), len(camera), 2), np.nan)
    other = np.full((len(poses), len(camera)), -1)
    for k, pose in enumerate(poses):
        for m, c in enumerate(camera):
            for target, seen_by in ((own, c), (other_xy, (c + 1) % count)):
                x, y, z = (pose @ rig(count).rig_from(f"c{seen_by}")).inverse().apply(xyz[m])
                if z > 0.1 and (target is own or overlap):
                    target[k, m] = x / z, y / z
                    if target is other_xy:
                        other[k, m] = seen_by
    anchor = np.zeros(len(camera), np.int64)
    depth = [(poses[0] @ rig(count).rig_from(f"c{c}")).inverse().apply(p)[2] for c, p in zip(camera, xyz, strict=True)]
    rotations, translations = np.array([p.rotation for p in poses]), np.array([p.translation for p in poses])
    return Window(rotations, translations, camera, anchor, 1 / np.array(depth), own, other, other_xy), cameras, xyz


def disturbed(window: Window, seed: int = 1, size: float = 0.01) -> Window:
    rng = np.random.default_rng(seed)
    rotations, translations = window.rotations.copy(), window.translations.copy()
    rotations[1:] = rotations[1:] @ so3_exp(rng.normal(0, size, (len(rotations) - 1, 3)))
    translations[1:] += rng.normal(0, size, (len(translations) - 1, 3))
    rho = window.rho * rng.uniform(0.9, 1.1, len(window.rho))
    return replace(window, rotations=rotations, translations=translations, rho=rho)


def test_exact_observations_have_no_errors() -> None:
    window, cameras, xyz = exact(TURNING, overlap=True)
    seen = Observations.of(window)
    assert distances_px(window, cameras, seen).max() < 1e-9
    assert seen.by_other.any() and (np.diff(seen.point) >= 0).all()
    np.testing.assert_allclose(points_in_world(window, cameras), xyz, atol=1e-9)


def test_derivatives_are_those_of_differences() -> None:
    window, cameras, _ = exact(TURNING, overlap=True)
    window = disturbed(window)
    seen = Observations.of(window)
    found, h = errors_of(window, cameras, seen), 1e-6
    for frame in (0, 3):
        for axis in range(6):
            moved = [_moved(window, frame, axis, sign * h) for sign in (1, -1)]
            plus, minus = (errors_of(w, cameras, seen).px for w in moved)
            anchored, sees = window.anchor[seen.point] == frame, seen.frame == frame
            expected = anchored[:, None] * found.by_anchor[..., axis] + sees[:, None] * found.by_frame[..., axis]
            np.testing.assert_allclose((plus - minus) / (2 * h), expected, atol=1e-3)
    plus, minus = (errors_of(replace(window, rho=window.rho + d), cameras, seen).px for d in (h, -h))
    np.testing.assert_allclose((plus - minus) / (2 * h), found.by_rho, atol=1e-3)


def _moved(window: Window, frame: int, axis: int, by: float) -> Window:
    rotations, translations = window.rotations.copy(), window.translations.copy()
    step = np.zeros(6)
    step[axis] = by
    translations[frame] += step[:3]
    rotations[frame] = rotations[frame] @ so3_exp(step[3:])
    return replace(window, rotations=rotations, translations=translations)


@pytest.mark.parametrize("overlap", [True, False])
def test_a_turning_rig_is_recovered_with_its_scale(overlap: bool) -> None:
    window, cameras, _ = exact(TURNING, overlap=overlap)
    start = disturbed(scaled(window, 1.1))
    found = start
    for _ in range(10):
        found = adjust(found, cameras, 0.5).window
    np.testing.assert_allclose(found.translations, window.translations, atol=1e-4)
    np.testing.assert_allclose(found.rotations, window.rotations, atol=1e-5)
    np.testing.assert_allclose(found.rho, window.rho, rtol=1e-3)


def test_the_scale_is_observable_by_overlap_or_rotation_only() -> None:
    sigma = {}
    for name, poses in (("straight", STRAIGHT), ("turning", TURNING)):
        for overlap in (False, True):
            window, cameras, _ = exact(poses, overlap=overlap)
            sigma[name, overlap] = adjust(window, cameras, 0.5).scale_sigma
    assert sigma["straight", False] > 10
    assert max(sigma["straight", True], sigma["turning", True], sigma["turning", False]) < 0.05
    circle = [Pose.from_rotvec(np.array([0, a, 0]), np.array([-3 * np.sin(a), 0, 3 - 3 * np.cos(a)])) for a in ANGLES]
    for count, observable in ((2, False), (4, True)):  # both of two cameras lie on the line to the circle's centre
        window, cameras, _ = exact(circle, count)
        assert (adjust(window, cameras, 0.5).scale_sigma < 1) == observable
    window, cameras, _ = exact(TURNING, count=1)
    assert adjust(window, cameras, 0.5).scale_sigma > 10  # one camera alone


def test_the_stated_sigma_of_the_scale_is_that_of_its_errors() -> None:
    window, cameras, _ = exact(TURNING)
    rng, noise_px, errors, stated = np.random.default_rng(2), 0.2, [], []
    for _ in range(25):
        noisy = replace(window, own=window.own + rng.normal(0, noise_px / 200.0, window.own.shape))
        found = adjust(noisy, cameras, noise_px)
        length = np.linalg.norm(found.window.translations[-1])
        errors.append(np.log(length / np.linalg.norm(window.translations[-1])))
        stated.append(found.scale_sigma)
    assert 0.6 < np.std(errors) / np.median(stated) < 2.5  # the loss takes 0.2 px as its width, and weighs all less


def test_a_held_scale_stays() -> None:
    window, cameras, _ = exact(STRAIGHT)
    start = scaled(window, 1.3)
    found = adjust(disturbed(start, size=0.002), cameras, 0.5, held=1e-4)
    assert np.linalg.norm(found.window.translations[3]) == pytest.approx(1.2 * 1.3, rel=0.01)
    assert np.isfinite(found.rho_sigma).all() and np.median(found.rho_sigma / found.window.rho) < 0.05


def test_resection_by_the_points_of_all_cameras() -> None:
    window, cameras, _ = exact(TURNING)
    start = _moved(_moved(window, 4, 0, 0.1), 4, 4, 0.05)
    seen = Observations.of(window)
    found, errors = resect(start, cameras, seen.select(seen.frame == 4), 4, 0.5)
    np.testing.assert_allclose(found.translations, window.translations, atol=1e-6)
    np.testing.assert_allclose(found.rotations, window.rotations, atol=1e-6)
    assert errors.max() < 1e-3


@pytest.mark.parametrize("frame", [0, 2])
def test_a_frame_is_taken_out_without_moving_points(frame: int) -> None:
    window, cameras, xyz = exact(TURNING, overlap=True)
    found, stay = reanchored(window, cameras, frame)
    assert len(found.rotations) == 4 and stay.all()
    np.testing.assert_allclose(points_in_world(found, cameras), xyz[stay], atol=1e-9)
    assert distances_px(found, cameras, Observations.of(found)).max() < 1e-9


def test_points_that_nothing_else_sees_go_with_their_frame() -> None:
    window, cameras, _ = exact(TURNING)
    own = window.own.copy()
    own[1:, :3] = np.nan
    found, stay = reanchored(replace(window, own=own), cameras, 0)
    assert not stay[:3].any() and stay[3:].all() and len(found.rho) == stay.sum()
