"""Why: what the exposure shown decided, which tracks it dropped, how well it fits and how long it took."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np
import viser

from ispom.geometry import Similarity
from ispom.methods import method
from ispom.types import Decision, Step, TrackStatus

from ... import colours
from ...decisions import answers, mark, measured, named
from ...run.history.record import ExposureRecord
from ...run.model.drawn_size import unit_in_metres
from ...session.state import State
from ...uncertainty import describe
from ..markup import render

TINTS = {"✓": "light-dark(#00795a, #2bb58d)", "✕": "light-dark(#c62828, #ff7b70)", "●": "light-dark(#0072b2, #56b4e9)"}
HINTS = {
    "✓": "required: passed",
    "✕": "required: failed",
    "●": "trigger: fired",
    "○": "trigger: did not fire",
    "·": "measurement: neither pass nor fail",
}


class WhyPanel:
    def __init__(self, gui: viser.GuiApi) -> None:
        self._html = gui.add_html(report(None, 0))
        self._shown: tuple[ExposureRecord | None, bool] = (None, False)

    def show(self, state: State) -> None:
        shown = (state.displayed, state.displayed is None and (state.playing or state.activity is not None))
        if shown != self._shown:
            self._shown = shown
            self._html.content = report(state.displayed, len(state.methods), coming=shown[1])


def report(record: ExposureRecord | None, methods: int, *, coming: bool = False) -> str:
    """The exposure's story as HTML; without one, whether the first is `coming` or waits to be asked for."""
    steps = [_step(step, _unit_m(record, step)) for step in record.steps] if record else []
    return render("why.html", record=record, methods=methods, steps=steps, coming=coming)


def _unit_m(record: ExposureRecord, step: Step) -> float | None:
    return unit_in_metres(step.method, record.placements.get(step.method, Similarity()).scale)


def _step(step: Step, unit_m: float | None) -> dict[str, Any]:
    return {
        "colour": colours.css(colours.of(step.method)),
        "label": colours.label(step.method),
        "status": f"{step.status}{' · key frame' if step.key_frame else ''}",
        "answers": [
            {"question": a.question, "text": a.text, "checks": [_check(d) for d in a.checks]}
            for a in answers(step.decisions)
        ],
        "facts": list(_facts(step, unit_m)),
    }


def _check(decision: Decision) -> dict[str, str]:
    sign = mark(decision)
    return {
        "mark": sign,
        "tint": TINTS.get(sign, "inherit"),
        "hint": HINTS[sign],
        "name": named(decision),
        "measured": measured(decision),
        "consequence": decision.consequence,
    }


def _facts(step: Step, unit_m: float | None) -> Iterator[tuple[str, str]]:
    for camera, tracks in step.tracks.items():
        counts = Counter(int(s) for s in tracks.status)
        alive, new = counts.pop(TrackStatus.ALIVE, 0), counts.pop(TrackStatus.NEW, 0)
        yield camera, f"{alive} tracks alive, {new} new, {sum(counts.values())} dropped"
        yield from (("", f"{n} {TrackStatus(status).reason}") for status, n in counts.most_common())
    if len(step.residuals_px):
        median, p95 = np.median(step.residuals_px), np.percentile(step.residuals_px, 95)
        yield "residual", f"median {median:.2f} px, 95 % below {p95:.2f} px, {len(step.residuals_px)} points"
    if text := describe(step, unit_m):
        yield "pose", text
    if step.scale is not None:
        yield "scale", f"{step.scale:.4g} {method(step.method).scale}"
    if step.scale_sigma is not None:
        yield "scale drift", f"± {100 * step.scale_sigma:.2g} % since the start (1 sigma)"
    if step.seconds:
        stages = ", ".join(f"{name} {1000 * s:.1f}" for name, s in step.seconds.items())
        yield "time", f"{1000 * sum(step.seconds.values()):.1f} ms ({stages})"
