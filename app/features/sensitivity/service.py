"""What a wrong calibration would do to the run that is shown, and the branch that runs with it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ispom.errors import InputError
from ispom.evaluation.sensitivity.perturbation import Perturbation
from ispom.evaluation.trajectory_error import placed
from ispom.geometry import Similarity
from ispom.io.poses.dialect import TrajectoryFile
from ispom.settings import check
from ispom.types import Sequence

from ...engine.external_trajectories.placed import ExternalTrajectory, TrajectoryOption, external_trajectory
from ...engine.playback import Playback, truth_from_start
from ...session.branches.service import BranchService
from ...session.controller import Controller
from ...session.current_run import CurrentRun
from ...session.service import Service
from ...session.state import FeatureState, State
from .predictor import Prediction, Predictor
from .ran import Ran, ran_here, ran_in
from .rerun import Compared, at_own_stamps, compared
from .words import perturbation_text


@dataclass(frozen=True, eq=False)
class Effect:
    """What is shown of a wrong calibration."""

    wrong: Perturbation
    computed: int
    """Frames of the run that the prediction is made of."""
    predictions: tuple[Prediction, ...]
    rerun: bool = False
    """Whether a branch runs, or ran, with it."""
    outcomes: tuple[Compared, ...] = ()
    """What came out there; empty until it has ended."""


@dataclass(frozen=True)
class CalibrationEffect(FeatureState):
    effect: Effect | None = None

    def page(self, state: State) -> dict[str, Any]:
        """What is wrong with the calibration, and how far that moves each method: predicted, and in the rerun [m]."""
        effect = self.effect
        if effect is None:
            return {"effect": None}
        predicted = {each.method: each.shift_m for each in effect.predictions}
        found = {each.prediction.method: each.shift_m for each in effect.outcomes}
        return {"effect": {"wrong": effect.wrong.nonzero, "predicted": predicted, "rerun": found}}


PREDICTED = "predicted-"
"""The beginning of the names of predictions in a rerun."""


class EffectService(Service):
    """Stores the linearisation of a run, for as long as predictions are about that run."""

    place = 20

    def __init__(self, session: Controller) -> None:
        super().__init__(session)
        self._of: tuple[CurrentRun, int] | None = None
        self._predictor: Predictor | None = None
        self._again: CurrentRun | None = None

    def predict(self, wrong: Perturbation) -> None:
        """Of the frames computed by now. InputError where they say too little, or a value is out of its range."""
        check(wrong, "")
        run, predictor = self._predicted_run(), self._predictor
        now = run, len(run.history)
        if predictor is None or self._of != now:
            self.store.busy("linearising the run")
            try:
                predictor = Predictor.of(_ran(run))
            finally:
                self.store.set(activity=None)
            self._predictor, self._of, self._again = predictor, now, None
        self.store.put(CalibrationEffect(Effect(wrong, now[1], predictor.predict(wrong))))

    def rerun(self) -> None:
        """The run from its first frame on with the wrong calibration, as a branch, its prediction drawn with it."""
        effect = self.state[CalibrationEffect].effect
        if effect is None or not effect.wrong.nonzero:
            raise InputError("nothing is wrong with the calibration yet: move a slider first")
        run = self._predicted_run()
        run.require_source()
        before = run.playback
        sequence = effect.wrong.of_sequence(before.sequence)
        shown = tuple(
            _as_external_trajectory(n, each, run, sequence, effect.wrong) for n, each in enumerate(effect.predictions)
        )
        playback = Playback(sequence, before.methods, before.config, before.builder, before.earlier, shown)
        again, name = CurrentRun(playback, self.session.setup.history_bytes), perturbation_text(effect.wrong)
        self.session.service(BranchService).add(again, name, 0, (name,))
        self._again = again
        self.store.put(CalibrationEffect(replace(effect, rerun=True, outcomes=())))

    def watch(self) -> None:
        """Compares, once the rerun is over."""
        effect, again, predictor = self.state[CalibrationEffect].effect, self._again, self._predictor
        if again is None or not again.done:
            return
        self._again = None
        if effect is not None and effect.rerun and predictor is not None:
            found = again.finish().trajectories
            outcomes = compared(predictor, effect.predictions, found, effect.wrong)
            self.store.put(CalibrationEffect(replace(effect, outcomes=outcomes)))

    def _predicted_run(self) -> CurrentRun:
        """Returns the run to predict: while the branch with the wrong calibration is shown, the one before it.

        Raises InputError where there is none, or it is still recording."""
        run = self.run
        if run is None:
            raise InputError("there is no run yet: open a source first")
        if run.live:
            raise InputError("a live source is still recording: wait for its end")
        external = run.playback.external_trajectories
        if self._of is not None and any(each.name.startswith(PREDICTED) for each in external):
            return self._of[0]
        return run


def _ran(run: CurrentRun) -> Ran:
    stored = run.stored
    if stored is not None and stored.path.suffix != ".rrd":
        return ran_in(stored.path)
    return ran_here(run.opened, run.finish(), run.history)


def _as_external_trajectory(
    number: int, each: Prediction, run: CurrentRun, sequence: Sequence, wrong: Perturbation
) -> ExternalTrajectory:
    """Returns a prediction as an external trajectory of the rerun, in the shared world and at its stamps."""
    placement = run.history.last.placements.get(each.method, Similarity()) if run.history.last else Similarity()
    path, rig = placed(each.trajectory, placement), run.playback.sequence.rig
    path = path.moved(right=rig.rig_from(path.frame).inverse(), frame="rig")
    path = at_own_stamps(each.method, path, replace(wrong, clock_ms=-wrong.clock_ms))
    name = f"{PREDICTED}{each.method}"
    option = TrajectoryOption(name, TrajectoryFile(Path(name), "TUM", path), alignment="none")
    return external_trajectory(number, option, sequence, truth_from_start(sequence))
