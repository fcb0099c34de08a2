"""The Rerun web viewer out of the installed wheel: script and WebAssembly, read once, kept in the user's cache."""

from __future__ import annotations

import os
import socket
import sys
import tempfile
import time
import urllib.request
from importlib.metadata import version
from pathlib import Path

from ispom.caches import cache_folder
from ispom.child import Child

NAMES = ("re_viewer.js", "re_viewer_bg.wasm")
TIMEOUT_S = 30.0
SERVE = """
import sys, threading
import rerun
from ispom.child import end_with_parent
end_with_parent()
rerun.serve_web_viewer(web_port=int(sys.argv[1]), open_browser=False)
threading.Event().wait()
"""


def free_port(host: str = "127.0.0.1") -> int:
    """A port that nobody listens on at the moment."""
    with socket.socket() as probe:
        probe.bind((host, 0))
        return probe.getsockname()[1]


def viewer_assets(cache: Path | None = None) -> Path:
    """The folder that holds NAMES. OSError, one sentence, where the viewer does not start, or cannot be stored."""
    parent = cache or cache_folder("rerun-viewer")
    if parent is None:
        raise OSError("the Rerun viewer must be unpacked: make the home folder or the temporary one writable")
    folder = parent / version("rerun-sdk")
    if not all((folder / name).is_file() for name in NAMES):
        folder.mkdir(parents=True, exist_ok=True)
        _extract(folder)
    return folder


def _extract(folder: Path) -> None:
    """Has the wheel serve its viewer for a moment, in a process of its own: it keeps the files inside its module.

    Not by the wheel's program `rerun`: that loads libraries of the system (udev) that slim machines lack.
    """
    port = free_port()
    with tempfile.TemporaryDirectory() as home:
        # A home of its own: it never gets past its first session, which sends nothing.
        quiet = {"HOME": home, "XDG_CONFIG_HOME": home, "APPDATA": home, "TELEMETRY_ENABLED": "false"}
        server = Child([sys.executable, "-c", SERVE, str(port)], quiet)
        try:
            for name in NAMES:
                _store(_read(f"http://127.0.0.1:{port}/{name}", server), folder / name)
        finally:
            server.stop()


def _read(url: str, server: Child) -> bytes:
    until = time.monotonic() + TIMEOUT_S
    while True:
        try:
            return urllib.request.build_opener(urllib.request.ProxyHandler({})).open(url, timeout=TIMEOUT_S).read()
        except OSError as fault:
            if not server.running:
                raise OSError(f"the Rerun viewer cannot be unpacked: its process {server.ending()}") from fault
            if time.monotonic() > until:
                raise OSError(f"the Rerun viewer cannot be unpacked: no answer in {TIMEOUT_S:.0f} s") from fault
            time.sleep(0.05)


def _store(content: bytes, path: Path) -> None:
    """In one move, so that another process never sees half a file."""
    with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
        file.write(content)
    os.replace(file.name, path)
