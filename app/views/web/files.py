"""The files that are served, by name: no part of an address ever becomes a path."""

from __future__ import annotations

import asyncio
import hashlib
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TypeVar

from aiohttp import web

from ispom.errors import InputError

from ...engine.run_folder.run_folder import THUMBNAIL

T = TypeVar("T")
SEND_S = 1800.0
"""For a reader to take a file: 67 MB at 37 kB/s."""
STATIC = Path(__file__).parent / "static"
SECURITY = {
    "Content-Security-Policy": "default-src 'self'; script-src 'self' 'wasm-unsafe-eval'; "
    "style-src 'self' 'unsafe-inline'; connect-src 'self' blob: data:; img-src 'self' blob: data:; "
    "font-src 'self' data:; worker-src 'self' blob:; object-src 'none'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'self'",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cross-Origin-Resource-Policy": "same-origin",
}
"""The page may speak to its own server only."""
NOT_KEPT = {"Cache-Control": "no-store"}
VISER_SECURITY = SECURITY | {
    "Content-Security-Policy": "default-src 'self' 'unsafe-inline' 'unsafe-eval' blob: data:; object-src 'none'; "
    "base-uri 'none'; frame-ancestors 'self'"
}


def send_json(value: object) -> web.Response:
    return web.json_response(value, headers=SECURITY | NOT_KEPT)


async def found(look: Callable[[], T]) -> T:
    """What a look into files gives; 404 with its sentence for an InputError."""
    try:
        return await asyncio.to_thread(look)
    except InputError as fault:
        raise web.HTTPNotFound(text=str(fault)) from fault


def number_of(request: web.Request, name: str, usual: int | None = None) -> int:
    """A parameter of the address; 400 where it is no number, or missing without a `usual` one."""
    text = request.query.get(name, "")
    if not text and usual is not None:
        return usual
    if not (text.isascii() and text.isdigit() and len(text) <= 9):
        raise web.HTTPBadRequest(text=f"{name} is a number.")
    return int(text)


async def send_one_of(
    request: web.Request, folder: Path, names: Iterable[str], headers: dict[str, str]
) -> web.StreamResponse:
    """The file in the folder that the address names; 404 for what is not among the names, or leads elsewhere.

    Browsers ask each time whether it has changed: an upgrade never leaves them with an old file.
    """
    name = next((name for name in names if name == request.match_info["name"]), None)
    path = folder / name if name is not None else None
    if path is None or not path.is_file() or not path.resolve().is_relative_to(folder.resolve()):
        raise web.HTTPNotFound
    return await send_file(request, path, headers)


def send_script(request: web.Request, content: bytes, headers: dict[str, str]) -> web.Response:
    """The script, or that it is still the one that the browser has."""
    tag = hashlib.sha256(content).hexdigest()[:32]
    headers = {"Cache-Control": "no-cache", "ETag": f'"{tag}"'} | headers
    if any(each.value == tag for each in request.if_none_match or ()):
        return web.Response(status=304, headers=headers)
    return web.Response(body=content, content_type="text/javascript", headers=headers)


async def send_file(
    request: web.Request, path: Path, headers: dict[str, str], cookies: Iterable[str] = ()
) -> web.StreamResponse:
    """The file, as fast as the reader takes it; a reader that takes too long is cut off."""
    response = web.FileResponse(path, headers={"Cache-Control": "no-cache"} | headers)
    for cookie in cookies:
        response.headers.add("Set-Cookie", cookie)
    try:
        async with asyncio.timeout(SEND_S):
            await response.prepare(request)
    except TimeoutError:
        if request.transport is not None:
            request.transport.abort()
    return response


def recordings(folder: Path) -> Iterable[str]:
    """The finished recordings in the folder and below it, as addresses name them."""
    return (path.relative_to(folder).as_posix() for path in folder.glob("**/*.rrd") if not path.name.startswith("."))


def pictures(folder: Path) -> Iterable[str]:
    """Those of the runs and recordings in the folder and below it, as addresses name them; no other images."""
    for path in folder.glob("**/*.jpg"):
        if not path.name.startswith(".") and (path.name == THUMBNAIL or path.with_suffix(".rrd").exists()):
            yield path.relative_to(folder).as_posix()
