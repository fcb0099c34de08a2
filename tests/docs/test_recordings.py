"""The recording in the repository is of this version: its viewer's, and with the names that methods have now."""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path

from rerun.chunk import RrdReader

from ispom.methods import BUILT_IN, names

DEMO = Path(__file__).parents[2] / "recordings" / "demo.rrd"
CURE = "run python -m tests.app.demo_recording"
OTHERS = {"truth", "view", "beside"}


def test_the_demo_is_of_the_viewer_that_is_installed() -> None:
    head = DEMO.read_bytes()[:8]
    major, minor, _ = map(int, version("rerun-sdk").split(".")[:3])
    assert head[:4] == b"RRF2" and tuple(head[4:6]) == (major, minor), CURE


def test_the_demo_has_the_names_of_today() -> None:
    paths = [str(chunk.entity_path) for chunk in RrdReader(DEMO).stream()]
    shown = {path.split("/")[2].replace("\\", "") for path in paths if path.startswith("/world/")} - OTHERS
    assert shown <= set(names()), CURE
    assert shown >= {name for name in BUILT_IN if not name.endswith(".paper")}, CURE
