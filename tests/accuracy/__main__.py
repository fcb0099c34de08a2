"""`python -m tests.accuracy STUDY`: studies of what the methods get wrong, over many seeds. They take minutes to hours.

figures: the error, frames located and segments of each method on each recording in --data and on sim:tiny, sim:city and
    sim:indoor. Rewrites tests/accuracy/figures.json, by which test_figures.py notices what has become worse; entries
    that are not measured stay. --only and --methods choose.
benchmark: error, drift, time for a frame and failures of the same methods on the same recordings. With --release
    VERSION it writes the record of this version to docs/evaluation/records, once, and docs/evaluation/benchmark.md from
    all records. With --table alone it writes that page from the records, and measures nothing.
consistency: whether the covariances of the poses agree with their errors, over seeds of three simulations; with exact
    cameras, and with cameras whose calibration is wrong by what the methods allow for.
uncertainty: the same in one number of every method that states a covariance, over seeds of what its sensors are
    simulated for; of fused and its kin by scheme of Table 2. Rewrites tests/accuracy/uncertainty.json, which the table
    of docs/evaluation/consistency.md is made of; methods that are not measured stay. --methods chooses.
gaps: whether monocular and stereo are localised after 1 to 7 s without images, in which the camera may turn; sim:city
    (three seeds), sim:town, and KITTI 06 if it is in --data.
loops: whether monocular and stereo find a loop after 541 m through sim:town, their error there with and without it, and
    whether they find false ones where houses are the same and nothing returns.
starts: whether the first map of monocular is right, started at many frames of sim:city, sim:indoor and sim:tiny, and of
    KITTI 06, KITTI 00 and handheld_board if they are in --data.
cameras: the errors of the modern methods on one flight (16 seeds) filmed by other cameras: 4K, 12 bits, variable
    rate, portrait, fisheye, rolling shutter. Rendering takes half an hour.
scale: whether the scale within a segment of monocular changes by no more than the method states and promises, on each
    recording with truth. --only chooses.
soak: whether time and memory per frame grow in a long run over small made images.
audit: what `ispom evaluate` says of mistakes that are planted in right pairs of trajectories: other programs' that are
    in --data, and simulated ones. --only chooses.
budget: whether `ispom budget` gives planted causes their true shares of the error, in twenty simulations.
sensors: what the doctor says of a wrong clock, mount, unit or bias that is planted in the sensors of simulations, and
    of KITTI 00 and EuRoC if they are in --data. --only chooses.
judge: from which size on `ispom judge` finds mistakes that are planted in the true poses of recordings in --data and of
    simulations. --only chooses.
blocks: times of the building blocks: the adjustment of a window, rendering, logging, opening; and of the unit U, a
    fixed tracking task that makes times of machines comparable. (Of methods: ispom experiment speed.)
"""

from __future__ import annotations

import argparse
import sys
from importlib.metadata import version
from pathlib import Path

from ispom_app.engine.outputs import json_text
from rich.console import Console

from ispom.methods import names

from .records import FOLDER, PAGE, STUDY, record_path
from .soak import MIN_EXPOSURES
from .studies import STUDIES, Options


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study", choices=STUDIES)
    parser.add_argument("--data", type=Path, default=Path("../shared/data"), help="the folder of recordings")
    parser.add_argument("--methods", nargs="+", choices=names(), default=[], help="only these methods")
    parser.add_argument(
        "--only", nargs="+", default=[], metavar="NAME", help="only these recordings, or pairs of audit"
    )
    parser.add_argument("--seeds", type=int, default=20, help="number of seeds of consistency, uncertainty and loops")
    parser.add_argument("--frames", type=int, default=20_000, help="frames of each run of soak")
    parser.add_argument("--table", type=Path, help="write the table of a study to this page")
    parser.add_argument("--release", default="", metavar="VERSION", help="the version whose record benchmark writes")
    parser.add_argument("--json", type=Path, help="write the rows to this file")
    given = parser.parse_args(arguments)
    if not 2 <= given.seeds <= 1000:
        parser.error(f"--seeds is {given.seeds}: give a value from 2 to 1000")
    if given.frames < MIN_EXPOSURES:
        parser.error(f"--frames is {given.frames}: give at least {MIN_EXPOSURES}")
    if given.release and (why := refusal(given)):
        parser.error(why)
    console = Console(highlight=False, markup=False, soft_wrap=True)
    options = Options(
        given.data,
        tuple(given.methods),
        given.seeds,
        given.frames,
        tuple(given.only),
        table=given.table,
        release=given.release,
    )
    rows = STUDIES[given.study](console, options)
    if given.json is not None:
        given.json.write_text(json_text(rows, 2))
    return 0


def refusal(given: argparse.Namespace) -> str:
    """Returns why no record of this release is written; empty where it is."""
    if given.study != STUDY:
        return f"--release belongs to {STUDY}"
    if given.release != version("ispom"):
        return f"--release is {given.release}, but this is version {version('ispom')}"
    path = record_path(given.release, (given.table or PAGE).parent / FOLDER)
    return f"{path} exists: a record is written once, and never changed" if path.exists() else ""


if __name__ == "__main__":
    sys.exit(main())
