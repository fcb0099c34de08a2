"""Folders of runs as a stranger may hand them over: whole ones, and such as a killed run leaves."""

from __future__ import annotations

import os
from pathlib import Path

from ispom_app.cli.main import main
from ispom_app.engine.outputs import signature
from ispom_app.engine.run_folder.journal import COLUMNS, JOURNAL
from ispom_app.engine.run_folder.run_folder import MARKER, METRICS, RECORDING, STEPS
from ispom_app.views.rerun.rrd import whole_bytes

from ispom.io.whole import part_of
from tests.app import helpers
from tests.sequences.kitti_folder import make_drive


def complete_run(root: Path, frames: int = 6, recording: bool = False) -> Path:
    """The folder of a run of stand-ins."""
    drive, out = make_drive(root / "kitti", frames=frames), root / "run"
    words = ["run", str(drive), "--out", str(out), *([] if recording else ["--no-recording"])]
    assert main(words, helpers.build) == 0
    return out


def killed_run(root: Path, recording: bool = True) -> Path:
    """The same, as far as it came when it was killed: its tables and its recording have no end."""
    out = complete_run(root, recording=recording)
    (out / MARKER).write_text(f"The run has not ended, or was killed.\n{signature('run')}\n")
    methods = sorted(path.stem for path in out.glob("*.tum") if path.stem != "truth")
    rows = [(i, m, "left", "1.0", 100_000_000 * i, i, 0, 0, 0, 0, 0, 1) for i in range(4) for m in methods]
    lines = [COLUMNS, *rows]
    part_of(out / JOURNAL).write_text("".join(",".join(map(str, line)) + "\n" for line in lines))
    for path in [*out.glob("*.tum"), out / METRICS]:
        if path.stem != "truth":
            path.unlink()
    (out / STEPS).rename(part_of(out / STEPS))
    if recording:
        os.truncate(out / RECORDING, whole_bytes(out / RECORDING) - 7)
        (out / RECORDING).rename(part_of(out / RECORDING))
    return out
