"""The Rerun web viewer out of the installed wheel: script and WebAssembly, read once, kept in the user's cache.

The wheel keeps both files as plain bytes within its compiled module, and gives them out by a server of its own only,
which listens to every machine of the network. So they are cut out of the module: nothing listens, nothing is started.

The documented way would be `WebViewer` of the npm package `@rerun-io/web-viewer`. `rerun-notebook` (0.41) has that
class in its script, and the same WebAssembly (67 MB with the names of functions), but exports a notebook's widget only,
which cannot change the layout or say what is shown. With that class this module and viewer_control.js can go.
"""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from importlib.metadata import version
from importlib.util import find_spec
from mmap import ACCESS_READ, mmap
from pathlib import Path

from ispom.caches import cache_folder

NAMES = ("re_viewer.js", "re_viewer_bg.wasm")
ORIGIN = "origin.txt"
"""In the cache: the module that the files come from. Without it they are nobody's, and are read again."""
SCRIPT = re.compile(
    rb"let wasm_bindgen = \(function\(exports\) \{\n.{100000,1000000}?\n\}\)\(\{ __proto__: null \}\);\n", re.S
)
MAGIC = b"\0asm\1\0\0\0"
LEAST_BYTES = 1 << 20
"""Of the viewer's WebAssembly; smaller modules are something else."""
_ORDER = {1: 1, 2: 2, 3: 3, 4: 4, 5: 5, 13: 6, 6: 7, 7: 8, 8: 9, 9: 10, 12: 11, 10: 12, 11: 13}
"""By number of a section of WebAssembly: its place among the others. Section 0 may be anywhere, and has a name."""


def viewer_assets(cache: Path | None = None) -> Path:
    """The folder that holds NAMES. OSError, one sentence, where the wheel lacks them, or they cannot be stored."""
    parent = cache or cache_folder("rerun-viewer")
    if parent is None:
        raise OSError("the Rerun viewer must be unpacked: make the home folder or the temporary one writable")
    folder, module = parent / version("rerun-sdk"), _module()
    origin = os.fsencode(f"{module} {module.stat().st_size} {module.stat().st_mtime_ns}\n")
    if not all((folder / name).is_file() for name in NAMES) or not _is_from(folder, origin):
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in zip(NAMES, _assets(module), strict=True):
            _store(content, folder / name)
        _store(origin, folder / ORIGIN)
    return folder


def _module() -> Path:
    """The compiled part of the wheel, which is not loaded for this."""
    spec = find_spec("rerun_bindings")
    for folder in (spec.submodule_search_locations or ()) if spec is not None else ():
        for path in sorted(Path(folder).glob("rerun_bindings*")):
            if path.suffix in (".so", ".pyd"):
                return path
    raise OSError("the Rerun viewer cannot be unpacked: rerun-sdk has no compiled module: install it again")


def _is_from(folder: Path, origin: bytes) -> bool:
    with suppress(OSError):
        return (folder / ORIGIN).read_bytes() == origin
    return False


def _assets(module: Path) -> tuple[bytes, bytes]:
    """Script and WebAssembly; OSError where the module has them in another form."""
    with module.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as content:
        script = SCRIPT.search(content)
        for start in _places(content, MAGIC):
            size = _wasm_size(content, start)
            if script is not None and size >= LEAST_BYTES:
                return script[0], content[start : start + size]
    raise OSError(
        f"the Rerun viewer cannot be unpacked: {module} does not hold it: install the rerun-sdk that is named"
    )


def _places(content: mmap, pattern: bytes) -> Iterator[int]:
    at = content.find(pattern)
    while at >= 0:
        yield at
        at = content.find(pattern, at + 1)


def _wasm_size(content: mmap, start: int) -> int:
    """Of the WebAssembly that begins there [bytes]: its header and all sections that follow each other in order."""
    end, last = start + len(MAGIC), 0
    while end < len(content):
        kind = content[end]
        size, body = _number(content, end + 1)
        if kind and not last < _ORDER.get(kind, 0):
            break
        if body + size > len(content) or (not kind and not _is_named(content, body, size)):
            break
        last = _ORDER[kind] if kind else last
        end = body + size
    return end - start


def _is_named(content: mmap, body: int, size: int) -> bool:
    length, name = _number(content, body)
    return 0 < length <= size - (name - body) and content[name : name + length].isascii()


def _number(content: mmap, at: int) -> tuple[int, int]:
    """A number of up to 32 bits (LEB128), and where what follows it begins."""
    value = 0
    for count, byte in enumerate(content[at : at + 5]):
        value |= (byte & 0x7F) << 7 * count
        if byte < 0x80:
            return value, at + count + 1
    return len(content), at  # no such number: longer than everything


def _store(content: bytes, path: Path) -> None:
    """In one move, so that another process never sees half a file."""
    with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
        file.write(content)
    os.replace(file.name, path)
