"""Options of `ispom perturb`."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from ispom.evaluation.sensitivity.perturbation import Perturbation

from ...engine.options import MovedSource, Programs, ReadsRuns


@dataclass(frozen=True, kw_only=True)
class Perturb(Programs, ReadsRuns, MovedSource):
    """Predicts what an error of the calibration does to the trajectories of a run, from what the run saw. Without an
    error: what one step of each would do."""

    run: tyro.conf.Positional[Path]
    """Folder that `ispom run` wrote."""
    wrong: Annotated[Perturbation, tyro.conf.arg(name="", prefix_name=False)] = field(default_factory=Perturbation)
    rerun: bool = False
    """Run again with the wrong calibration, and show that together with the prediction."""
    out: Path | None = None
    """Folder for the predicted trajectories (and those of the rerun), the perturbed rig.yaml, and all numbers."""
