"""`ispom report`: reads the folders, writes the page."""

from __future__ import annotations

import base64
import gzip
import os
import sys
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

from plotly.offline import get_plotlyjs

from ispom.errors import InputError, printable

from ...engine.outputs import require_own, write_file
from ...engine.run_folder.run_folder import MARKER
from . import plots, tables
from .blocks import Block, Details, Grid, Heading, Moments, Paragraph, Plot, Section, Shown
from .folder import Run, read_run
from .html import own_text, rendered
from .moments import ALL, MOST, with_images, worst
from .options import Report
from .results import provenance, results
from .traces import Figure, points_per_line

RECORDINGS = Path("recordings")
"""The default folder of runs."""


def report(options: Report) -> int:
    """Writes the page; InputError where a folder holds no complete run, or the page cannot be written."""
    if not options.runs:
        raise InputError(f"no run was given: name one or more folders that `ispom run` wrote{_example()}")
    if options.out.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"--out is {options.out}: give a file name that ends in .html")
    require_own(options.out, GENERATOR)
    folders = [folder.expanduser() for folder in options.runs]
    runs = [read_run(folder, label) for folder, label in zip(folders, _labels(folders), strict=True)]
    write_file(options.out, page(runs), GENERATOR)
    sys.stdout.write(f"{printable(str(options.out))} ({options.out.stat().st_size / 1e6:.1f} MB)\n")
    return 0


def _example() -> str:
    """The newest run in the default place, if there is one."""
    found = [path.parent for path in RECORDINGS.glob("*/run.yaml") if not (path.parent / MARKER).exists()]
    newest = max(found, key=lambda folder: (folder / "run.yaml").stat().st_mtime, default=None)
    return f", such as {newest}" if newest else f" (by default below {RECORDINGS})"


def _labels(folders: list[Path]) -> list[str]:
    """The folders' names; their paths where two have the same name."""
    names = [os.path.basename(os.path.realpath(folder)) for folder in folders]
    return names if len(set(names)) == len(names) else [str(folder) for folder in folders]


POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"
"""What the browser itself then refuses: any other file, any address, any eval."""
GENERATOR = "ISPOM report"
"""Name in the head of a page by which our own pages are recognised."""
UNRECORDED = "steps.csv is not in this folder: run again to have statistics, times and decisions."


@dataclass
class Figures:
    """The plots of a page, numbered as they are placed."""

    data: list[dict[str, Any]] = field(default_factory=list)

    def place(self, figure: Figure) -> Plot:
        """Where the figure is drawn."""
        if not any(trace["x"] for trace in figure.traces):
            return Plot(figure.title)
        self.data.append({"traces": figure.traces, "layout": figure.layout})
        wide = "xaxis3" in figure.layout
        return Plot(figure.title, figure.note, len(self.data) - 1, int(figure.layout["height"]), wide)

    def grid(self, figures: list[Figure]) -> Grid:
        return Grid([self.place(figure) for figure in figures])


def page(runs: list[Run]) -> str:
    """The report of at least one run."""
    figures, most = Figures(), points_per_line(len(runs))
    sections = [
        Section("results", "Results", results(runs)),
        Section("events", "Events", [block for run in runs for block in _events(run, len(runs) > 1)]),
        Section("run", "Configuration", provenance(runs)),
        Section("paths", "Trajectories", [block for run in runs for block in _paths(figures, run, most)]),
        Section("errors", "Errors", _errors(figures, runs, most)),
        Section("scale", "Scale", [_scales(figures, runs, most)]),
        Section("tracks", "Tracks and keyframes", [block for run in runs for block in _tracks(figures, run)]),
        Section("timing", "Time", [block for run in runs for block in _timing(figures, run, most)]),
        Section("decisions", "Notable decisions", [b for run in runs for b in _decisions(run, len(runs) > 1)]),
        Section("moments", "Worst moments", [block for run in runs for block in _moments(run, len(runs))]),
    ]
    return rendered(
        "page.html",
        policy=POLICY,
        generator=GENERATOR,
        title=", ".join(dict.fromkeys(run.manifest["sequence"] for run in runs)),
        subtitle=f"{len(runs)} runs: {', '.join(r.label for r in runs)}" if len(runs) > 1 else f"Run {runs[0].label}",
        notes=list(dict.fromkeys(str(note) for run in runs for note in run.manifest["notes"])),
        sections=sections,
        made_by=f"Made by ispom {version('ispom')} with Plotly {version('plotly')} (MIT licence, inlined). "
        "Nothing is loaded from anywhere.",
        figures=figures.data,
        plotly=base64.b64encode(gzip.compress(get_plotlyjs().encode(), 9, mtime=0)).decode(),
        css=own_text("page.css"),
        js=own_text("page.js"),
    )


def _paths(figures: Figures, run: Run, most: int) -> list[Block]:
    in_space = figures.place(plots.in_space(run, most))
    return [figures.place(plots.in_planes(run, most)), Details(f"{run.label} in 3-D", [in_space])]


def _errors(figures: Figures, runs: list[Run], most: int) -> list[Block]:
    if all(run.truth is None for run in runs):
        return [Paragraph("There is no ground truth to compare with.")]
    together = [figures.place(plots.all_position_errors(runs, most))] if len(runs) > 1 else []
    each = [make(run, most) for run in runs for make in (plots.position_errors, plots.rotation_errors)]
    return [*together, figures.grid(each)]


def _scales(figures: Figures, runs: list[Run], most: int) -> Grid:
    return figures.grid([make(run, most) for run in runs for make in (plots.step_scales, plots.transferred_scales)])


def _tracks(figures: Figures, run: Run) -> list[Block]:
    if not run.steps:
        return [Paragraph(f"{run.label}: {UNRECORDED}", "quiet")]
    seen = [method for method, steps in run.steps.items() if (steps.columns["alive"] >= 0).any()]
    return [tables.counts(run), figures.grid([plots.tracks(run, method) for method in seen])]


def _timing(figures: Figures, run: Run, most: int) -> list[Block]:
    return [figures.place(plots.timing(run, most)), tables.stages(run)] if run.steps else []


def _events(run: Run, named: bool) -> list[Block]:
    heading = [Heading(run.label)] if named else []
    return [*heading, *tables.events(run)]


def _decisions(run: Run, named: bool) -> list[Block]:
    heading = [Heading(run.label)] if named else []
    return [*heading, *tables.decisions(run)] if run.steps else []


def _moments(run: Run, runs: int) -> list[Block]:
    moments, origin = with_images(run, worst(run, max(1, min(MOST, ALL // runs))))
    if not moments:
        return []
    heading = [Heading(run.label)] if runs > 1 else []
    shown = [Shown(f"frame {m.exposure}, {(m.time_ns - run.first_ns) * 1e-9:.3f} s", m.why, m.source) for m in moments]
    return [*heading, Moments(shown), Paragraph(origin, "quiet")]
