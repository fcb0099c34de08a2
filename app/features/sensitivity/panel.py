"""Calibration error: sliders, what they would do to the trajectories, and the branch that runs with them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import viser

from ispom.evaluation.sensitivity.perturbation import Perturbation
from ispom.types import Rig

from ...presentation import colours
from ...presentation.texts import Unit
from ...session.state import State
from ...views.viser.controls import ConfigForm
from ...views.viser.panels import Panel, renderer
from .commands import Predict, RunPerturbed
from .rerun import CLOSE, Compared
from .service import CalibrationEffect
from .words import cell, perturbation_text, unit_of

if TYPE_CHECKING:
    from ...session.session import Session

render = renderer(__package__)

TITLE, RERUN, NOTHING = "Calibration error", "Rerun as a branch", "No error"
RERUN_HINT = "Runs from the first frame with this error in the calibration, with the prediction drawn beside it."
NOTHING_HINT = "Puts all sliders back to 0."
OF_VIDEO = ("video_",)
OF_PAIR = ("pair_", "baseline_")
OF_BOTH = ("turn_", "shift_", "clock_")


class EffectPanel:
    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._session, self._run = session, -1
        with gui.add_folder(TITLE, expand_by_default=False):
            # Above the sliders: what they do stays visible while they are drawn.
            self._text = gui.add_html(_text(session.state))
            self._form = ConfigForm(gui, Perturbation(), lambda wrong: session.post(Predict(wrong)))
            self._rerun = gui.add_button(RERUN, icon=viser.Icon.GIT_FORK, hint=RERUN_HINT, disabled=True)
            self._rerun.on_click(lambda _: session.post(RunPerturbed()))
            nothing = gui.add_button(NOTHING, icon=viser.Icon.RESTORE, color="gray", hint=NOTHING_HINT)
            nothing.on_click(lambda _: self._reset())

    def _reset(self) -> None:
        self._form.show(Perturbation())
        self._session.post(Predict(Perturbation()))

    def show(self, state: State) -> None:
        if state.run != self._run:
            self._run, opened = state.run, self._session.opened
            if opened is not None:
                self._form.offer(offered(opened.sequence.rig))
        if (text := _text(state)) != self._text.content:
            self._text.content = text
        effect = state[CalibrationEffect].effect
        disabled = effect is None or not effect.wrong.nonzero
        if self._rerun.disabled != disabled:
            self._rerun.disabled = disabled


def offered(rig: Rig) -> frozenset[str]:
    """The fields of a Perturbation that mean something for a rig."""
    parts = OF_VIDEO * (rig.video is not None) + OF_PAIR * rig.has_stereo
    parts += OF_BOTH * (rig.video is not None and rig.has_stereo)
    return frozenset(name for name in Perturbation.__dataclass_fields__ if name.startswith(parts))


def _text(state: State) -> str:
    effect = state[CalibrationEffect].effect
    if effect is None:
        return render("effect.html", effect=None)
    unit = unit_of(effect.predictions, effect.outcomes)
    outcomes = {each.prediction.method: each for each in effect.outcomes}
    rows = [
        {
            "label": colours.label(each.method),
            "shift": cell(each.shift_m, unit),
            "ate": cell(each.ate_m, unit),
            "predicted": cell(each.predicted_ate_m, unit),
            "linear": each.linear,
            "left_out": each.left_out,
            **_outcome(outcomes.get(each.method), unit),
        }
        for each in effect.predictions
    ]
    shown = {"said": perturbation_text(effect.wrong), "computed": effect.computed, "rerun": effect.rerun, "rows": rows}
    return render("effect.html", effect=shown | {"ended": bool(outcomes), "close": round(100 * CLOSE)})


def _outcome(outcome: Compared | None, unit: Unit) -> dict[str, Any]:
    if outcome is None:
        return {"rerun": "", "rerun_ate": "", "held": True}
    return {"rerun": cell(outcome.shift_m, unit), "rerun_ate": cell(outcome.ate_m, unit), "held": outcome.agrees}


PANELS = (Panel("Branches", 450, EffectPanel),)
