"""`ispom perturb`: what an error of the calibration does to the trajectories of a run."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable
from dataclasses import asdict, fields
from typing import Any

from rich.console import Console
from rich.table import Table

from ispom.ensemble import build
from ispom.errors import InputError
from ispom.evaluation.sensitivity.perturbation import Perturbation
from ispom.io.rig import rig_text
from ispom.io.trajectories import tum_text
from ispom.io.whole import write_whole
from ispom.methods import with_dependencies
from ispom.settings import check
from ispom.types import Trajectory

from ...engine.outputs import claim_folder
from ...engine.playback import Builder, Playback
from ...engine.run_folder.run_file import read_run_file
from ...engine.signals import terminable
from ...presentation.texts import length, length_unit
from ...session.review.stored import stored_source
from ..headless.console import compile_first, progress
from .options import Perturb
from .predictor import Prediction, Predictor
from .ran import ran_in
from .rerun import Compared, compared
from .words import UNIT_STEPS, cell, perturbation_text, unit_of

WIDTH = 120


def perturb(options: Perturb, builder: Builder = build) -> int:
    """Prints the predictions, and with --rerun what became of them. InputError where the run lacks what it takes."""
    wrong = options.wrong
    check(wrong, "")
    if options.rerun and not wrong.nonzero:
        raise InputError("--rerun needs an error of the calibration: give one, such as --baseline-percent 1")
    predictor = Predictor.of(ran_in(options.run))
    if not wrong.nonzero:
        _print(_each(predictor))
        return 0
    predictions = predictor.predict(wrong)
    with terminable():
        again = _rerun(options, builder) if options.rerun else {}
    outcomes = {each.prediction.method: each for each in compared(predictor, predictions, again, wrong)}
    _print(_of(predictions, outcomes, wrong))
    if options.out is not None:
        claim_folder(options.out, "perturb")
        write_whole(options.out / "rig.yaml", rig_text(wrong.of_rig(predictor.ran.rig)))
        for each in predictions:
            write_whole(options.out / f"{each.method}.predicted.tum", tum_text(each.trajectory))
        for method, trajectory in again.items():
            write_whole(options.out / f"{method}.rerun.tum", tum_text(trajectory))
        numbers = [_numbers(each, outcomes.get(each.method)) for each in predictions]
        text = json.dumps({"perturbation": asdict(wrong), "methods": numbers}, indent=2)
        write_whole(options.out / "perturb.json", text + "\n")
    return 0


def _rerun(options: Perturb, builder: Builder) -> dict[str, Trajectory]:
    """The final trajectories with the wrong calibration."""
    run = read_run_file(options.run)
    sequence = options.wrong.of_sequence(stored_source(options.run, run, options.source).open())
    methods = with_dependencies(run.methods)
    playback = Playback(sequence, methods, run.configs(), builder)
    compile_first(methods, run.configs())
    with progress(len(sequence)) as advance:
        while playback.more():
            playback.step()
            advance()
    return dict(playback.finish().trajectories)


def _of(predictions: Iterable[Prediction], outcomes: dict[str, Compared], wrong: Perturbation) -> Table:
    """One perturbation: a row for each method."""
    table = Table(title=perturbation_text(wrong))
    names = ["method", "moves by", "ATE of the run", "predicted ATE", "linear"]
    for name in names + ["rerun moves by", "its ATE", "predicted / rerun"] * bool(outcomes):
        table.add_column(name, justify="left" if name == "method" else "right")
    predictions = list(predictions)
    unit = unit_of(predictions, outcomes.values())
    for each in predictions:
        cells = [each.method, *(cell(value, unit) for value in (each.shift_m, each.ate_m, each.predicted_ate_m))]
        cells.append("rough" if each.left_out else "yes" if each.linear else f"no ({each.nonlinearity:.1f})")
        outcome = outcomes.get(each.method)
        if outcome is not None:
            cells += [cell(outcome.shift_m, unit), cell(outcome.ate_m, unit), f"{outcome.ratio:.2f}"]
        table.add_row(*cells)
    return table


def _each(predictor: Predictor) -> Table:
    """Without a perturbation: how far one step of each field moves the trajectories."""
    table = Table(title="How far an error of the calibration moves the trajectories (root mean square)")
    table.add_column("error")
    methods = [each.method for each in predictor.predict(Perturbation())]
    for method in methods:
        table.add_column(method, justify="right")
    wrongs = [Perturbation(**{field.name: UNIT_STEPS[field.name]}) for field in fields(Perturbation)]
    shifts = [[each.shift_m for each in predictor.predict(wrong)] for wrong in wrongs]
    unit = length_unit(shift for row in shifts for shift in row)
    for wrong, row in zip(wrongs, shifts, strict=True):
        table.add_row(perturbation_text(wrong), *(length(shift, unit) for shift in row))
    return table


def _numbers(each: Prediction, outcome: Compared | None) -> dict[str, Any]:
    found: dict[str, Any] = {
        "method": each.method,
        "shift_m": each.shift_m,
        "rmse_m": each.ate_m,
        "predicted_rmse_m": each.predicted_ate_m,
        "rough": bool(each.left_out),
        "left_out": each.left_out,
        "linear": each.linear,
        "nonlinearity": each.nonlinearity,
    }
    if outcome is not None:
        found |= {"rerun_shift_m": outcome.shift_m, "rerun_rmse_m": outcome.ate_m, "held": outcome.agrees}
    return found


def _print(table: Table) -> None:
    Console(file=sys.stdout, width=None if sys.stdout.isatty() else WIDTH).print(table)
