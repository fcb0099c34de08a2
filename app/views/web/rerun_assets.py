"""The Rerun web viewer: its script and WebAssembly, which `rerun-notebook` ships.

The package is installed and never imported: that would start what a notebook needs. Two pieces of its script are other
ones here, for there is no documented way:

- It holds the documented class `WebViewer`, and exports a notebook's widget only. One line exports the class, too.
- It fetches its WebAssembly as it is. The page fetches it (`wasm` of static/rerun.js): it shows how much has come, and
  unpacks that of a published page. The package marks the place, where it puts other lines itself for a notebook that
  has its WebAssembly inside.

The npm package `@rerun-io/web-viewer` has the class as a module, but Python packages cannot depend on it.
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

SCRIPT, WASM = "viewer.js", "re_viewer_bg.wasm"
"""Names under which the page asks for them."""
_WIDGET = "widget.js"
_MARKS = b"//!<INLINE-MARKER-OPEN>", b"//!<INLINE-MARKER-CLOSE>"
_FETCH = b'\nreturn (await import("../web/rerun.js")).wasm();\n'
_EXPORT = b"export { WebViewer };\n"


class ViewerFiles(NamedTuple):
    script: bytes
    """A module with the class `WebViewer`."""
    wasm: Path


def viewer_files() -> ViewerFiles:
    """The viewer's files. OSError, one sentence, where they are not there."""
    return files_in(_folder())


def files_in(folder: Path) -> ViewerFiles:
    """Those in this folder of the package. OSError, one sentence, where they have another form."""
    before, opened, rest = (folder / _WIDGET).read_bytes().partition(_MARKS[0])
    _, closed, after = rest.partition(_MARKS[1])
    if not (opened and closed and b"\nvar WebViewer = class" in after and (folder / WASM).is_file()):
        raise OSError(f"{folder} does not hold the Rerun viewer: install the rerun-notebook that is named")
    return ViewerFiles(before + _FETCH + after + _EXPORT, folder / WASM)


def _folder() -> Path:
    spec = find_spec("rerun_notebook")
    for folder in (spec.submodule_search_locations or ()) if spec is not None else ():
        return Path(folder) / "static"
    raise OSError("the Rerun viewer is not there: install rerun-notebook")
