"""The calibration page: images in, what was seen in them, and how good the calibration is."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from aiohttp import web

from ispom.calibration.filmed.simulated import truth_words
from ispom.calibration.result import Calibration, Rejected
from ispom.errors import InputError
from ispom.io.files import bounded
from ispom.sequences.policy import SourcePolicy
from ispom.types import Image

from ...engine.run_folder.thumbnail import jpeg
from ...session.session import Session
from ...views.web.files import NOT_KEPT, SECURITY, STATIC, found, number_of, send_file, send_json, send_one_of
from .job import CalibrationRequest, Job, Progress
from .kept import files_of, kept_in
from .report import camera_values
from .words import facts

DRAWINGS = {
    "residuals": "Residuals, 40 times as long",
    "uncertainty": "Standard deviation of projections",
    "coverage": "Views in each part of the image",
    "halves": "Two halves of the views against each other, 20 times as long",
    "points": "Points, coloured by residual",
    "tilts": "Tilt of the board: right and up to 60 degrees",
    "histogram": "Residuals: how many of each size",
}
"""Titles of drawings, by name."""


def shown(progress: Progress) -> dict[str, Any]:
    """All but the images and what was seen in each."""
    found = progress.found
    out: dict[str, Any] = {"number": progress.number, "doing": progress.doing, "fault": progress.fault}
    out["kept"] = progress.kept
    out["asked"] = vars(progress.request) if progress.request is not None else None
    out["cameras"] = [_camera(progress, each.name) for each in progress.views]
    if found is None:
        return out
    verdict = found.verdict
    out["verdict"] = {"level": verdict.level, "reasons": verdict.reasons, "advice": verdict.advice}
    out["facts"] = facts(found)
    out["truth"] = truth_words(found, progress.truth) if progress.truth is not None else []
    return out


def image_of(progress: Progress, camera: str, view: int) -> Image:
    """One of the images that were looked at; InputError where there is none."""
    for source in progress.sources:
        if source.camera == camera and 0 <= view < len(source):
            return source.read(view)
    raise InputError(f"there is no image {view} of {camera}: choose one of the list")


def seen_in(progress: Progress, camera: str, view: int) -> dict[str, Any]:
    """Points of one image: used ones as [u, v, residual u, v], others as [u, v]; why the image is not used."""
    each = next((v for v in progress.views if v.name == camera), None)
    if each is None or not 0 <= view < len(each.images):
        raise InputError(f"there is no image {view} of {camera}: choose one of the list")
    detection, found = each.detections[view], progress.found
    if found is None:
        return {"used": [], "others": detection.uv.tolist(), "reason": detection.reason}
    mine = _mine(found, camera, view)
    uv, residuals = found.solution.seen.uv[mine], found.solution.residuals_px[mine]
    others = detection.uv[~np.isin(detection.ids, found.solution.seen.point[mine])]
    reason = _reasons(found, camera).get(each.images[view], "")
    return {"used": np.hstack([uv, residuals]).tolist(), "others": others.tolist(), "reason": reason}


def _camera(progress: Progress, name: str) -> dict[str, Any]:
    each, found = next(v for v in progress.views if v.name == name), progress.found
    reasons = {i: d.reason for i, d in zip(each.images, each.detections, strict=True) if d.reason}
    out: dict[str, Any] = {"name": name, "size": each.size}
    rms: dict[int, float] = {}
    if found is not None:
        c = next(i for i, result in enumerate(found.cameras) if result.views.name == name)
        values = camera_values(found, found.cameras[c], c)
        out |= {key: values[key] for key in ("model", "used", "parameters")}
        out["drawings"] = [[title, str(values[key])] for key, title in DRAWINGS.items()]
        reasons = _reasons(found, name)
        for view in range(len(each.images)):
            mine = _mine(found, name, view)
            if mine.any():
                rms[view] = float(np.sqrt((found.solution.residuals_px[mine] ** 2).sum(1).mean()))
    out["views"] = [
        {"name": image, "points": len(each.detections[i]), "rms_px": rms.get(i), "reason": reasons.get(image, "")}
        for i, image in enumerate(each.images)
    ]
    return out


def _mine(found: Calibration, camera: str, view: int) -> np.ndarray:
    """(M,) which of the points in use are of this image."""
    c = next(i for i, result in enumerate(found.cameras) if result.views.name == camera)
    seen = found.solution.seen
    return (seen.camera == c) & (found.image_of[seen.view, c] == view)


def _reasons(found: Calibration, camera: str) -> dict[str, str]:
    whole: list[Rejected] = [r for r in found.rejected if r.camera == camera and r.point is None]
    return {r.image: r.reason for r in whole}


JPEG_QUALITY = 90
PAGE = STATIC / "calibration.html"


CALIBRATIONS = "calibrations"
"""Folder of the results of the calibration page, among the recordings."""


def routes(session: Session, may_drive: Callable[[web.Request], bool], base: str) -> list[web.RouteDef]:
    """Those of this feature, below the page's base. Nobody at the page looks outside of the session's folders."""

    def policy() -> SourcePolicy:
        return SourcePolicy(session.folders.root)

    job = Job(
        lambda path: policy().check(path), session.recordings_dir / CALIBRATIONS, lambda: bounded(policy().places)
    )
    return CalibrationPage(job, may_drive).at(base)


class CalibrationPage:
    """Its addresses. `may_drive` says whether who asks may start something."""

    def __init__(self, job: Job, may_drive: Callable[[web.Request], bool]) -> None:
        self._job, self._may_drive = job, may_drive

    def at(self, base: str) -> list[web.RouteDef]:
        """Below the page's base."""
        return [
            web.get(f"{base}calibration", self._page),
            web.get(f"{base}calibration/state", self._state),
            web.post(f"{base}calibration/start", self._start),
            web.get(f"{base}calibration/image", self._image),
            web.get(f"{base}calibration/seen", self._seen),
            web.get(f"{base}calibration/kept/{{name:.+}}", self._kept),
        ]

    async def _page(self, request: web.Request) -> web.StreamResponse:
        return await send_file(request, PAGE, SECURITY)

    async def _state(self, request: web.Request) -> web.StreamResponse:
        """`known=NUMBER:DOING` is what the page has: where nothing is new, nothing is sent again."""
        progress = self._job.progress
        if request.query.get("known", "") == _mark(progress.number, progress.doing):
            return web.Response(status=204, headers=SECURITY | NOT_KEPT)
        value = await asyncio.to_thread(shown, progress)
        stored = await asyncio.to_thread(lambda: [vars(each) for each in kept_in(self._folder)])
        return send_json(value | {"stored": stored, "known": _mark(progress.number, progress.doing)})

    @property
    def _folder(self) -> Path:
        if self._job.folder is None:
            raise web.HTTPNotFound(text="Calibrations of this page are not stored.")
        return self._job.folder

    async def _kept(self, request: web.Request) -> web.StreamResponse:
        names = await asyncio.to_thread(lambda: list(files_of(self._folder)))
        return await send_one_of(request, self._folder, names, SECURITY)

    async def _start(self, request: web.Request) -> web.StreamResponse:
        if not self._may_drive(request):
            raise web.HTTPForbidden(text="Onlookers change nothing.")
        # In the address: a body is taken from nobody.
        fields = {name: request.query.get(name, "") for name in ("what", "images", "target")}
        images = tuple(path.strip() for path in fields["images"].splitlines())
        calibration_request = CalibrationRequest(fields["what"], tuple(filter(None, images)), fields["target"])
        try:
            self._job.start(calibration_request)
        except InputError as fault:
            raise web.HTTPConflict(text=str(fault)) from fault
        return send_json({"number": self._job.progress.number})

    async def _image(self, request: web.Request) -> web.StreamResponse:
        camera, view = _which(request)
        image = await found(lambda: jpeg(image_of(self._job.progress, camera, view), JPEG_QUALITY))
        return web.Response(body=image, content_type="image/jpeg", headers=SECURITY | NOT_KEPT)

    async def _seen(self, request: web.Request) -> web.StreamResponse:
        camera, view = _which(request)
        return send_json(await found(lambda: seen_in(self._job.progress, camera, view)))


def _which(request: web.Request) -> tuple[str, int]:
    return request.query.get("camera", "")[:10], number_of(request, "view")


def _mark(number: int, doing: str) -> str:
    return f"{number}:{doing}"
