"""What the commands work on: a simulation, a run of it, and a run that was killed."""

from __future__ import annotations

import time
from pathlib import Path

from .commands import Inputs
from .run import ispom


def made_inputs(folder: Path, source: str = "sim:tiny", exposures: int = 40) -> Inputs:
    """Makes them with the program itself. RuntimeError where it fails."""
    inputs = Inputs(folder, source, ("monocular", "stereo", "integrated"), exposures)
    process = ispom(["run", *inputs.of_run, "--out", str(inputs.run)], folder)
    if process.wait():
        raise RuntimeError(f"the run failed: {(folder / 'stderr').read_text()}")
    process = ispom(["run", *inputs.of_run, "--out", str(inputs.killed)], folder)
    while process.poll() is None and not _rows(inputs.killed) > exposures // 2:
        time.sleep(0.005)
    process.kill()
    process.wait()
    return inputs


def _rows(run: Path) -> int:
    steps = run / ".part-steps.csv"
    return steps.read_bytes().count(b"\n") if steps.exists() else 0
