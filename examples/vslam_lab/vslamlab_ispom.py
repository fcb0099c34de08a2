"""Runs a method of ISPOM as VSLAM-LAB starts a baseline, and writes the trajectory that it looks for.

VSLAM-LAB gives `--sequence_path --calibration_yaml --rgb_csv --exp_folder --exp_it --settings_yaml --mode`, and further
`--NAME VALUE` of an experiment's parameters. The run is kept in `EXP_FOLDER/NNNNN_ispom/run`: `ispom app` opens it.
"""

from __future__ import annotations

import argparse
import csv
import shutil
import subprocess
import sys
from pathlib import Path

import yaml

METHODS = {"mono": "monocular", "stereo": "stereo"}
"""Of each mode, where the settings name no other method."""


def main() -> int:
    parser = argparse.ArgumentParser(description="A baseline for VSLAM-LAB.")
    for name in ("sequence_path", "calibration_yaml", "rgb_csv", "exp_folder"):
        parser.add_argument(f"--{name}", type=Path, required=True)
    parser.add_argument("--exp_it", type=int, default=0)
    parser.add_argument("--settings_yaml", type=Path)
    parser.add_argument("--mode", choices=sorted(METHODS), default="mono")
    options, _ = parser.parse_known_args()  # others, such as --verbose, say nothing to a method

    settings = yaml.safe_load(options.settings_yaml.read_text()) if options.settings_yaml else None
    chosen = (settings or {}).get(options.mode) or {}
    method, words = chosen.get("method", METHODS[options.mode]), list(map(str, chosen.get("options", [])))

    work = options.exp_folder / f"{options.exp_it:05d}_ispom"
    shutil.rmtree(work, ignore_errors=True)
    sequence, run = work / "sequence", work / "run"
    sequence.mkdir(parents=True)
    shutil.copyfile(options.calibration_yaml, sequence / "calibration.yaml")
    columns = 2 if options.mode == "mono" else 4  # of the first camera, or of both
    write_listing(options.rgb_csv, sequence / "rgb.csv", options.sequence_path.resolve(), columns)

    ispom("run", sequence, "--methods", method, "--no-recording", "--out", run, *words)
    ispom("export", run, "--format", "vslam-lab", "--methods", method, "--out", work / "export")
    trajectory = work / "export" / method / "00000_KeyFrameTrajectory.csv"
    shutil.copyfile(trajectory, options.exp_folder / f"{options.exp_it:05d}_KeyFrameTrajectory.csv")
    return 0


def write_listing(source: Path, target: Path, folder: Path, columns: int) -> None:
    """Copies a list of images. Their paths become whole ones, as the copy is in another folder."""
    with source.open(newline="") as file:
        head, *rows = csv.reader(file)
    taken = [i for i, name in enumerate(head) if "rgb" in name][:columns]
    with target.open("w", newline="") as file:
        out = csv.writer(file)
        out.writerow([head[i] for i in taken])
        for row in rows:
            out.writerow([str(folder / row[i]) if head[i].startswith("path_") else row[i] for i in taken])


def ispom(*words: object) -> None:
    """Runs a command of ISPOM; where it fails, its sentence is on standard error, and this program ends."""
    found = subprocess.run([sys.executable, "-m", "ispom_app", *map(str, words)], check=False)
    if found.returncode:
        sys.exit(found.returncode)


if __name__ == "__main__":
    sys.exit(main())
