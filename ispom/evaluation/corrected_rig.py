"""The rig as the methods themselves corrected it in a run, with how sure they are of each correction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from ispom.errors import InputError
from ispom.geometry import Array, Pose
from ispom.types import Camera, Rig

SIGNIFICANT = 2.0
"""Corrections below so many standard errors are no finding, and change nothing."""
GRID = 12
"""Pixels along each side at which a corrected lens is fitted, to some hundredths of a pixel."""


@dataclass(frozen=True)
class Finding:
    """One correction."""

    what: str
    value: float
    standard_error: float
    unit: str
    applied: bool
    """Whether the rig has it: what is not significant, or has no place in a rig, is only told."""

    def __str__(self) -> str:
        fate = "" if self.applied else " (not applied)"
        return f"{self.what} {self.value:+.4g} +- {self.standard_error:.2g} {self.unit}{fate}"


@dataclass(frozen=True, eq=False)
class Corrected:
    rig: Rig
    findings: tuple[Finding, ...]

    @property
    def any_applied(self) -> bool:
        return any(finding.applied for finding in self.findings)


def corrected(rig: Rig, found: Mapping[str, Array]) -> Corrected:
    """By what the last steps said (Step.calibration): `lens`, `pair` and `rig`, each with its NAME_covariance.

    InputError where they said nothing.
    """
    findings: list[Finding] = []
    if rig.video is not None and "lens_covariance" in found:
        camera, told = _lens(rig.video, found["lens"], found["lens_covariance"])
        rig, findings = replace(rig, video=camera), [*findings, *told]
    if rig.has_stereo and "pair_covariance" in found:
        rig, told = _pair(rig, found["pair"], found["pair_covariance"])
        findings += told
    if rig.video is not None and "rig_covariance" in found:
        rig, told = _placed(rig, found["rig"], found["rig_covariance"])
        findings += told
    if not findings:
        raise InputError("no method corrected its cameras in this run: run monocular, stereo or integrated")
    return Corrected(rig, tuple(findings))


def _lens(camera: Camera, lens: Array, covariance: Array) -> tuple[Camera, list[Finding]]:
    """The camera that sees at once what `camera` sees once its normalised x is x (1 + f + k |x|^2)."""
    good = _significant(lens, covariance)
    sigma = np.sqrt(np.diag(covariance))
    told = [
        Finding("video focal length", float(100 * lens[0]), float(100 * sigma[0]), "%", good),
        Finding("video radial distortion", float(lens[1]), float(sigma[1]), "", good),
    ]
    if not good:
        return camera, told
    u, v = np.meshgrid(np.linspace(0, camera.width - 1, GRID), np.linspace(0, camera.height - 1, GRID))
    seen = np.stack([u.ravel(), v.ravel()], axis=1)
    x = given = camera.normalise(seen)
    for _ in range(10):
        x = given / (1 + lens[0] + lens[1] * (x**2).sum(1, keepdims=True))
    rays = np.column_stack([x, np.ones(len(x))])
    count = 2 if camera.lens == "opencv" else 4
    distortion = (*camera.distortion, *(0.0,) * max(0, 4 - len(camera.distortion)))

    def of(vector: Array) -> Camera:
        radial = tuple(float(k) for k in vector[2:])
        return replace(camera, fx=float(vector[0]), fy=float(vector[1]), distortion=(*radial, *distortion[count:]))

    begin = np.array([camera.fx, camera.fy, *distortion[:count]])
    scale = np.array([camera.fx, camera.fy, *(0.1,) * count])
    fit = least_squares(lambda w: (of(begin + scale * w).project(rays) - seen).ravel(), np.zeros(len(begin)))
    return of(begin + scale * fit.x), told


def _pair(rig: Rig, pair: Array, covariance: Array) -> tuple[Rig, list[Finding]]:
    """The right camera turned and shifted so that it sees right x at x + a + b x^2: a yaw of b, and a - b beyond it."""
    f, (offset, lag, square, fourth) = rig.camera("right").fx, pair
    sigma = np.sqrt(np.diag(covariance))
    turned = _significant(pair[[0, 2]], covariance[np.ix_([0, 2], [0, 2])])
    beside_turn = np.sqrt(max(covariance[0, 0] + covariance[2, 2] - 2 * covariance[0, 2], 0.0))
    told = [
        Finding("right camera yaw", float(np.degrees(square)), float(np.degrees(sigma[2])), "deg", turned),
        Finding("right principal point x", float(f * (offset - square)), float(f * beside_turn), "px", turned),
        Finding("right bend x^4", float(f * fourth), float(f * sigma[3]), "px at 45 deg", False),
        Finding("right shutter late", float(1e3 * lag), float(1e3 * sigma[1]), "ms", False),
    ]
    if not turned:
        return rig, told
    # Turned about y by b, the camera sees x + b (1 + x^2) to first order.
    turn = Pose.from_rotvec(np.array([0.0, -square, 0.0]), np.zeros(3))
    right = replace(rig.camera("right"), cx=rig.camera("right").cx + float(f * (offset - square)))
    return replace(rig, right=right, rig_from_right=rig.rig_from_right @ turn), told


def _placed(rig: Rig, change: Array, covariance: Array) -> tuple[Rig, list[Finding]]:
    """The video camera turned and moved on the rig by `change` (7,), `rig` of Step.calibration."""
    sigma = np.sqrt(np.diag(covariance))
    told = []
    turn, shift = np.zeros(3), np.zeros(3)
    for name, part, unit, factor in (("turned", slice(0, 3), "deg", 180 / np.pi), ("moved", slice(3, 6), "mm", 1e3)):
        if not (sigma[part] > 0).all():
            continue
        good = _significant(change[part], covariance[part, part])
        for axis, value, error in zip("xyz", change[part], sigma[part], strict=True):
            told.append(Finding(f"video {name} {axis}", float(factor * value), float(factor * error), unit, good))
        if good and name == "turned":
            turn = change[part]
        elif good:
            shift = change[part]
    if sigma[6] > 0:
        told.append(Finding("video clock late", float(1e3 * change[6]), float(1e3 * sigma[6]), "ms", False))
    placed = Pose(translation=shift) @ rig.rig_from_video @ Pose.from_rotvec(turn, np.zeros(3))
    return replace(rig, rig_from_video=placed), told


def _significant(value: Array, covariance: Array) -> bool:
    """Whether a vector differs from none by more than chance makes it: SIGNIFICANT in each of its directions' mean."""
    return bool(value @ np.linalg.solve(covariance, value) > SIGNIFICANT**2 * len(value))
