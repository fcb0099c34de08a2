"""Predicting what an error of the calibration would do, and running with it."""

from __future__ import annotations

from typing import ClassVar

from ispom.evaluation.sensitivity.perturbation import Perturbation

from ...session.commands import Command
from ...session.controller import Controller
from .service import EffectService


class Predict(Command, frozen=True):
    """What this error of the calibration would do to the run that is shown, as far as it is computed."""

    wrong: Perturbation
    newest_only: ClassVar[bool] = True

    def execute(self, session: Controller) -> None:
        session.service(EffectService).predict(self.wrong)


class RunPerturbed(Command, frozen=True):
    """Run it again from the first frame, as a branch, with the error that was predicted last."""

    def execute(self, session: Controller) -> None:
        session.service(EffectService).rerun()
        session.store.set(playing=True)
