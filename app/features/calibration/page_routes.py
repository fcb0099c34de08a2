"""The calibration page: images in, what was seen in them, and how good the calibration is."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path

from aiohttp import web

from ispom.errors import InputError

from ...engine.run_folder.thumbnail import jpeg
from ...views.web.files import NOT_KEPT, SECURITY, STATIC, found, number_of, send_file, send_json, send_one_of
from .job import Asked, Job
from .kept import files_of, kept_in
from .shown import image_of, seen_in, shown

JPEG_QUALITY = 90
PAGE = STATIC / "calibration.html"


class CalibrationPage:
    """Its addresses. `may_drive` says whether who asks may start something."""

    def __init__(self, job: Job, may_drive: Callable[[web.Request], bool]) -> None:
        self._job, self._may_drive = job, may_drive

    def routes(self, base: str) -> list[web.RouteDef]:
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
        assert self._job.folder is not None
        return self._job.folder

    async def _kept(self, request: web.Request) -> web.StreamResponse:
        names = await asyncio.to_thread(lambda: list(files_of(self._folder)))
        return await send_one_of(request, self._folder, names, SECURITY)

    async def _start(self, request: web.Request) -> web.StreamResponse:
        if not self._may_drive(request):
            raise web.HTTPForbidden(text="Onlookers change nothing.")
        # In the address: a body is taken from nobody.
        given = {name: request.query.get(name, "") for name in ("what", "images", "target")}
        images = tuple(path.strip() for path in given["images"].splitlines())
        asked = Asked(given["what"], tuple(filter(None, images)), given["target"])
        try:
            self._job.start(asked)
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
