"""Makes recordings/demo.rrd: `python -m tests.app.demo_recording`. It takes a minute."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

RECORDING = Path(__file__).parents[2] / "recordings" / "demo.rrd"


def make(recording: Path) -> None:
    """Runs the default methods over two seconds of sim:tiny, and packs the recording of the run."""
    with TemporaryDirectory() as folder:
        run = Path(folder) / "demo"
        subprocess.run(
            [sys.executable, "-m", "ispom_app", "run", "sim:tiny", "--max-exposures", "60", "--out", str(run)],
            check=True,
        )
        rerun = Path(sys.executable).with_name("rerun")
        subprocess.run([rerun, "rrd", "optimize", run / "run.rrd", "-o", str(recording)], check=True)
        subprocess.run([rerun, "rrd", "verify", recording], check=True)


if __name__ == "__main__":
    make(RECORDING)
