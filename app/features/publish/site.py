"""The files of a published folder: the page of `ispom app` with its scripts, the Rerun viewer, and the run's data.

    index.html   web/      the page, which knows by `data-published` that it has no server
    panels/                components of the left pane
    rerun/                 the viewer; its WebAssembly is compressed, and the page unpacks it
    data/run.bin           messages of the session (messages.py), JSON
    data/panels-N.bin      what the left pane says (panels.py), JSON
    data/stage.bin         what Rerun draws (stage.py)
    data/numbers.bin       all quantities over the frames, JSON
    data/comparisons.bin   of the first run with each of the others

Of lessons each run has a folder of its own in `data`; gallery/lessons.py says what else there is.

What is compressed is called .bin and not .gz: some servers would unpack that, and a browser would not be told.
"""

from __future__ import annotations

import gzip
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ispom.errors import InputError
from ispom.io.files import read_bytes
from ispom.io.whole import require_no_links, write_whole

from ...views.web.files import SECURITY, STATIC
from ...views.web.rerun_assets import SCRIPT, WASM, ViewerFiles
from ...views.web.view_values import scripts

LEFT_OUT = frozenset({"calibration.html", "calibration.js", "calibration.css"})
"""Files of the page that need a server."""
TYPES = ".d.ts"
"""How files end that only a type checker reads."""
WASM_BYTES = 256 << 20
"""More than any viewer's."""
DATA = "data"
WAITING = "The Rerun viewer starts when a source is open."
OPENED_AS_FILE = "Loading the run. Opened as a file this page stays empty: a web server must show its folder."


def page_files(runs: int, site: str = "") -> dict[str, bytes]:
    """Returns the page and its scripts, by name. `runs`: number of runs that are compared; `site`: what the page lists
    where it has many pages in one, as lessons."""
    found = {}
    for path in sorted(STATIC.iterdir()):
        if path.name == "index.html":
            found["index.html"] = published_page(path.read_text(encoding="utf-8"), runs, site).encode()
        elif path.name not in LEFT_OUT and not path.name.endswith(TYPES):
            found[f"web/{path.name}"] = path.read_bytes()
    return found | {f"panels/{name}": path.read_bytes() for name, path in scripts().items()}


def published_page(html: str, runs: int, site: str = "") -> str:
    """The page without a server: it says so, and the browser lets it speak to its own folder only."""
    policy = "; ".join(
        part for part in SECURITY["Content-Security-Policy"].split("; ") if not part.startswith("frame-ancestors")
    )
    head = [f'<meta http-equiv="Content-Security-Policy" content="{policy}" />']
    head += ['<meta name="referrer" content="no-referrer" />']
    marks = ('<html lang="en">', '<meta charset="utf-8" />')
    if not all(html.count(mark) == 1 for mark in marks):
        raise ValueError("the page has another head than this expects")
    listed = f' data-site="{site}"' if site else ""
    html = html.replace(WAITING, OPENED_AS_FILE).replace(
        marks[0], f'<html lang="en" data-published="{DATA}" data-runs="{runs}"{listed}>'
    )
    return html.replace(marks[1], "\n    ".join((marks[1], *head)))


def packed_viewer(viewer: ViewerFiles) -> dict[str, bytes]:
    """The Rerun viewer: its script, and its WebAssembly compressed."""
    wasm = gzip.compress(read_bytes(viewer.wasm, WASM_BYTES), 9, mtime=0)
    return {f"rerun/{SCRIPT}": viewer.script, f"rerun/{WASM}.bin": wasm}


def packed(value: Any) -> bytes:
    """JSON, compressed. Numbers that are not finite are null."""
    text = json.dumps(value, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return gzip.compress(text.encode("utf-8", errors="replace"), 9, mtime=0)


def write_site(folder: Path, files: Mapping[str, bytes]) -> None:
    """Writes the files, and removes those of an earlier run of the command that are not among them. InputError where a
    link is in the way, or the disk does not take them."""
    for name, content in files.items():
        require_no_links(folder, folder / name)
        write_whole(folder / name, content)
    data = folder / DATA
    try:
        for path in data.rglob("*.bin"):
            if path.relative_to(folder).as_posix() not in files:
                path.unlink()
        for path in data.iterdir():
            if path.is_dir() and not any(path.iterdir()):
                path.rmdir()
    except OSError as error:
        raise InputError(f"{data} cannot be read ({error.strerror}): give a new folder") from None
