"""Makes the data of the gallery's plots: `python -m tests.docs.gallery_runs` writes docs/gallery/NAME.json.

Each run is a command of the gallery: the paths after the alignment of the report, and the error along them. All sources
are simulations, so that the ground truth is exact and no recording of others is copied.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import ispom
from ispom.evaluation.trajectory_error import alignment_of, error_against_truth
from ispom.methods import method

FOLDER = Path(__file__).parents[2] / "docs" / "gallery"
COUNT, DIGITS = 200, 4
"""Points of each curve, and decimals [m]."""


@dataclass(frozen=True)
class Run:
    source: str
    methods: tuple[str, ...]


RUNS = {
    "rates": Run("sim:city", ("monocular", "stereo", "integrated")),
    "published": Run("sim:tiny", ("monocular.paper", "stereo.paper", "integrated.paper", "integrated")),
    "survey": Run("sim:tiny", ("lines", "direct", "hybrid", "trifocal")),
}


def measured(run: Run) -> dict[str, object]:
    """Runs all methods to the end. Returns `truth` as [x, z] and, by method, time [s], place and position error [m]."""
    sequence = ispom.open_sequence(run.source)
    assert sequence.truth is not None
    ensemble = ispom.build(ispom.Config(), run.methods, sequence.rig)
    state = ensemble.start()
    for i in range(len(sequence)):
        state, _ = ensemble.step(state, sequence[i])
    curves = {}
    for name, trajectory in ensemble.finish(state).items():
        kind = alignment_of(method(name).unit == "metric")
        error = error_against_truth(trajectory, sequence.truth, sequence.rig, kind)
        assert error is not None, name
        few = np.unique(np.linspace(0, len(error.estimate) - 1, COUNT).astype(int))
        positions = error.aligned.translations[few]
        curves[name] = {
            "time": np.round((error.estimate.times_ns[few] - sequence.times_ns[0]) / 1e9, 3).tolist(),
            "x": np.round(positions[:, 0], DIGITS).tolist(),
            "z": np.round(positions[:, 2], DIGITS).tolist(),
            "error": np.round(error.position_errors_m[few], DIGITS + 2).tolist(),
        }
    few = np.unique(np.linspace(0, len(sequence.truth) - 1, COUNT).astype(int))
    truth = sequence.truth.translations[few]
    return {
        "command": f"ispom run '{run.source}' --methods {' '.join(run.methods)}",
        "truth": {"x": np.round(truth[:, 0], DIGITS).tolist(), "z": np.round(truth[:, 2], DIGITS).tolist()},
        "methods": curves,
    }


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for name, run in RUNS.items():
        (FOLDER / f"{name}.json").write_text(json.dumps(measured(run)) + "\n", encoding="utf-8")
