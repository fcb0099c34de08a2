"""The command: a run's poses and images, or a laser's points, to a model in the run's folder."""

from __future__ import annotations

import math
import sys
from importlib.util import find_spec
from typing import Any

from rich.console import Console
from rich.table import Table

from ispom.errors import InputError, printable
from ispom.io.open3d import open3d
from ispom.io.whole import require_no_links, write_whole

from ...engine.outputs import claim_folder
from ...engine.run_folder.made_map import MAP
from ...engine.signals import terminable
from ..headless.console import progress
from .inputs import Ran, read_ran
from .laser import Placed, measured, placed
from .looks import MAX_DEPTH_BASELINES, VOXELS_PER_BASELINE, Dense, DenseSettings, dense, looks, stereo_pairs
from .options import Map
from .output import LASER_PICTURE, write_dense, write_laser, write_numbers, write_recording

WIDTH = 120
LOOKS = {"stereo": "stereo pairs", "video": "video images", "both": "stereo pairs and video images"}


def make_map(options: Map) -> int:
    """Writes mesh, cloud and registered points, and prints what they are. InputError where the run lacks what they
    take."""
    if not options.dense and options.laser is None:
        raise InputError("--no-dense without --laser leaves nothing to do: give one of them")
    with terminable():
        return _make_map(options)


def _make_map(options: Map) -> int:
    ran = read_ran(options.run, options.source)
    method = ran.method(options.method)
    if options.dense:
        open3d()  # before long work
    settings = _settings(options, ran) if options.dense else None
    laser = None if options.laser is None else measured(ran, options.laser, int(ran.file.options.get("seed") or 0))
    folder = options.out or options.run / MAP
    if options.out is None:
        require_no_links(options.run, folder / "any")
    claim_folder(folder, "map")
    found = None
    if settings is not None:
        made_of = looks(ran.sequence, ran.paths[method], settings)
        with progress(len(made_of)) as advance:
            found = dense(made_of, settings, advance)
        write_dense(folder, found)
    points: dict[str, Placed] = {}
    if laser is not None:
        with progress(None) as advance:
            points = dict(placed(ran, laser, options.interpolate, advance))
        write_laser(folder, laser.points, points)
        if laser.unmeasured:
            _say(laser.unmeasured)
        _draw(options, points)
    write_recording(folder, options.run, method, found, points)
    write_numbers(folder, _numbers(method, options, settings, found, points))
    _print(options, method, found, points)
    return 0


def _settings(options: Map, ran: Ran) -> DenseSettings:
    stereo_pairs(ran.sequence)
    baseline_m = ran.sequence.rig.baseline_m
    voxel_m = baseline_m / VOXELS_PER_BASELINE if options.voxel_m is None else options.voxel_m
    depth_m = baseline_m * MAX_DEPTH_BASELINES if options.max_depth_m is None else options.max_depth_m
    for flag, value in (("voxel-m", voxel_m), ("max-depth-m", depth_m), ("memory-gb", options.memory_gb)):
        if not 0 < value < math.inf:
            raise InputError(f"--{flag} is {value:g}: give a positive number")
    return DenseSettings(voxel_m, depth_m, options.memory_gb, options.interpolate, options.depth_from)


def _draw(options: Map, points: dict[str, Placed]) -> None:
    """Where the truth is known: what else is there to see."""
    folder = options.out or options.run / MAP
    if not any(each.true_world is not None for each in points.values()):
        return
    if find_spec("matplotlib") is None:
        _say("no picture of the laser's points: it is drawn with Matplotlib, run 'pip install matplotlib'")
        return
    from .laser import picture

    write_whole(folder / LASER_PICTURE, picture(points))


def _numbers(
    method: str, options: Map, settings: DenseSettings | None, found: Dense | None, points: dict[str, Placed]
) -> dict[str, Any]:
    numbers: dict[str, Any] = {"method": method, "interpolate": options.interpolate}
    if found is not None and settings is not None:
        numbers["dense"] = {
            "voxel_m": settings.voxel_m,
            "max_depth_m": settings.max_depth_m,
            "depth_from": settings.depth_from,
            "fused": found.fused,
            "skipped": found.skipped,
            "triangles": len(found.mesh),
            "points": len(found.cloud),
        }
    if points:
        numbers["laser"] = {name: each.numbers for name, each in points.items()}
    return numbers


def _print(options: Map, method: str, found: Dense | None, points: dict[str, Placed]) -> None:
    if found is not None:
        skipped = f", {found.skipped} skipped" if found.skipped else ""
        _say(
            f"{found.fused} {LOOKS[options.depth_from]} with the poses of {method}{skipped}: "
            f"{len(found.mesh)} triangles, {len(found.cloud)} points"
        )
    if points:
        table = Table(title=f"Laser points, poses interpolated by {options.interpolate}")
        for name in ("method", "poses/s", "points", "RMS error", "median", "95 %"):
            table.add_column(name, justify="left" if name == "method" else "right")
        for name, each in points.items():
            values = each.numbers
            errors = [f"{100 * values[k]:.1f} cm" if k in values else "" for k in ("rmse_m", "median_m", "p95_m")]
            table.add_row(name, f"{each.poses_hz:.1f}", str(len(each.points)), *errors)
        Console(file=sys.stdout, width=None if sys.stdout.isatty() else WIDTH).print(table)
    _say(f"in {options.out or options.run / MAP}")


def _say(line: str) -> None:
    sys.stdout.write(f"{printable(line)}\n")
