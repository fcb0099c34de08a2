"""What an experiment is: its runs, and the statements about their results."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import PurePath
from typing import Annotated, Literal

import msgspec

from ispom.io.values import LARGEST
from ispom.methods import Config

from ...presentation.colours import METHOD, OTHERS, css
from ...presentation.texts import METRE, Unit

Value = bool | int | float | str
Finite = Annotated[float, msgspec.Meta(ge=-LARGEST, le=LARGEST)]
InPicture = Annotated[float, msgspec.Meta(ge=-1000, le=1000)]
"""A place, length or angle [degrees] in a picture of 100 x 60."""
FailureKind = Literal["no motion", "lost"]
"""How a run may fail that did what it could: `no motion`, no method found any; `lost`, too few frames are located for
the quantity."""
COVERAGE = "located_percent"
"""Stands beside every error."""
LEAST_LOCATED_PERCENT = 50.0
"""Share of its frames [%] that a method must locate: of fewer its results say little."""
MEASURED = ("cpu_ms", "cpu_ms_p95", "peak_memory_mb")
"""Quantities of the machine that computes: they stand in the results of a plan that names them, and in times.csv."""
COUNTS = frozenset({"rate_hz", "poses", "located", COVERAGE, "lost", "segments", "path_length_m", *MEASURED})
"""Quantities that tell themselves how much was located, or that do not depend on it."""


@dataclass(frozen=True)
class Line:
    """A method with its settings: a line in the figures, a row in the tables."""

    name: str
    method: str
    settings: tuple[tuple[str, Value], ...] = ()
    """(METHOD.SETTING, value) of those that are not the default: of the method, or of one that it asks."""
    note: str = ""
    sources: tuple[str, ...] = ()
    """Those of the plan's that it runs on; empty: all."""

    def runs_on(self, source: str) -> bool:
        return not self.sources or source in self.sources


class Statement(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the plan claims of a line: that a quantity is within bounds in a share of its runs."""

    text: str
    quantity: str
    line: str
    source: str | None = None
    """Of this source's runs only."""
    over_line: str | None = None
    """The quantity divided by that of this line, on the same source (or `over_source`) and seed."""
    over_source: str | None = None
    at_most: Finite | None = None
    at_least: Finite | None = None
    or_fails: tuple[FailureKind, ...] = ()
    """Kinds of failure that count as holding. With any other failure the run could not test it."""
    share: Annotated[float, msgspec.Meta(ge=0, le=1)] = 1.0
    """Of the runs, 0..1, in which it must hold."""
    least_located_percent: Annotated[float, msgspec.Meta(ge=0, le=100)] = LEAST_LOCATED_PERCENT
    """Share of the frames that must be located [%] where the quantity is an error or a scale: one of fewer frames says
    little of the method."""

    @property
    def needs_coverage(self) -> bool:
        """Whether the quantity is an error or a scale, of the frames that are located only."""
        return self.quantity not in COUNTS


class Field(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A field of research as an ellipse, as in Fig. 1 of the paper."""

    name: str
    line: str
    """To which the ellipse is a link."""
    ellipse: tuple[InPicture, InPicture, InPicture, InPicture, InPicture]
    """Centre and half axes in a picture of 100 x 60, and how far it is turned clockwise [degrees]."""
    label: tuple[InPicture, InPicture]
    """Where the name is written."""


@dataclass(frozen=True)
class Run:
    """One run: a line on a source with a seed."""

    line: Line
    source: str
    seed: int

    @property
    def folder(self) -> PurePath:
        """Within that of the experiment."""
        place = self.source if self.source.startswith("sim:") else PurePath(self.source).name
        return PurePath("runs") / _plain(self.line.name) / f"{_plain(place)}-seed-{self.seed}"

    def __str__(self) -> str:
        return f"{self.line.name}, {self.source} seed {self.seed}"


@dataclass(frozen=True)
class Plan:
    """Every line on every source with every seed."""

    name: str
    title: str
    sources: tuple[str, ...]
    seeds: tuple[int, ...]
    lines: tuple[Line, ...]
    note: str = ""
    quantities: tuple[str, ...] = ("ate_m", "t_err_percent", "rpe_m", "rpe_deg")
    """Keys of metrics.json, and those of `results.derived`: what is tabled and drawn."""
    statements: tuple[Statement, ...] = ()
    stereo_every: int = 1
    video_scale: float = 1.0
    max_exposures: int | None = None
    fields: tuple[Field, ...] = ()
    """Drawn at the top of the page; none: no such picture."""

    def runs(self) -> Iterator[Run]:
        """By source and seed: those on the same images follow each other."""
        for source in self.sources:
            for seed in self.seeds if source.startswith("sim:") else self.seeds[:1]:
                yield from (Run(line, source, seed) for line in self.lines if line.runs_on(source))

    def line(self, name: str) -> Line:
        return next(line for line in self.lines if line.name == name)


def config_of(line: Line) -> Config:
    """The settings of all methods; those of the line are known to be right."""
    config = Config()
    for key, value in line.settings:
        method, _, setting = key.rpartition(".")
        config = config.with_settings(method, replace(config.of(method), **{setting: value}))
    return config


def _plain(name: str) -> str:
    return re.sub(r"[^\w.-]+", "-", name).strip("-.") or "run"


LABELS = {
    "ate_m": "ATE [m]",
    "ate_percent": "ATE [% of path]",
    "t_err_percent": "drift [%]",
    "r_err_deg_per_100m": "drift [deg/100 m]",
    "rpe_m": "RPE [m]",
    "rpe_deg": "RPE [deg]",
    "step_scale_end_over_start": "step scale, end over start",
    "between_stereo_rmse_m": "between stereo, RMSE [m]",
    "spline_between_stereo_rmse_m": "spline between stereo, RMSE [m]",
    "between_over_spline": "between stereo, over spline's",
    "m_per_unit": "metres per unit (sim3)",
    "rate_hz": "poses [Hz]",
    "poses": "poses",
    "located": "frames located",
    "located_percent": "frames located [%]",
    "lost": "frames lost",
    "segments": "segments",
    "path_length_m": "path [m]",
    "cpu_ms": "CPU per frame, median [ms]",
    "cpu_ms_p95": "CPU per frame, 95th percentile [ms]",
    "peak_memory_mb": "peak memory [MB]",
}
COLOURS = tuple(map(css, (*METHOD.values(), *OTHERS)))
DASHES = ("solid", "dashed", "dotted", "dashdot")


def label(quantity: str, unit: Unit = METRE) -> str:
    """With its unit, lengths in that which is given; the key itself for one that is not known here."""
    return LABELS.get(quantity, quantity).replace("[m]", f"[{unit.name}]")


def is_length(quantity: str) -> bool:
    return LABELS.get(quantity, "").endswith("[m]")


@dataclass(frozen=True)
class Style:
    colour: str
    dash: str


def styles(plan: Plan) -> dict[str, Style]:
    """By line, all different up to 56 lines."""
    count = len(COLOURS)
    return {line.name: Style(COLOURS[n % count], DASHES[n // count % len(DASHES)]) for n, line in enumerate(plan.lines)}
