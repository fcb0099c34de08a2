"""The commands that get signals: what each needs, its words, and how what it left behind is read."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

from ispom_app.cli.main import main
from ispom_app.engine.run_folder.made_map import MAP_NUMBERS
from ispom_app.engine.run_folder.run_folder import MARKER, RUN, is_incomplete
from ispom_app.engine.run_folder.table import read_table

from ispom.io.rig import read_rig
from ispom.io.trajectories import read_tum

PLAN = """title: Two methods
sources: [SOURCE]
seeds: 0-1
lines:
  A: {method: stereo.paper}
quantities: [ate_m]
"""


@dataclass(frozen=True)
class Inputs:
    """What the commands work on."""

    folder: Path
    source: str
    """A recording with both cameras."""
    methods: tuple[str, ...]
    exposures: int

    @property
    def run(self) -> Path:
        """A complete run of the source."""
        return self.folder / "run"

    @property
    def killed(self) -> Path:
        """A run that was killed."""
        return self.folder / "killed"

    @property
    def of_run(self) -> list[str]:
        return [self.source, "--methods", *self.methods, "--max-exposures", str(self.exposures)]


@dataclass(frozen=True)
class Command:
    """One command of the program."""

    prepare: Callable[[Inputs, Path], None]
    """Makes in an empty folder what the command changes."""
    words: Callable[[Inputs, Path], list[str]]
    fault: Callable[[Path], str]
    """What is wrong with the files that it left in the folder; empty where nothing is."""


def _nothing(inputs: Inputs, out: Path) -> None:
    """Most commands begin with an empty folder."""


def _run_fault(out: Path) -> str:
    """A run's folder is complete, or can be repaired."""
    return _folder_fault(out / "run") if (out / "run").exists() else ""


def _folder_fault(run: Path) -> str:
    if not is_incomplete(run) and not (run / RUN).exists():
        left = sorted(path.name for path in run.iterdir())
        return f"{run.name} is neither complete nor marked as incomplete: it holds {left}" if left else ""
    said = StringIO()
    with redirect_stdout(said), redirect_stderr(said):
        code = main(["repair", str(run)])
    if code:
        return f"{run.name} cannot be repaired: {said.getvalue()}"
    for path in run.glob("*.tum"):
        read_tum(path)
    for path in run.glob("*.csv"):
        list(read_table(path))
    return ""


def _experiment_fault(out: Path) -> str:
    """Each run is complete or can be repaired, and the same command goes on where this one stopped."""
    runs = sorted({path.parent for name in (MARKER, RUN) for path in (out / "experiment").rglob(name)})
    return "; ".join(filter(None, map(_folder_fault, runs)))


def _calibration_fault(out: Path) -> str:
    if (out / "rig.yaml").exists():
        read_rig(out / "rig.yaml")
    if (out / "numbers.json").exists():
        json.loads((out / "numbers.json").read_text())
    return ""


def _map_fault(out: Path) -> str:
    """Each file is whole: it got its name when it was complete."""
    for path in (out / "map").glob("*.ply"):
        head, _, body = path.read_bytes().partition(b"end_header\n")
        if not head.startswith(b"ply") or not body:
            return f"{path.name} is not whole"
    if (out / "map" / MAP_NUMBERS).exists():
        json.loads((out / "map" / MAP_NUMBERS).read_text())
    return ""


def _copy_killed(inputs: Inputs, out: Path) -> None:
    shutil.copytree(inputs.killed, out / "run")


def _write_plan(inputs: Inputs, out: Path) -> None:
    plan = PLAN.replace("SOURCE", json.dumps(inputs.source)) + f"max_exposures: {inputs.exposures}\n"
    (out / "plan.yaml").write_text(plan)


COMMANDS = {
    "run": Command(_nothing, lambda given, out: ["run", *given.of_run, "--out", str(out / "run")], _run_fault),
    "fork": Command(
        _nothing,
        lambda given, out: ["fork", str(given.run), "--at", str(given.exposures // 3), "--out", str(out / "run")],
        _run_fault,
    ),
    "calibrate": Command(
        _nothing,
        lambda given, out: [
            *("calibrate", "video", "sim:calibration?views=12", "--target", "chessboard:9x6:0.03"),
            *("--out", str(out / "rig.yaml"), "--json", str(out / "numbers.json")),
        ],
        _calibration_fault,
    ),
    "experiment": Command(
        _write_plan,
        lambda given, out: [
            *("experiment", str(out / "plan.yaml"), "--out", str(out / "experiment"), "--workers", "2"),
        ],
        _experiment_fault,
    ),
    "map": Command(_nothing, lambda given, out: ["map", str(given.run), "--out", str(out / "map")], _map_fault),
    "repair": Command(_copy_killed, lambda given, out: ["repair", str(out / "run")], _run_fault),
}
