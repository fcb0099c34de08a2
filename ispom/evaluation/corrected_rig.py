"""The rig with the corrections that methods estimated in a run, each with its standard error."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ispom.errors import InputError
from ispom.geometry import Array, Pose
from ispom.solvers.right_camera import (
    AHEAD,
    BOTH_K1,
    BOTH_K2,
    DOWN,
    FOCAL,
    K1,
    K2,
    LAG,
    OFFSET_X,
    OFFSET_Y,
    P1,
    P2,
    PITCH,
    Q1,
    Q2,
    ROLL,
    TERMS,
    YAW,
)  # fmt: skip
from ispom.types import Camera, Corrections, Rig

MIN_SIGNIFICANCE = 2.0
"""Least size of a correction that is applied, in standard errors."""
BOTH_RADIAL = ("k1", BOTH_K1), ("k2", BOTH_K2)
GRID_POINTS = 12
"""Number of grid points along each side to which a corrected lens is fitted, to some hundredths of a pixel."""


@dataclass(frozen=True)
class Finding:
    """One correction."""

    what: str
    value: float
    standard_error: float
    unit: str
    applied: bool
    """Whether it is applied to the rig: one that is not significant, or that a rig cannot represent, is only
    reported."""

    def __str__(self) -> str:
        suffix = "" if self.applied else " (not applied)"
        return f"{self.what} {self.value:+.4g} +- {self.standard_error:.2g} {self.unit}{suffix}"


@dataclass(frozen=True, eq=False)
class Corrected:
    """A rig, and all corrections that were estimated."""

    rig: Rig
    findings: tuple[Finding, ...]


def corrected(rig: Rig, calibration: Corrections) -> Corrected:
    """Applies those of the corrections that have a covariance.

    Raises InputError where there are none.
    """
    all_findings: list[Finding] = []
    lens, pair, mount = calibration.lens, calibration.pair, calibration.mount
    if rig.video is not None and lens is not None and lens.covariance is not None:
        camera, findings = _lens(rig.video, lens.values, lens.covariance)
        rig, all_findings = rig.changed(video=camera, video_sigma=None), [*all_findings, *findings]
    if rig.has_stereo and pair is not None and pair.covariance is not None:
        rig, findings = _pair(rig, pair.values, pair.covariance)
        all_findings += findings
    if rig.video is not None and mount is not None and mount.covariance is not None:
        rig, findings = _placed(rig, mount.values, mount.covariance)
        all_findings += findings
    if not all_findings:
        raise InputError("no method corrected its cameras in this run: run monocular, stereo or integrated")
    return Corrected(rig, tuple(all_findings))


def _lens(camera: Camera, lens: Array, covariance: Array) -> tuple[Camera, list[Finding]]:
    """Fits a camera whose projection is that of `camera` after x -> x (1 + f + k |x|^2) in normalised coordinates."""
    good = _significant(lens, covariance)
    sigma = np.sqrt(np.diag(covariance))
    findings = [
        Finding("video focal length", float(100 * lens[0]), float(100 * sigma[0]), "%", good),
        Finding("video radial distortion", float(lens[1]), float(sigma[1]), "", good),
    ]
    if not good:
        return camera, findings
    u, v = np.meshgrid(np.linspace(0, camera.width - 1, GRID_POINTS), np.linspace(0, camera.height - 1, GRID_POINTS))
    seen = np.stack([u.ravel(), v.ravel()], axis=1)
    x = distorted = camera.normalise(seen)
    for _ in range(10):
        x = distorted / (1 + lens[0] + lens[1] * (x**2).sum(1, keepdims=True))
    rays = np.column_stack([x, np.ones(len(x))])
    count = {"opencv": 2, "fisheye": 4}.get(camera.lens, 0)
    # The radial coefficients are fitted, too; for other models only the focal lengths.
    distortion = (*camera.distortion, *(0.0,) * (max(0, 4 - len(camera.distortion)) if count else 0))

    def of(vector: Array) -> Camera:
        radial = tuple(float(k) for k in vector[2:])
        return replace(camera, fx=float(vector[0]), fy=float(vector[1]), distortion=(*radial, *distortion[count:]))

    from scipy.optimize import least_squares  # here, as it takes 8 MB that few runs need

    begin = np.array([camera.fx, camera.fy, *distortion[:count]])
    scale = np.array([camera.fx, camera.fy, *(0.1,) * count])
    fit = least_squares(lambda w: (of(begin + scale * w).project(rays) - seen).ravel(), np.zeros(len(begin)))
    return of(begin + scale * fit.x), findings


def _pair(rig: Rig, pair: Array, covariance: Array) -> tuple[Rig, list[Finding]]:
    """Applies the corrections of both cameras (right_camera.TERMS), except the right one's delay."""
    f, sigma, turns = rig.camera("right").fx, np.sqrt(np.diag(covariance)), [PITCH, YAW, ROLL]
    but_lag = np.arange(len(pair)) != LAG
    good = _significant(pair[but_lag], covariance[np.ix_(but_lag, but_lag)])
    findings = [Finding(f"left {name}", float(pair[i]), float(sigma[i]), "", good) for name, i in BOTH_RADIAL]
    findings += [
        Finding(f"right camera {TERMS[i]}", float(np.degrees(pair[i])), float(np.degrees(sigma[i])), "deg", good)
        for i in turns
    ]
    # In the middle of the image a rotation is part of the offset.
    for name, offset, turn, sign in (("x", OFFSET_X, YAW, 1.0), ("y", OFFSET_Y, PITCH, -1.0)):
        both = np.zeros(len(pair))
        both[[offset, turn]] = f, sign * f
        spread = float(np.sqrt(both @ covariance @ both))
        findings.append(Finding(f"right principal point {name}", float(both @ pair), spread, "px", good))
    findings.append(Finding("right focal length", float(100 * pair[FOCAL]), float(100 * sigma[FOCAL]), "%", good))
    findings += [Finding(f"right {TERMS[i]}", float(pair[i]), float(sigma[i]), "", good) for i in (K1, K2, P1, P2)]
    findings += [Finding(f"right {TERMS[i]}", float(pair[i]), float(sigma[i]), "", False) for i in (Q1, Q2)]
    findings += [
        Finding(f"baseline {TERMS[i]}", float(np.degrees(pair[i])), float(np.degrees(sigma[i])), "deg", good)
        for i in (DOWN, AHEAD)
    ]
    findings.append(Finding("right shutter late", float(1e3 * pair[LAG]), float(1e3 * sigma[LAG]), "ms", False))
    if not good:
        return rig, findings
    camera, both = rig.camera("right"), np.array([pair[BOTH_K1], pair[BOTH_K2], 0.0, 0.0])
    right = replace(
        camera,
        fx=float(camera.fx * (1 + pair[FOCAL])),
        fy=float(camera.fy * (1 + pair[FOCAL])),
        cx=camera.cx + float(f * (pair[OFFSET_X] + pair[YAW])),
        cy=camera.cy + float(f * (pair[OFFSET_Y] - pair[PITCH])),
        distortion=_distorted(camera, both + pair[[K1, K2, P1, P2]]),
    )
    left = replace(rig.camera("left"), distortion=_distorted(rig.camera("left"), both))
    moved = np.array([0.0, pair[DOWN], pair[AHEAD]]) * rig.baseline_m
    turn = Pose.from_rotvec(pair[turns], np.zeros(3))
    placed = Pose(translation=rig.rig_from_right.rotation @ moved) @ rig.rig_from_right @ turn
    return rig.changed(left=left, right=right, rig_from_right=placed, pair_sigma=None), findings


def _distorted(camera: Camera, lens: Array) -> tuple[float, ...]:
    """Returns its distortion with `lens` (4,) k1, k2, p1, p2 added."""
    coefficients = (*camera.distortion, *(0.0,) * max(0, 4 - len(camera.distortion)))
    return (*(float(a + b) for a, b in zip(coefficients, lens, strict=False)), *coefficients[4:])


def _placed(rig: Rig, change: Array, covariance: Array) -> tuple[Rig, list[Finding]]:
    """Moves the video camera on the rig by `change` (7,), the entry `rig` of Step.calibration."""
    sigma = np.sqrt(np.diag(covariance))
    findings = []
    turn, shift = np.zeros(3), np.zeros(3)
    for name, part, unit, factor in (("turned", slice(0, 3), "deg", 180 / np.pi), ("moved", slice(3, 6), "mm", 1e3)):
        if not (sigma[part] > 0).all():
            continue
        good = _significant(change[part], covariance[part, part])
        for axis, value, error in zip("xyz", change[part], sigma[part], strict=True):
            findings.append(Finding(f"video {name} {axis}", float(factor * value), float(factor * error), unit, good))
        if good and name == "turned":
            turn = change[part]
        elif good:
            shift = change[part]
    if sigma[6] > 0:
        findings.append(Finding("video clock late", float(1e3 * change[6]), float(1e3 * sigma[6]), "ms", False))
    placed = Pose(translation=shift) @ rig.rig_from_video @ Pose.from_rotvec(turn, np.zeros(3))
    return rig.changed(rig_from_video=placed), findings


def _significant(value: Array, covariance: Array) -> bool:
    """Returns whether a vector is significant: its mean squared Mahalanobis length exceeds MIN_SIGNIFICANCE squared."""
    return bool(value @ np.linalg.solve(covariance, value) > MIN_SIGNIFICANCE**2 * len(value))
