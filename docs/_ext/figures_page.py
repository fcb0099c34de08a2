"""The page of the held figures: what each method reaches on each recording, from the file that the tests hold."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from markdown_text import table

FILE = Path(__file__).parents[2] / "tests" / "accuracy" / "figures.json"
PEERS = (
    (
        "ORB-SLAM3",
        "KITTI 06, the first 51 pairs, 59.9 m; a vocabulary trained on these images",
        "51 of 51",
        "82.3 mm and 82.6 mm, two runs",
        "`examples/orbslam3/README.md`",
    ),
    (
        "SVO",
        "handheld_board, the first 120 frames",
        "97 of 120",
        "0.72 mm, after a similarity",
        "`examples/svo/README.md`",
    ),
    ("COLMAP", "-", "not measured", "not measured", "-"),
)
"""Other programs: name, recording, frames localised, ATE, where the commands are."""
STILL = ("hard/bear_zoom", "hard/box_handheld", "hard/rollercoaster_pan", "hard/teddy_portrait")
INTRO = f"""# Figures of all recordings

One command measures them all, and writes the file that this page is made of:

```sh
python -m tests.accuracy figures --data FOLDER
```

Settings are the defaults, and failures are in the tables: a method that localised no frame has a row as well.

- "Located" counts frames that were localised when they came. "Segments" are parts of the path that no
  observation joins.
- The ATE is over all poses of the final trajectory, those of lost frames too, after SE(3) for methods in metres and
  after Sim(3) for the others. Its unit is that of the reference: metres where there is ground truth.
- "Per segment" is the ATE where each segment is aligned alone. A recording without a reference has no ATE.
- In {", ".join(f"`{name}`" for name in STILL)} the camera only zooms, only turns, or stands still before something that
  moves. Every map is false there: the fewer frames are located, the better.

[Protocol](protocol.md) names the parts of the recordings. All of them were looked at while the methods were written, so
the figures say nothing of other ones.

On another processor rounding differs, and with it the choice of a keyframe here and there. A test fails where a figure
grows by more than 30 %, which allows for that. Times depend on the machine, and are not shown: `ispom experiment speed`
measures them. The history of `tests/accuracy/figures.json` says when each figure changed."""
"""STILL is that of tests/accuracy/test_figures.py."""


def pages() -> dict[str, str]:
    """Returns the page."""
    text = [INTRO, "## Other programs", table(("program", "recording", "located", "ATE", "commands"), PEERS)]
    text.append("Whole data sets were run with none of these programs.")
    for name, methods in json.loads(FILE.read_text(encoding="utf-8")).items():
        rows = [(f"`{method}`", *_cells(figures)) for method, figures in methods.items()]
        text += [f"## {name}", table(("method", "located", "segments", "ATE", "% of the path", "per segment"), rows)]
    return {"evaluation/figures.md": "\n\n".join(text)}


def _cells(figures: dict[str, Any]) -> tuple[str, ...]:
    located = f"{figures['located']} of {figures['frames']}"
    if figures["located"] == 0:
        located = f"**none** of {figures['frames']}"
    errors = (figures.get(name) for name in ("ate", "ate_percent", "segment_ate"))
    return located, str(figures["segments"]), *("" if error is None else f"{error:.3g}" for error in errors)
