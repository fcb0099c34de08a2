"""The addresses of the start screen, the runs table and the mode Compare: JSON and pictures."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

from aiohttp import web

from ispom.errors import InputError, is_text, printable
from ispom.io.files import bounded
from ispom.io.whole import whole_of

from ...engine.differences.compare import divergences
from ...engine.run_folder.run_file import read_run_file
from ...session.branches.service import BranchService
from ...session.branches.state import Branches
from ...session.session import Session
from ...session.state import State
from ...views.web.files import NOT_KEPT, SECURITY, found, number_of, send_json
from ..diff.command import differing, run_rows
from ..diff.text import shown
from ..lessons.library import Library
from ..lessons.state import Lessons
from ..recording.listing import list_unfinished
from .compare import comparison_message, divergence_message
from .folder import RecordedRuns
from .frame_picture import frame_picture
from .live import kept_rows, live_rows, merged
from .table import table_message

log = logging.getLogger(__name__)
WIDTHS = range(40, 641)
"""Possible widths of an image of a frame [px]."""
ROUNDING = 1e-9
"""As of a comparison of branches."""


def routes(session: Session, may_drive: Callable[[web.Request], bool], base: str) -> list[web.RouteDef]:
    """Those of this feature, below the page's base."""
    return RunsRoutes(session, may_drive).at(base)


class RunsRoutes:
    """`may_drive` says whether who asks may change the session: nobody else looks into folders."""

    def __init__(self, session: Session, may_drive: Callable[[web.Request], bool]) -> None:
        self._session, self._may_drive = session, may_drive
        self._recorded: RecordedRuns | None = None
        self._reading = asyncio.Lock()

    def at(self, base: str) -> list[web.RouteDef]:
        return [
            web.get(f"{base}runs", self._runs),
            web.get(f"{base}folders", self._folders),
            web.get(f"{base}frame", self._frame),
            web.get(f"{base}comparison", self._comparison),
            web.get(f"{base}differences", self._differences),
        ]

    async def _runs(self, request: web.Request) -> web.StreamResponse:
        """The runs table, the sources that were opened before, and the lessons with their progress."""
        session, state = self._session, self._session.state
        live = {} if state.covers else live_rows(state, session.service(BranchService).run_of, session.recordings_dir)
        async with self._reading:  # one thread at a time
            self._recorded = self._recorded or RecordedRuns(session.recordings_dir)
            recorded = await asyncio.to_thread(self._recorded.rows)
            unfinished = await asyncio.to_thread(_unfinished, session.recordings_dir)
        branches = session.service(BranchService)
        open_runs = [run for each in state[Branches].all if (run := branches.run_of(each.number)) is not None]
        kept = [] if state.covers else kept_rows(branches.kept, open_runs, session.recordings_dir)
        message = table_message(merged([*live.values(), *kept], recorded))
        return send_json(message | {"unfinished": unfinished, "recent": state.recent, "lessons": self._lessons(state)})

    def _lessons(self, state: State) -> list[dict[str, Any]]:
        return [
            {
                "name": lesson.name,
                "title": lesson.title,
                "minutes": lesson.minutes,
                "steps": len(lesson.steps),
                "done": min(state[Lessons].progress.get(lesson.name, 0), len(lesson.steps)),
            }
            for lesson in self._session.extra(Library).lessons
        ]

    async def _folders(self, request: web.Request) -> web.StreamResponse:
        """What can be opened in the folder `in`, or where the app was started."""
        if not self._may_drive(request):
            raise web.HTTPForbidden(text="Onlookers change nothing.")
        folder_path = request.query.get("in", "")
        return send_json(await found(lambda: self._entries(folder_path)))

    def _entries(self, folder_path: str) -> dict[str, Any]:
        folders = self._session.folders
        folder = Path(folder_path) if folder_path else folders.home
        if not folder.is_absolute() or "\0" in folder_path:
            raise InputError("give the whole path of a folder")
        above = folders.above(folder)
        entries = [{"name": e.path.name, "path": str(e.path), "source": e.source} for e in folders.entries(folder)]
        path = str(folder)
        return {"path": path if is_text(path) else "", "above": above and str(above), "entries": entries}

    async def _frame(self, request: web.Request) -> web.StreamResponse:
        """The image of a frame of a branch; without `at`, of the newest one."""
        if self._session.state.covers:
            raise web.HTTPForbidden(text="A question of the lesson is open.")
        branch, width = number_of(request, "branch", 0), number_of(request, "width", WIDTHS.stop - 1)
        branches, group = self._session.service(BranchService), number_of(request, "kept", 0)
        runs = next((each.runs for each in branches.kept if each.number == group), {})
        run = runs.get(branch) if group else branches.run_of(branch)
        if run is None or width not in WIDTHS:
            raise web.HTTPNotFound
        at = number_of(request, "at", len(run.history) - 1)
        method = request.query.get("method", "")
        content = await asyncio.to_thread(frame_picture, run, at, method if method in run.opened.methods else "", width)
        if content is None:
            raise web.HTTPNotFound
        return web.Response(body=content, content_type="image/jpeg", headers=SECURITY | NOT_KEPT)

    async def _comparison(self, request: web.Request) -> web.StreamResponse:
        """Of the two branches that the session compares."""
        session, state = self._session, self._session.state
        compared = state[Branches].comparison
        if compared is None or state.covers:
            raise web.HTTPNotFound
        run_of = session.service(BranchService).run_of
        rows = live_rows(state, run_of, session.recordings_dir)
        return send_json(await asyncio.to_thread(comparison_message, state, compared, rows, run_of))

    async def _differences(self, request: web.Request) -> web.StreamResponse:
        """Of two runs of the recordings folder, which need not be of one source: as `ispom diff` finds them."""
        pair = request.query.get("a", ""), request.query.get("b", "")
        return send_json(await found(lambda: self._diff(*pair)))

    def _diff(self, a: str, b: str) -> dict[str, Any]:
        folder = self._session.recordings_dir
        known = self._recorded.known if self._recorded is not None else frozenset[str]()
        if not {a, b} <= known:
            raise InputError("only runs of the recordings folder can be on different sources: choose two on one source")
        with bounded((folder,)):
            runs = read_run_file(folder / a), read_run_file(folder / b)
            methods = tuple(method for method in runs[0].config if method in runs[1].config)
            settings = differing(*runs, methods)
            with run_rows(folder / a) as left, run_rows(folder / b) as right:
                first = next(divergences(left, right, methods, ROUNDING), None) if methods else None
        return {
            "settings": [{"name": each.name, "a": shown(each.a, 6), "b": shown(each.b, 6)} for each in settings],
            "first": None if first is None else divergence_message(first),
            "methods": methods,
        }


def _unfinished(folder: Path) -> list[str]:
    """The names of runs and recordings that a stopped program left unfinished."""
    try:
        return [printable(whole_of(path).name) for path in list_unfinished(folder)]
    except OSError as fault:
        log.warning("unfinished recordings cannot be listed: %s", fault)
        return []
