"""The laser's points as the methods place them, side by side: what poses at the video's rate are worth."""

from __future__ import annotations

from collections.abc import Mapping
from io import BytesIO

import numpy as np
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from ...presentation.colours import label
from .laser import TRUE, Placed

PANEL_IN = 4.4
LENGTH_M, DEPTH_M = 16.0, 14.0
"""Of what is shown: a stretch in the middle of the path, and how far it goes to the left."""
WORST_M = 0.3
"""Errors from here on have one colour."""


def picture(found: Mapping[str, Placed]) -> bytes:
    """PNG: seen from the side that the path has at its left; each point in the colour of its error."""
    shown = {name: each for name, each in found.items() if each.true_world is not None and len(each.points)}
    figure = Figure(figsize=(1 + PANEL_IN * len(shown), 5.2), layout="constrained")
    places = figure.subplots(1, len(shown), sharex=True, sharey=True, squeeze=False)[0]
    norm, colours = Normalize(0, 100 * WORST_M), colormaps["viridis"]
    middle = float(np.median(np.concatenate([each.true_world[:, 2] for each in shown.values()])))  # type: ignore[index]
    for axes, (name, each) in zip(places, shown.items(), strict=True):
        assert each.true_world is not None and each.distances_m is not None
        xyz = each.true_world
        seen = (abs(xyz[:, 2] - middle) < LENGTH_M / 2) & (xyz[:, 0] < -2) & (xyz[:, 0] > -DEPTH_M) & (xyz[:, 1] < 0.1)
        axes.scatter(
            xyz[seen, 2], -xyz[seen, 1], c=100 * each.distances_m[seen], norm=norm, cmap=colours, s=0.4, linewidths=0
        )
        numbers = each.numbers
        who = "the true poses" if name == TRUE else f"{label(name)}, {each.poses_hz:.0f} poses/s"
        rms, median = (f"{100 * numbers[key]:.1f} cm" for key in ("rmse_m", "median_m"))
        axes.set_title(f"{who}\n{rms} from the true surfaces (RMS), median {median}", fontsize=9)
        axes.set(xlabel="along the street [m]", aspect="equal")
    places[0].set_ylabel("height [m]")
    figure.colorbar(ScalarMappable(norm, colours), ax=list(places), label="error [cm]", shrink=0.6)
    content = BytesIO()
    figure.savefig(content, format="png", dpi=110, metadata={"Software": None})
    return content.getvalue()
