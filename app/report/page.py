"""The whole page: sections, figures' data, styles and scripts in one file that loads nothing from anywhere."""

from __future__ import annotations

import base64
import gzip
from importlib.metadata import version
from importlib.resources import files

from plotly.offline import get_plotlyjs

from ispom.estimators import ALL_METHODS

from .. import colours
from . import plots, tables
from .folder import Run
from .markup import details, inline_json, paragraph, section, text
from .moments import ALL, MOST, with_images, worst
from .plots import Figure

POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"
"""What the browser itself then refuses: any other file, any address, any eval."""
PARTS = {
    "results": "Results",
    "run": "What was run",
    "paths": "Trajectories",
    "errors": "Errors",
    "scale": "Scale",
    "tracks": "Tracks and key frames",
    "timing": "Time",
    "decisions": "Decisions that mattered",
    "moments": "Worst moments",
}
UNRECORDED = "steps.csv is not in this folder: run again to have statistics, times and decisions."


class Figures:
    """The plots of a page, numbered as they are placed."""

    def __init__(self) -> None:
        self.data: list[dict] = []

    def place(self, figure: Figure) -> str:
        """The card that a plot is drawn in; without data a sentence."""
        heading = f"<h3>{text(figure.title)}</h3>"
        if not any(trace["x"] for trace in figure.traces):
            return (
                f'<div class="card">{heading}{paragraph("Nothing to draw: the run does not tell this.", "quiet")}</div>'
            )
        self.data.append({"traces": figure.traces, "layout": figure.layout})
        height = int(figure.layout["height"])
        kind = "plot planes" if "xaxis3" in figure.layout else "plot"
        plot = f'<div class="{kind}" data-figure="{len(self.data) - 1}" style="height:{height}px"></div>'
        return f'<div class="card">{heading}{plot}{paragraph(figure.note, "quiet")}</div>'

    def grid(self, figures: list[Figure]) -> str:
        return f'<div class="grid">{"".join(map(self.place, figures))}</div>'


def page(runs: list[Run]) -> str:
    """The report of at least one run."""
    figures, most = Figures(), plots.points_per_line(len(runs))
    scales = [make(run, most) for run in runs for make in (plots.step_scales, plots.transferred_scales)]
    content = {
        "results": tables.results(runs),
        "run": tables.provenance(runs),
        "paths": "".join(_paths(figures, run, most) for run in runs),
        "errors": _errors(figures, runs, most),
        "scale": figures.grid(scales),
        "tracks": "".join(_tracks(figures, run) for run in runs),
        "timing": "".join(_timing(figures, run, most) for run in runs),
        "decisions": "".join(_decisions(run, len(runs) > 1) for run in runs),
        "moments": "".join(_moments(run, len(runs)) for run in runs),
    }
    sections = "".join(section(identity, PARTS[identity], told) for identity, told in content.items())
    return _document(_header(runs), sections, figures)


def _header(runs: list[Run]) -> str:
    title = ", ".join(dict.fromkeys(run.told["sequence"] for run in runs))
    many = f"{len(runs)} runs: {', '.join(run.label for run in runs)}" if len(runs) > 1 else f"Run {runs[0].label}"
    notes = dict.fromkeys(str(note) for run in runs for note in run.told["notes"])
    return f"<h1>{text(title)}</h1>{paragraph(many, 'quiet')}{''.join(paragraph(note, 'note') for note in notes)}"


def _paths(figures: Figures, run: Run, most: int) -> str:
    flat = figures.place(plots.paths(run, most))
    return flat + details(f"{run.label} in 3-D", figures.place(plots.path_3d(run, most)))


def _errors(figures: Figures, runs: list[Run], most: int) -> str:
    if all(run.truth is None for run in runs):
        return paragraph("There is no truth to compare with.")
    together = figures.place(plots.together(runs, most)) if len(runs) > 1 else ""
    return together + figures.grid(
        [make(run, most) for run in runs for make in (plots.position_errors, plots.rotation_errors)]
    )


def _tracks(figures: Figures, run: Run) -> str:
    if not run.steps:
        return paragraph(f"{run.label}: {UNRECORDED}", "quiet")
    seen = [method for method, steps in run.steps.items() if (steps.columns["alive"] >= 0).any()]
    return tables.counts(run) + figures.grid([plots.tracks(run, method) for method in seen])


def _timing(figures: Figures, run: Run, most: int) -> str:
    return figures.place(plots.timing(run, most)) + tables.stages(run) if run.steps else ""


def _decisions(run: Run, named: bool) -> str:
    heading = f"<h3>{text(run.label)}</h3>" if named else ""
    return heading + tables.decisions(run) if run.steps else ""


def _moments(run: Run, runs: int) -> str:
    moments, origin = with_images(run, worst(run, max(1, min(MOST, ALL // runs))))
    if not moments:
        return ""
    heading = f"<h3>{text(run.label)}</h3>" if runs > 1 else ""
    shown = []
    for moment in moments:
        when = f"exposure {moment.exposure}, {(moment.time_ns - run.first_ns) * 1e-9:.3f} s"
        image = f'<img alt="{text(when)}" src="{moment.source}">' if moment.source else ""
        reasons = "".join(f"<br>{text(why)}" for why in moment.why)
        shown.append(f"<figure>{image}<figcaption><b>{text(when)}</b>{reasons}</figcaption></figure>")
    return f'{heading}<div class="moments">{"".join(shown)}</div>{paragraph(origin, "quiet")}'


def _document(header: str, sections: str, figures: Figures) -> str:
    own = files(__name__.rpartition(".")[0])
    links = "".join(f'<a href="#{identity}">{text(title)}</a>' for identity, title in PARTS.items())
    dots = "".join(f".{method} {{ background: {colours.css(colours.METHOD[method])}; }}\n" for method in ALL_METHODS)
    script = base64.b64encode(gzip.compress(get_plotlyjs().encode(), 9, mtime=0)).decode()
    made = (
        f"Made by ispom {version('ispom')} with Plotly {version('plotly')} (MIT licence, inlined). Nothing is loaded."
    )
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{POLICY}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>ISPOM report</title>
<style>
{own.joinpath("page.css").read_text(encoding="utf-8")}{dots}</style>
</head>
<body>
<header>{header}</header>
<nav><div>{links}</div></nav>
<main><p id="trouble" class="alarm" hidden></p>{sections}</main>
<footer class="quiet">{text(made)}</footer>
<script type="application/json" id="figures">{inline_json(figures.data)}</script>
<script type="application/octet-stream" id="plotly">{script}</script>
<script>
{own.joinpath("page.js").read_text(encoding="utf-8")}</script>
</body>
</html>
"""
