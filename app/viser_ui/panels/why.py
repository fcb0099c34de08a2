"""Why: what the exposure shown decided, which tracks it dropped, how well it fits and how long it took."""

from __future__ import annotations

from collections import Counter
from html import escape

import numpy as np
import viser

from ispom.types import Decision, Step, TrackStatus

from ... import colours
from ...run.record import ExposureRecord
from ...session.state import State
from ...uncertainty import told

ROW = "display:flex;gap:6px;font-variant-numeric:tabular-nums"
EMPTY = "Nothing is computed yet. Press play, or step forward (→)."


class WhyPanel:
    def __init__(self, gui: viser.GuiApi) -> None:
        self._html = gui.add_html(_page(EMPTY))
        self._record: ExposureRecord | None = None

    def show(self, state: State) -> None:
        if state.displayed is not self._record:
            self._record = state.displayed
            self._html.content = report(state.displayed, len(state.methods))


def report(record: ExposureRecord | None, methods: int) -> str:
    """The exposure's story as HTML."""
    if record is None:
        return _page(EMPTY)
    head = f"<b>{record.kind}</b> exposure {record.index + 1}, {len(record.steps)} of {methods} methods use it"
    return _page(
        f'<div style="opacity:.75">{head}</div>' + "".join(_step(step, _unit_m(record, step)) for step in record.steps)
    )


def _page(content: str) -> str:
    return f'<div style="padding:6px 14px 12px;font-size:12px;line-height:1.45;overflow-wrap:anywhere">{content}</div>'


def _unit_m(record: ExposureRecord, step: Step) -> float:
    placed = record.placements.get(step.method)
    return placed.scale if placed else 1.0


def _step(step: Step, unit_m: float) -> str:
    colour = colours.css(colours.of(step.method))  # type: ignore[index]
    flags = " · key frame" if step.key_frame else ""
    title = (
        f'<div style="margin-top:10px;padding-bottom:2px;border-bottom:2px solid {colour};display:flex">'
        f'<b style="flex:1">{colours.label(step.method)}</b><span>{step.status}{flags}</span></div>'
    )
    rows = [_decision(decision) for decision in step.decisions]
    return title + "".join(rows) + "".join(_fact(name, text) for name, text in _facts(step, unit_m))


def _decision(decision: Decision) -> str:
    mark, tint = ("✓", colours.css(colours.of("integrated"))) if decision.passed else ("✕", "#c46a3a")
    unit = f" {escape(decision.unit)}" if decision.unit else ""
    because = (
        f'<div style="opacity:.7;padding-left:18px">{escape(decision.consequence)}</div>'
        if decision.consequence
        else ""
    )
    return (
        f'<div style="{ROW}"><span style="color:{tint};width:12px;flex:none">{mark}</span>'
        f'<span style="flex:1">{escape(decision.name)}</span>'
        f'<span style="white-space:nowrap">{decision.value:.4g}{unit} <span style="opacity:.7">'
        f"{escape(decision.relation)} {decision.threshold:.4g}</span></span></div>{because}"
    )


def _fact(name: str, text: str) -> str:
    return f'<div style="{ROW}"><span style="opacity:.7;width:78px;flex:none">{name}</span><span>{text}</span></div>'


def _facts(step: Step, unit_m: float) -> list[tuple[str, str]]:
    facts = []
    for camera, tracks in step.tracks.items():
        counts = Counter(int(s) for s in tracks.status)
        alive, new = counts.pop(TrackStatus.ALIVE, 0), counts.pop(TrackStatus.NEW, 0)
        facts.append((f"{camera}", f"{alive} tracks alive, {new} new, {sum(counts.values())} dropped"))
        facts += [("", f"{n} {TrackStatus(status).reason}") for status, n in counts.most_common()]
    if len(step.residuals_px):
        median, p95 = np.median(step.residuals_px), np.percentile(step.residuals_px, 95)
        facts.append(("residual", f"median {median:.2f} px, 95 % below {p95:.2f} px, {len(step.residuals_px)} points"))
    if text := told(step, unit_m):
        facts.append(("pose", text))
    if step.scale is not None or step.scale_sigma is not None:
        carried = [] if step.scale is None else [f"× {step.scale:.4f} carried over"]
        known = [] if step.scale_sigma is None else [f"± {100 * step.scale_sigma:.2g} % since the start"]
        facts.append(("scale", ", ".join(carried + known)))
    if step.seconds:
        stages = ", ".join(f"{escape(name)} {1000 * s:.1f}" for name, s in step.seconds.items())
        facts.append(("time", f"{1000 * sum(step.seconds.values()):.1f} ms ({stages})"))
    return facts
