"""The files that are served, by name: no part of an address ever becomes a path."""

from __future__ import annotations

import asyncio
from collections.abc import Iterable
from pathlib import Path

from aiohttp import web

from ...engine.run_folder.run_folder import THUMBNAIL

SEND_S = 1800.0
"""For a reader to take a file: 43 MB at 24 kB/s."""
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
VISER_SECURITY = SECURITY | {
    "Content-Security-Policy": "default-src 'self' 'unsafe-inline' 'unsafe-eval' blob: data:; object-src 'none'; "
    "base-uri 'none'; frame-ancestors 'self'"
}


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
