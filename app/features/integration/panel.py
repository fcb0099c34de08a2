"""The integration, step by step (Fig. 7): previous and next step, the numbers below; the 3-D view shows the same."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import viser

from ispom.methods import method as registered
from ispom.solvers.trajectory.stages import Kind, Stage, stages
from ispom.types import SegmentFit, SplineFit, Step

from ...presentation import colours
from ...presentation.texts import Unit, angle, length, length_unit
from ...session.current_run import CurrentRun
from ...session.state import State
from ...views.viser.panels import Panel, renderer
from .commands import IntegrationSteps, ShowIntegration, StepIntegration
from .integration import Integration, latest_fit

if TYPE_CHECKING:
    from ...session.session import Session


SEGMENT: dict[Kind, tuple[str, str]] = {
    "given": (
        "Two trajectories",
        "The monocular trajectory between two stereo frames. The two worlds are unrelated, so that it is drawn from "
        "the stereo pose at t_j on, and its own unit as a metre.",
    ),
    "bracketed": (
        "Interpolated at t_j",
        "The video poses just before and after each stereo frame bracket its time; between them the video pose at "
        "that time is interpolated.",
    ),
    "scaled": ("Scaled", "Distances from the first stereo pose times the ratio of the two segments' lengths."),
    "turned": ("Rotated", "Positions turned about the first stereo pose until the segment's end meets the second one."),
    "oriented": (
        "Oriented",
        "The difference of the last orientation is distributed over the segment, linearly in time.",
    ),
}
SPLINE = (
    ("Frames", "Poses of the frames of the window before the optimisation: video frames and stereo pairs."),
    ("Initial spline", "A cumulative cubic B-spline through the localised poses, by least squares, and its knots."),
    (
        "Optimised spline",
        "The spline that fits the images of all cameras best, each at its own time; grey: the initial one.",
    ),
)

SEGMENT_HEAD = (
    ("after the step", "what the step has done to the monocular trajectory"),
    ("end differs by", "distance of the segment's end from the second stereo pose [mm, m]"),
    ("direction", "angle between the directions from the first stereo pose to both ends [degrees]"),
    ("orientation", "angle between both orientations at the segment's end [degrees]"),
)
SPLINE_HEAD = (
    ("median residual [sigma]", "of the reprojections, in standard deviations of the tracks' noise"),
    ("before", "with the initial spline"),
    ("after", "with the optimised spline"),
)


def table(step: Step, stage: int) -> dict[str, Any]:
    """Of the fit: title and explanation of the stage, the rows of its table, and facts."""
    if step.segments:
        return _segment(step.segments[-1], stage)
    return _spline(step.spline, stage) if step.spline is not None else {}


def _segment(fit: SegmentFit, stage: int) -> dict[str, Any]:
    found = stages(fit)
    if not found:
        return {}
    at = min(stage, len(found) - 1)
    title, help_text = SEGMENT[found[at].kind]
    facts = [("segment", f"{fit.span_ns[0] * 1e-9:.3f} to {fit.span_ns[1] * 1e-9:.3f} s")]
    facts.append(("monocular poses", f"{len(fit.video)}, those that bracket the ends included"))
    if fit.scale is None or fit.turn_rad is None:
        facts.append(("scale", "none: the segment is too short for a ratio of lengths"))
    else:
        facts.append(("scale", f"{fit.scale:.4g} m per unit"))
        facts.append(("rotation about the first pose", _degrees(fit.turn_rad)))
    facts.append(("difference of the last orientation", _degrees(fit.residual_rad)))
    unit = length_unit(stage.gap_m for stage in found)
    return {
        "title": f"{at + 1} of {len(found)}: {title}",
        "help": help_text,
        "head": SEGMENT_HEAD,
        "rows": [(SEGMENT[s.kind][0], i == at, _off(s, unit)) for i, s in enumerate(found)],
        "facts": facts,
    }


def _off(stage: Stage, unit: Unit) -> tuple[str, str, str]:
    return length(stage.gap_m, unit), _degrees(stage.direction_rad), _degrees(stage.orientation_rad)


def _spline(fit: SplineFit, stage: int) -> dict[str, Any]:
    if not len(fit.times_ns):
        return {}
    at = min(stage, len(SPLINE) - 1)
    title, help_text = SPLINE[at]
    span_s, spacing_ms = (fit.times_ns[-1] - fit.times_ns[0]) * 1e-9, float(np.diff(fit.knots_ns[:2])[0]) * 1e-6
    moved = np.linalg.norm(fit.after - fit.before, axis=1)
    rows = [
        ("video frames", False, _errors(fit, fit.video)),
        ("stereo pairs", False, _errors(fit, ~fit.video)),
        ("cost", False, (f"{fit.cost_before:.4g}", f"{fit.cost_after:.4g}")),
    ]
    facts = [
        ("window", f"{int(fit.video.sum())} video frames and {int((~fit.video).sum())} pairs in {span_s:.2f} s"),
        ("knots", f"{len(fit.knots_ns)}, every {spacing_ms:.0f} ms"),
        ("optimisation", f"{fit.iterations} iterations; poses moved by up to {length(float(moved.max()))}"),
    ]
    return {
        "title": f"{at + 1} of {len(SPLINE)}: {title}",
        "help": help_text,
        "head": SPLINE_HEAD,
        "rows": rows,
        "facts": facts,
    }


def _errors(fit: SplineFit, which: np.ndarray) -> tuple[str, str]:
    found = (errors[which & np.isfinite(errors)] for errors in (fit.errors_before, fit.errors_after))
    before, after = (f"{np.median(errors):.2f}" if len(errors) else "-" for errors in found)
    return before, after


def _degrees(angle_rad: float) -> str:
    return angle(float(np.degrees(angle_rad)))


render = renderer(__package__)

OFF: tuple[str, ...] = ("off",)
PREVIOUS, NEXT = "◀ Previous step", "Next step ▶"
STEP_HINT = "The step before or after, in the 3-D view."


class IntegrationPanel:
    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session, self._state = session, session.state
        self._found: tuple[tuple[object, ...], tuple[int, Step] | None] = ((), None)
        self._folder = gui.add_folder("Integration, step by step", expand_by_default=False, visible=False)
        with self._folder:
            hint = "The steps of the latest fit up to the frame shown, drawn in the 3-D view."
            self._method = gui.add_dropdown("integration", OFF, hint=hint)
            self._method.on_update(self._chosen)
            self._buttons = gui.add_button_group("", (PREVIOUS, NEXT), visible=False, hint=STEP_HINT)
            self._buttons.on_click(self._clicked)
            self._text = gui.add_html("", visible=False)

    def _chosen(self, _: object) -> None:
        method = next((m for m in _methods(self._state) if colours.label(m) == self._method.value), "")
        shown = self._state[IntegrationSteps].shown
        if method != (shown.method if shown is not None else ""):
            self._session.post(ShowIntegration(method))

    def _clicked(self, _: object) -> None:
        self._session.post(StepIntegration({PREVIOUS: -1, NEXT: 1}[self._buttons.value]))

    def show(self, state: State) -> None:
        self._state = state
        shown = state[IntegrationSteps].shown
        options = (*OFF, *map(colours.label, _methods(state)))
        if tuple(self._method.options) != options:
            self._method.options = options
            self._folder.visible = options != OFF
        value = colours.label(shown.method) if shown is not None else OFF[0]
        if self._method.value != value and value in options:
            self._method.value = value
        self._look_up(shown, state)
        self._buttons.visible = self._text.visible = shown is not None
        text = _text(self._found[1], shown.stage) if shown is not None else ""
        if text != self._text.content:
            self._text.content = text

    def _look_up(self, shown: Integration | None, state: State) -> None:
        run: CurrentRun | None = self._session.run
        key = (run, shown.method if shown is not None else "", state.index)
        if key != self._found[0]:
            found = latest_fit(run, shown.method, state.index) if run is not None and shown is not None else None
            self._found = key, found


def _methods(state: State) -> tuple[str, ...]:
    """Those that build on others: what they integrate."""
    return tuple(m for m in state.methods if registered(m).asks)


def _text(found: tuple[int, Step] | None, stage: int) -> str:
    if found is None:
        return render("integration.html", index=None, found={})
    return render("integration.html", index=found[0], found=table(found[1], stage))


PANELS = (Panel("View", 600, IntegrationPanel),)
