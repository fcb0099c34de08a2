"""Predictions for all methods of a run: linearised once, then a product for each perturbation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from ispom.errors import InputError
from ispom.estimators.modern.monocular.estimator import ModernMonocularConfig
from ispom.estimators.modern.monocular.setup import LOSS
from ispom.estimators.modern.stereo.estimator import ModernStereoConfig
from ispom.evaluation.sensitivity.effect import Sensitivity, shift_m
from ispom.evaluation.sensitivity.perturbation import Perturbation, predict_integrated
from ispom.evaluation.sensitivity.scene import Adjustment, Scene
from ispom.evaluation.trajectory_error import MIN_POSES, alignment_of, error_against_truth
from ispom.methods import method as registered
from ispom.solvers.right_camera import PAIR
from ispom.solvers.window.prior import LENS
from ispom.types import Trajectory

from .ran import Ran

OF_VIDEO = ("video_", "turn_", "shift_")
"""How the names of the parts of a Perturbation begin that concern the video camera alone."""
LINEAR = 0.3
"""A second step of more than this share of the first: the effect is no longer linear."""
LEARNT = "how the method corrects its focal length as it goes on is not predicted"
PULLED = "how the video camera's error pulls at its spline is not predicted"


@dataclass(frozen=True, eq=False)
class Prediction:
    """Of one method."""

    method: str
    shift_m: float
    """Root mean square distance from the run [m, or the method's unit where that is unknown]."""
    ate_m: float | None
    """ATE of the run, aligned as in metrics.json; None without ground truth."""
    predicted_ate_m: float | None
    nonlinearity: float
    trajectory: Trajectory
    """In the world of the run."""
    left_out: str = ""
    """What counts, and is not in the prediction: it is rough then. Empty where there is nothing."""

    @property
    def linear(self) -> bool:
        return self.nonlinearity <= LINEAR


@dataclass(frozen=True, eq=False)
class Predictor:
    """Of one run."""

    ran: Ran
    sensitivities: Mapping[str, Sensitivity]
    """Of the methods that see with their own cameras; others are predict_integrated by those."""

    @staticmethod
    def of(ran: Ran) -> Predictor:
        """InputError where no method has seen enough by now."""
        found = {}
        for method, scene in ran.scenes.items():
            if registered(method).asks or len(scene.key_frames) < MIN_POSES or not len(scene.landmarks):
                continue
            seen = Scene.of(scene, ran.rig)
            found[method] = Sensitivity.of(seen, adjustment_of(ran.config.of(method), seen))
        if not found:
            raise InputError("no method has keyframes with points yet: let the run go on")
        return Predictor(ran, found)

    def predict(self, wrong: Perturbation) -> tuple[Prediction, ...]:
        """Of each method that a prediction is possible for, in their order."""
        found: dict[str, Prediction] = {}
        for method in self.ran.methods:
            run = self.ran.trajectories[method]
            if len(run) < MIN_POSES:
                continue
            if method in self.sensitivities:
                of = self.sensitivities[method]
                made = self._prediction(method, of.predicted(run, wrong), of.nonlinearity(wrong))
                learns = wrong.video_focal_percent and corrects_its_lens(self.ran.config.of(method))
                found[method] = replace(made, left_out=LEARNT if learns else "")
            elif (pairs := found.get(registered(method).asks.get("stereo", ""))) is not None:
                path = predict_integrated(run, pairs.trajectory, self.ran.rig, wrong)
                pulls = any(name.startswith(OF_VIDEO) for name in wrong.nonzero)
                made = self._prediction(method, path, pairs.nonlinearity)
                found[method] = replace(made, left_out=PULLED if pulls else "")
        return tuple(found.values())

    def _prediction(self, method: str, predicted: Trajectory, nonlinearity: float) -> Prediction:
        run, metric = self.ran.trajectories[method], registered(method).unit == "metric"
        unit_m = 1.0 if metric else self.ran.units_m.get(method, 1.0)
        shift = unit_m * shift_m(run, predicted, "none" if metric else "sim3")
        now, then = self.ate_m(method, run), self.ate_m(method, predicted)
        return Prediction(method, shift, now, then, nonlinearity, predicted)

    def ate_m(self, method: str, trajectory: Trajectory) -> float | None:
        """ATE against the ground truth, aligned as in metrics.json; None without truth."""
        truth, rig = self.ran.truth, self.ran.rig
        if truth is None:
            return None
        error = error_against_truth(trajectory, truth, rig, alignment_of(registered(method).unit == "metric"))
        return None if error is None else error.ate_m


def corrects_its_lens(config: Any) -> bool:
    """Whether a method of these settings learns its own focal length during a run."""
    return isinstance(config, ModernMonocularConfig) and config.self_calibration


def adjustment_of(config: Any, scene: Scene) -> Adjustment:
    """What a method of these settings corrects in its own cameras, and over how many keyframes. A wrong calibration
    does not say how sure it is, see Perturbation.of_rig."""
    match config:
        case ModernStereoConfig():
            sigmas = config.pair_sigma(scene.rig.camera("left").fx)
            return Adjustment(tuple(sigmas.tolist()), config.loss_px, config.window)
        case ModernMonocularConfig():
            sigmas = LOSS * config.lens_sigma()
            return Adjustment(tuple(sigmas.tolist()), LOSS * config.noise_px, config.key_frames)
    return Adjustment((0.0,) * (PAIR if scene.is_pair else LENS))
