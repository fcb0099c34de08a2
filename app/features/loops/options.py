"""Options of `ispom loops`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from ispom.settings import Range

from ...engine.options import MovedSource, Options


@dataclass(frozen=True, kw_only=True)
class Loops(Options, MovedSource):
    """Lists every candidate of a loop closure, a join of segments or a relocalisation, with the rule that decided,
    and says what would have come of the opposite decision."""

    run: tyro.conf.Positional[str]
    """Folder that `ispom run` wrote, which is run again with its own settings; or any source, as for `ispom run`."""
    what_if: Annotated[tuple[str, ...], tyro.conf.arg(metavar="[FIRST-THEN[,FIRST-THEN...] ...]")] = ()
    """Run again from the frame before, with the opposite decision about this candidate, or about these together: their
    frames, counted from 0, as the list has them."""
    most: Annotated[int, Range(1, 200)] = 24
    """Largest number of candidates with images in the page. All are in loops.json."""
    out: Path = Path("loops")
    """Folder for index.html and loops.json."""
