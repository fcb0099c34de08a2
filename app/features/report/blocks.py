"""What a report is made of, as plain values; templates/parts.html draws each kind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from ...presentation import colours


@dataclass(frozen=True)
class MethodName:
    """A cell: a method's name with its colour."""

    name: str

    @property
    def label(self) -> str:
        return self.name

    @property
    def colour(self) -> str:
        return colours.css(colours.of(self.name))


@dataclass(frozen=True)
class Compared:
    """A cell: a value compared with those of other runs."""

    value: Any
    difference: float | None = None
    """To the first run's; None where it is the first, or no number."""


@dataclass(frozen=True)
class Heading:
    kind: ClassVar = "heading"
    text: str


@dataclass(frozen=True)
class Paragraph:
    kind: ClassVar = "paragraph"
    text: str
    style: str = ""


@dataclass(frozen=True)
class Group:
    """A head over several columns."""

    head: Any
    span: int


@dataclass(frozen=True)
class Table:
    """Cells hold any plain value, MethodName or Compared; in numeric tables all columns but the first stand on the
    right."""

    kind: ClassVar = "table"
    head: Sequence[Any]
    rows: Sequence[Sequence[Any]]
    numeric: bool = True
    groups: Sequence[Group] = ()

    @property
    def starts(self) -> set[int]:
        """The columns at which a group begins."""
        found, column = set(), 0
        for group in self.groups:
            found.add(column)
            column += group.span
        return found


@dataclass(frozen=True)
class Details:
    """Blocks that a reader opens."""

    kind: ClassVar = "details"
    title: str
    blocks: Sequence[Block]


@dataclass(frozen=True)
class Grid:
    kind: ClassVar = "grid"
    blocks: Sequence[Block]


@dataclass(frozen=True)
class Plot:
    """A place for a figure."""

    kind: ClassVar = "plot"
    title: str
    note: str = ""
    figure: int | None = None
    """Index of the page's figures; None without data."""
    height: int = 0
    """[px]"""
    wide: bool = False


@dataclass(frozen=True)
class Shown:
    """A moment with its image as a data address, empty without one."""

    title: str
    why: Sequence[str]
    source: str


@dataclass(frozen=True)
class Moments:
    kind: ClassVar = "moments"
    moments: Sequence[Shown]


Block = Heading | Paragraph | Table | Details | Grid | Plot | Moments


@dataclass(frozen=True)
class Section:
    identity: str
    title: str
    blocks: Sequence[Block]
