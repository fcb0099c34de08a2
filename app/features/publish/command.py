"""`ispom publish`: reads finished runs, writes the folder, and says what takes how much of it."""

from __future__ import annotations

import math
import shlex
import sys
from collections.abc import Mapping
from pathlib import Path

from ispom.ensemble import build
from ispom.errors import InputError, printable
from ispom.io.files import expanded

from ...engine.outputs import claim_folder
from ...engine.playback import Builder
from ...views.web.rerun_assets import viewer_files
from .data import data_files
from .gallery.failures import failures_data
from .gallery.lessons import lessons_data, lessons_named
from .options import Publish
from .review import plain_name, require_run, reviewed
from .site import DATA, packed_viewer, page_files, write_site

COMMAND = "publish"
MB = 1e6
RUN_MB, LESSONS_MB, FAILURES_MB = 23.0, 80.0, 50.0
"""Usual limits of a folder: the Rerun viewer takes 17.5 MB of it. Lessons have some twenty runs of half-size images."""


def publish(options: Publish, builder: Builder = build) -> int:
    """Writes the folder; InputError where a folder holds no complete run with a recording, where runs are of different
    sources, where there is no such lesson, or where the folder cannot be as small as asked."""
    most_mb = options.max_mb if options.max_mb is not None else _usual_mb(options)
    if not 0 < most_mb < math.inf:
        raise InputError(f"--max-mb is {options.max_mb}: give a positive number of megabytes")
    out, most_bytes = expanded(options.out), most_mb * MB
    if options.lessons and options.failures:
        raise InputError("--lessons and --failures were given: publish each into a folder of its own")
    if options.failures:
        return _failures(options, out, most_bytes, builder)
    return _lessons(options, out, most_bytes, builder) if options.lessons else _runs(options, out, most_bytes)


def _usual_mb(options: Publish) -> float:
    return LESSONS_MB if options.lessons else FAILURES_MB if options.failures else RUN_MB


def _failures(options: Publish, out: Path, most_bytes: float, builder: Builder) -> int:
    if options.runs:
        raise InputError(f"--failures has runs of its own: leave out {options.runs[0]}")
    claim_folder(out, COMMAND)
    page = _page(1, "failures")
    _write(out, page, failures_data(builder, most_bytes - _size(page)))
    return 0


def _lessons(options: Publish, out: Path, most_bytes: float, builder: Builder) -> int:
    lessons = lessons_named(list(map(str, options.runs)))
    claim_folder(out, COMMAND)
    page = _page(1, "lessons")
    _write(out, page, lessons_data(lessons, builder, most_bytes - _size(page)))
    return 0


def _runs(options: Publish, out: Path, most_bytes: float) -> int:
    if not options.runs:
        raise InputError("no run was given: name one or more folders that `ispom run` wrote")
    folders = [expanded(folder) for folder in options.runs]
    for folder in folders:
        require_run(folder)
    claim_folder(out, COMMAND)
    with reviewed(folders, _names(folders)) as review:
        page = _page(len(folders))
        data, stage = data_files(review, folders, most_bytes - _size(page))
    _write(out, page, data, f"images ({stage.images})", stage.image_bytes)
    return 0


def _page(runs: int, site: str = "") -> dict[str, bytes]:
    try:
        return page_files(runs, site) | packed_viewer(viewer_files())
    except OSError as error:
        raise InputError(str(error)) from None


def _size(files: Mapping[str, bytes]) -> int:
    return sum(map(len, files.values()))


def _names(folders: list[Path]) -> list[str]:
    """The names of the folders, with a number where two have the same."""
    names = [plain_name(folder) for folder in folders]
    return [name if names.count(name) == 1 else f"{name} ({i + 1})" for i, name in enumerate(names)]


def _write(
    out: Path, page: Mapping[str, bytes], data: Mapping[str, bytes], images: str = "", image_bytes: int = 0
) -> None:
    """Writes the folder, and says what takes how much: the `images` apart, where they are known."""
    files = dict(page) | {f"{DATA}/{name}": content for name, content in data.items()}
    write_site(out, files)
    viewer = _size({name: content for name, content in page.items() if name.startswith("rerun/")})
    stages = _size({name: content for name, content in data.items() if name.endswith("stage.bin")})
    panels = _size({name: content for name, content in data.items() if "panels-" in name})
    total = _size(files)
    parts = {"Rerun viewer": viewer} | ({images: image_bytes} if images else {})
    parts |= {"tracks, paths, points" if images else "images, tracks, paths, points": stages - image_bytes}
    parts |= {"verdicts and checks": panels, "page, plots, events": total - viewer - stages - panels}
    lines = [f"  {count / MB:6.2f} MB  {name}" for name, count in parts.items()]
    sys.stdout.write(printable(f"{out} ({total / MB:.1f} MB, {len(files)} files)") + "\n" + "\n".join(lines) + "\n")
    sys.stdout.write(
        f"Look at it: python -m http.server --bind 127.0.0.1 --directory {printable(shlex.quote(str(out)))}\n"
    )
