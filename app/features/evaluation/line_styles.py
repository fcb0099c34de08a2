"""How each estimate is drawn: a file that is called like a method in that method's colour, others in other colours."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ispom.methods import names

from ...presentation.colours import Rgb, css, of

OTHERS: tuple[Rgb, ...] = ((230, 159, 0), (86, 180, 233), (140, 86, 75), (0, 0, 0), (170, 160, 40))
"""Of files that are called like no method: orange, sky blue, brown, black, mustard; none is a method's."""
DASHES: tuple[Any, ...] = ("solid", "dashed", "dotted", "dashdot")


@dataclass(frozen=True)
class LineStyle:
    colour: str
    """As CSS writes it."""
    dash: Any
    """As Matplotlib takes it."""

    @property
    def keywords(self) -> dict[str, Any]:
        """Of Matplotlib's `plot`."""
        return {"color": self.colour, "linestyle": self.dash}


def line_styles(paths: Sequence[Path]) -> list[LineStyle]:
    """One each, all different: where a colour is taken, the next kind of dashes."""
    used: Counter[Rgb] = Counter()
    found = []
    for path in paths:
        colour = of(path.stem) if path.stem in names() else min(OTHERS, key=lambda other: used[other])
        found.append(LineStyle(css(colour), _dash(used[colour])))
        used[colour] += 1
    return found


def _dash(n: int) -> Any:
    """From the fifth on: a long dash and n dots."""
    return DASHES[n] if n < len(DASHES) else (0, (8, 2, *(1, 2) * n))
