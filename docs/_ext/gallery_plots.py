"""The gallery's plots: the paths of a run from above and the error over time, to hover over, zoom and switch.

The numbers are in docs/gallery, made by `python -m tests.docs.gallery_runs`. The site is read without a network:
Plotly's script is copied from the installed package.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

DATA = Path(__file__).parents[1] / "gallery"
SCRIPT = "plotly.min.js"
TRUTH_COLOUR = "#888888"
HEIGHT_PX = 380
AXES = {"gridcolor": "rgba(128,128,128,0.25)", "zeroline": False}


def pages() -> dict[str, str]:
    """Returns a snippet for each run, which the gallery includes."""
    return {f"_generated/plots/{path.stem}.md": _snippet(path) for path in sorted(DATA.glob("*.json"))}


def copy_script(app: Any, _: Exception | None) -> None:
    """Puts Plotly's script beside the pages. Called by Sphinx at the end of a build."""
    from plotly.offline import get_plotlyjs

    static = Path(app.outdir) / "_static"
    if app.builder.format == "html" and static.is_dir():
        (static / SCRIPT).write_text(get_plotlyjs(), encoding="utf-8")


def _snippet(path: Path) -> str:
    run = json.loads(path.read_text(encoding="utf-8"))
    name = f"plot-{path.stem}"
    config = {"displaylogo": False, "responsive": True}
    figure = json.dumps({"data": _lines(run), "layout": _layout(), "config": config})
    html = (
        f"<script src='_static/{SCRIPT}'></script>",
        f"<div id='{name}' style='height:{HEIGHT_PX}px'></div>",
        f"<script>{{const f = {figure}; Plotly.newPlot('{name}', f.data, f.layout, f.config);}}</script>",
    )
    return "\n".join(("```{raw} html", *html, "```", "", "```sh", run["command"], "```"))


def _lines(run: dict[str, Any]) -> list[dict[str, Any]]:
    from ispom_app.presentation import colours

    truth = {"x": run["truth"]["x"], "y": run["truth"]["z"], "line": {"color": TRUTH_COLOUR, "dash": "dot"}}
    lines = [{"name": "Ground truth", "mode": "lines", "hoverinfo": "skip", **truth}]
    for method, curve in run["methods"].items():
        line = {"color": colours.css(colours.of(method))}
        common = {"name": colours.label(method), "legendgroup": method, "mode": "lines", "line": line}
        hover = "%{customdata[0]:.2f} s, %{customdata[1]:.4f} m off"
        both = list(zip(curve["time"], curve["error"], strict=True))
        lines.append({**common, "x": curve["x"], "y": curve["z"], "customdata": both, "hovertemplate": hover})
        errors = {"x": curve["time"], "y": curve["error"], "xaxis": "x2", "yaxis": "y2", "showlegend": False}
        lines.append({**common, **errors, "hovertemplate": "%{x:.2f} s, %{y:.4f} m"})
    return lines


def _layout() -> dict[str, Any]:
    def axis(title: str, **more: Any) -> dict[str, Any]:
        return {"title": {"text": title}, **AXES, **more}

    return {
        "xaxis": axis("x [m]", domain=[0, 0.44]),
        "yaxis": axis("z [m]", scaleanchor="x"),
        "xaxis2": axis("time [s]", domain=[0.56, 1], anchor="y2"),
        "yaxis2": axis("position error [m]", anchor="x2", type="log"),
        "margin": {"l": 50, "r": 10, "t": 10, "b": 40},
        "legend": {"orientation": "h", "y": 1.12},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "font": {"color": TRUTH_COLOUR},
    }
