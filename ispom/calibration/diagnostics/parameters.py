"""Parameters with their standard errors and correlations; those that the views do not determine, by name."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ispom.calibration.adjust.lens import model_of, parameter_names, vector_of
from ispom.calibration.adjust.solve import Solution
from ispom.geometry import Array

FOCAL_SHARE, CENTRE_SHARE = 0.02, 0.03
"""A focal length uncertain by more than this share of itself is not determined, a principal point of the width;"""
BASELINE_SHARE, ROTATION_RAD = 0.05, np.radians(0.5)
"""a pose on the rig where its place is by this share of its distance (of 0.1 m at least), or its rotation."""
LEAST_BASELINE_M = 0.1


@dataclass(frozen=True)
class Parameter:
    """One number of the calibration."""

    camera: str
    name: str
    """fx, fy, cx, cy [px], k1, ..., or x, y, z [m] and roll, pitch, yaw: the pose's own left twist [rad]."""
    value: float
    standard_error: float
    """Infinite where the views do not determine it at all."""
    determined: bool


def parameters(solution: Solution, names: tuple[str, ...]) -> tuple[Parameter, ...]:
    """All that the cameras share, in the order of the solution's covariance."""
    errors = np.sqrt(np.maximum(np.diag(solution.covariance), 0)) if len(solution.covariance) else np.zeros(0)
    out: list[Parameter] = []
    for c, (interior, pose) in enumerate(solution.unknowns.places):
        camera = solution.estimate.cameras[c]
        free = solution.unknowns.interior[c]
        labels = np.array(parameter_names(model_of(camera)))[free]
        for label, value, error in zip(labels, vector_of(camera)[free], errors[interior], strict=True):
            limit = FOCAL_SHARE * abs(value) if label in ("fx", "fy") else CENTRE_SHARE * camera.width
            good = bool(np.isfinite(error) and (error <= limit or label not in ("fx", "fy", "cx", "cy")))
            out.append(Parameter(names[c], str(label), float(value), float(error), good))
        if solution.unknowns.pose[c]:
            out += _pose_parameters(solution, c, names[c], errors[pose])
    return tuple(out)


def correlations(solution: Solution) -> Array:
    """(G, G), 0 where a parameter is not determined."""
    errors = np.sqrt(np.maximum(np.diag(solution.covariance), 0))
    good = np.isfinite(errors) & (errors > 0)
    out = np.zeros_like(solution.covariance)
    inside = np.ix_(good, good)
    out[inside] = solution.covariance[inside] / np.outer(errors[good], errors[good])
    np.fill_diagonal(out, 1.0)
    return out


def _pose_parameters(solution: Solution, c: int, name: str, errors: Array) -> list[Parameter]:
    pose = solution.estimate.camera_from_rig[c]
    away = max(LEAST_BASELINE_M, float(np.linalg.norm(pose.translation)))
    labels = ("x", "y", "z", "roll", "pitch", "yaw")
    values = np.concatenate([pose.translation, pose.rotvec])
    limits = [BASELINE_SHARE * away] * 3 + [float(ROTATION_RAD)] * 3
    return [
        Parameter(name, label, float(value), float(error), bool(np.isfinite(error) and error <= limit))
        for label, value, error, limit in zip(labels, values, errors, limits, strict=True)
    ]
