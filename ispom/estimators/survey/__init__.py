"""The methods of the paper's survey (Tables 1 to 3), a module each, which has a `METHOD`.

A `METHOD` is a Method, or a function without arguments that returns one.
"""

from __future__ import annotations

_NAMES = (
    "direct",
    "direct.monocular",
    "flow",
    "fused",
    "fused.stereo",
    "fused.tight",
    "hybrid",
    "hybrid.monocular",
    "lines",
    "lines.monocular",
    "multicamera",
    "panorama",
    "planar",
    "points",
    "sfm",
    "tags",
    "trifocal",
)
SURVEY = {name: f"{__name__}.{name.replace('.', '_')}:METHOD" for name in _NAMES}
"""Module and object of each method, such as `fused.tight` in `fused_tight.py`. They run only if they are chosen by
name."""
