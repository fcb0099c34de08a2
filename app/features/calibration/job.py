"""A calibration in the background, for a page: what it is doing, and what it found."""

from __future__ import annotations

import logging
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Lock, Thread

from ispom.calibration.calibrate import calibrate
from ispom.calibration.filmed.choose import best_frames
from ispom.calibration.filmed.detecting import detected, moving_views, require_target
from ispom.calibration.filmed.images import CAMERAS, Source, open_sources, paired
from ispom.calibration.filmed.simulated import is_simulated, simulated
from ispom.calibration.result import Calibration, Redo, Views
from ispom.calibration.targets.layouts import parse_target
from ispom.errors import InputError
from ispom.types import Image, Rig

from .kept import keep

log = logging.getLogger(__name__)
MOST_VIEWS = 60


@dataclass(frozen=True)
class CalibrationRequest:
    """The fields of the form: what is to be calibrated."""

    what: str
    images: tuple[str, ...]
    target: str


@dataclass(frozen=True, eq=False)
class Progress:
    """The state of a calibration."""

    number: int = 0
    """Counts calibrations; 0 before the first."""
    request: CalibrationRequest | None = None
    doing: str = ""
    """Empty once it is over."""
    sources: tuple[Source, ...] = ()
    """The images that were looked at, by camera."""
    views: tuple[Views, ...] = ()
    """What was detected in them, in the order of the sources."""
    found: Calibration | None = None
    truth: Rig | None = None
    """Of a simulation."""
    kept: str = ""
    """Under which name the result was written."""
    fault: str = ""
    """Why there is no result, one sentence."""


class Job:
    """One calibration at a time; the newest counts."""

    def __init__(
        self,
        check: Callable[[str], None] = lambda _: None,
        folder: Path | None = None,
        bounds: Callable[[], AbstractContextManager[None]] = nullcontext,
    ) -> None:
        """`check` raises InputError for a path that may not be opened; results are written below the folder.

        The images are read within `bounds`: no link inside such a path leads out of what is allowed.
        """
        self._check, self.folder, self._lock, self.progress = check, folder, Lock(), Progress()
        self._bounds = bounds
        self._thread: Thread | None = None

    def start(self, request: CalibrationRequest) -> None:
        """InputError where another one is at work."""
        with self._lock:
            if self._thread is not None and self._thread.is_alive():
                raise InputError("a calibration is at work: wait for its end")
            self.progress = Progress(self.progress.number + 1, request, "opening the images")
            self._thread = Thread(target=self._run, args=(request,), name="calibration", daemon=True)
            self._thread.start()

    def wait(self, timeout_s: float) -> None:
        if self._thread is not None:
            self._thread.join(timeout_s)

    def _run(self, request: CalibrationRequest) -> None:
        try:
            with self._bounds():
                self._calibrate(request)
        except (InputError, Redo) as fault:
            self._update(fault=str(fault))
        except Exception as fault:
            log.exception("the calibration failed")
            self._update(fault=f"internal fault, please report it: {type(fault).__name__}: {fault}")
        finally:
            self._update(doing="")

    def _calibrate(self, request: CalibrationRequest) -> None:
        """As `ispom calibrate`."""
        if request.what not in CAMERAS:
            raise InputError(f"{request.what[:40]!r} cannot be calibrated: choose one of {', '.join(CAMERAS)}")
        target = parse_target(request.target)
        given = tuple(Path(text) for text in request.images)
        if is_simulated(given):
            made = simulated(request.what, given[0], target)
            sources = made.sources
            self._update(truth=made.truth)
        else:
            for text in request.images:
                self._check(text)
            sources = tuple(self._bounded(source) for source in open_sources(request.what, given))
        self._update(doing="choosing images")
        given = paired(sources)
        index = best_frames(given[0], MOST_VIEWS)
        sources = tuple(source.select(index) for source in given)
        self._update(doing=f"detecting the target in {sum(map(len, sources))} images", sources=sources)
        views = detected(target, sources)
        self._update(views=views)
        require_target(target, sources, views)
        order = sorted(views, key=lambda each: each.name == "video")
        neighbours = moving_views(target, given, sources)
        found = calibrate(target, tuple(order), progress=lambda doing: self._update(doing=doing), around=neighbours)
        self._update(found=found)
        if self.folder is not None:
            self._update(kept=keep(found, self.folder))

    def _bounded(self, source: Source) -> Source:
        """The same images, read within the bounds in whatever thread."""

        def read(i: int) -> Image:
            with self._bounds():
                return source.read(i)

        return replace(source, read=read)

    def _update(self, **values: object) -> None:
        self.progress = replace(self.progress, **values)  # type: ignore[arg-type]
