"""A calibration as JSON, for programs."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from types import MappingProxyType
from typing import Any

import numpy as np

from ispom.calibration.adjust.lens import model_of
from ispom.calibration.diagnostics import ImageMap
from ispom.calibration.result import Calibration, CameraResult, Views
from ispom.calibration.targets.target import Target
from ispom.geometry import Pose

from ...engine.outputs import json_text

JSON_HEAD = '"written_by": "ispom calibrate"'


def numbers_text(found: Calibration) -> str:
    """All of it; lengths in metres, angles in degrees where the name says so."""
    estimate, delay = found.solution.estimate, found.line_delay
    content: dict[str, Any] = {
        "written_by": "ispom calibrate",
        "verdict": found.verdict.level,
        "reasons": found.verdict.reasons,
        "film_next": found.verdict.advice,
        "target": found.target.spec,
        "reprojection_rms_px": found.solution.rms_px,
        "baseline_m": found.baseline_m,
        "row_error_rms_px": None if found.row_error is None else found.row_error.rms_px,
        "clock": None if found.clock is None else asdict(found.clock),
        "line_delay": None if delay is None else asdict(delay) | {"rolls": delay.rolls},
        "undetermined": [f"{p.camera}.{p.name}" for p in found.undetermined],
        "cameras": {each.views.name: _camera(found, each, c) for c, each in enumerate(found.cameras)},
        "camera_from_first": {
            each.views.name: _pose(pose) for each, pose in zip(found.cameras, estimate.camera_from_rig, strict=True)
        },
        "parameters": [
            {"camera": p.camera, "name": p.name, "value": p.value, "standard_error": p.standard_error,
             "determined": p.determined}
            for p in found.parameters
        ],
        "correlations": found.correlations.tolist(),
        "halves": None if found.halves_pose is None else _difference(found.halves_pose),
        "rejected": [
            {"camera": r.camera, "image": r.image, "point": r.point, "reason": r.reason} for r in found.rejected
        ],
    }  # fmt: skip
    return json_text(content, 1)


def redo_text(target: Target, views: tuple[Views, ...], reason: str) -> str:
    """Where nothing could be solved."""
    rejected = [
        {"camera": each.name, "image": image, "point": None, "reason": found.reason}
        for each in views
        for image, found in zip(each.images, each.detections, strict=True)
        if found.reason
    ]
    return failed_text(reason, {"target": target.spec, "rejected": rejected})


def failed_text(reason: str, more: Mapping[str, Any] = MappingProxyType({})) -> str:
    """Where nothing could be solved, for this reason."""
    content = {"written_by": "ispom calibrate", "verdict": "redo", "reasons": [reason], **more}
    return json.dumps(content, indent=1) + "\n"


def _camera(found: Calibration, each: CameraResult, c: int) -> dict[str, Any]:
    camera, solution = each.camera, found.solution
    mine = solution.seen.camera == c
    own = np.linalg.norm(solution.residuals_px[mine], axis=1)
    view = solution.seen.view[mine]
    errors = {
        each.views.images[found.image_of[v, c]]: float(np.sqrt((own[view == v] ** 2).mean())) for v in np.unique(view)
    }
    return {
        "model": model_of(camera), "width": camera.width, "height": camera.height,
        "fx": camera.fx, "fy": camera.fy, "cx": camera.cx, "cy": camera.cy, "distortion": camera.distortion,
        "models_held_out_px": {trial.model: trial.held_out_px for trial in each.trials},
        "models_fx": {trial.model: trial.camera.fx for trial in each.trials},
        "images": len(each.views.images), "images_used": len(errors),
        "detections": {
            image: {"ids": d.ids.tolist(), "uv": d.uv.tolist(), "sigma_px": d.sigma_px.tolist()}
            for image, d in zip(each.views.images, each.views.detections, strict=True)
            if not d.reason
        },
        "reprojection_rms_px": float(np.sqrt((own**2).mean())) if len(own) else None,
        "view_rms_px": errors, "covered": each.coverage.covered, "views_in_cells": each.coverage.counts.tolist(),
        "projection_uncertainty_px": _map(each.uncertainty), "halves_difference_px": _map(each.halves),
    }  # fmt: skip


def _map(found: ImageMap) -> dict[str, Any]:
    return {
        "u": found.uv[0, :, 0].tolist(), "v": found.uv[:, 0, 1].tolist(), "px": found.px.tolist(),
        "percentile_90": float(np.percentile(found.px, 90)),
    }  # fmt: skip


def _pose(pose: Pose) -> dict[str, Any]:
    return {"translation_m": pose.translation.tolist(), "rotation_xyzw": pose.xyzw.tolist()}


def _difference(pose: Pose) -> dict[str, float]:
    return {
        "translation_m": float(np.linalg.norm(pose.translation)),
        "rotation_deg": float(np.degrees(np.linalg.norm(pose.rotvec))),
    }
