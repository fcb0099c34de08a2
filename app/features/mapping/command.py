"""The command: a run's poses and images, or a laser's points, to a model in the run's folder."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
from rich.console import Console
from rich.table import Table

from ispom.errors import InputError, printable
from ispom.io.files import exists
from ispom.io.meshes import glb_bytes, open3d, surface_ply
from ispom.io.timed_points import timed_points_csv
from ispom.io.whole import create_file, part_of, require_no_links, write_whole
from ispom.reconstruction.model import Mesh, simplified
from ispom.types import TimedPoints, Trajectory

from ...engine.outputs import claim_folder
from ...engine.run_folder.made_map import MAP, MAP_NUMBERS, MAP_PREVIEW, MAP_RECORDING
from ...engine.run_folder.run_folder import RECORDING
from ...engine.signals import terminable
from ...presentation import colours
from ...session.review.recording import identity
from ...views.rerun.streams import APPLICATION
from ..headless.console import progress
from .inputs import Ran, read_ran
from .laser import TRUE, Placed, measured, placed
from .looks import (
    MAX_DEPTH_BASELINES,
    NEAREST_BASELINES,
    VOXELS_IN_NEAR_DEPTH,
    VOXELS_PER_BASELINE,
    Dense,
    DenseSettings,
    dense,
    has_pairs,
    looks,
    stereo_pairs,
)
from .options import Map

MESH, CLOUD, GLTF, MEASURED = "mesh.ply", "cloud.ply", "mesh.glb", "points.csv"
LASER_PICTURE = "laser.png"
PREVIEW_TRIANGLES = 150_000
"""Limit for what the page draws in addition to everything else."""
SHOWN_POINTS = 300_000
"""Most points of a laser's cloud in the Rerun viewer, taken evenly; the files have all points."""
POINT_M = 0.02


def write_dense(folder: Path, found: Dense) -> None:
    """Mesh and cloud as PLY, the mesh as glTF, and a smaller one for the page."""
    points, cloud = found.mesh.points, found.cloud
    write_whole(folder / MESH, surface_ply(points.xyz, points.normals, points.rgb, found.mesh.triangles))
    write_whole(folder / CLOUD, surface_ply(cloud.xyz, cloud.normals, cloud.rgb))
    for name, mesh in ((GLTF, found.mesh), (MAP_PREVIEW, simplified(found.mesh, PREVIEW_TRIANGLES))):
        of = mesh.points
        write_whole(folder / name, glb_bytes(of.xyz, of.normals, of.rgb, mesh.triangles))


def write_laser(folder: Path, points: TimedPoints, found: Mapping[str, Placed]) -> None:
    """The points as measured, and a PLY file for each method in its own world, without normals."""
    write_whole(folder / MEASURED, timed_points_csv(points))
    for name, each in found.items():
        if name != TRUE:
            rgb = np.broadcast_to(np.array(colours.of(name), np.uint8), (len(each.points), 3))
            xyz = each.points.xyz_in_world
            write_whole(folder / f"laser.{name}.ply", surface_ply(xyz, np.zeros_like(xyz), rgb))


def write_numbers(folder: Path, numbers: Mapping[str, Any]) -> None:
    write_whole(folder / MAP_NUMBERS, json.dumps(numbers, indent=2) + "\n")


def write_recording(folder: Path, run: Path, method: str, found: Dense | None, laser: Mapping[str, Placed]) -> None:
    """map.rrd: opened together with the run's run.rrd, it is part of that recording."""
    recording_id = identity(run / RECORDING) if exists(run / RECORDING) else None
    stream = rr.RecordingStream(APPLICATION, recording_id=recording_id)
    part = part_of(folder / MAP_RECORDING)
    try:
        create_file(part).close()  # Rerun itself would follow a link
        stream.save(str(part))
    except (OSError, RuntimeError) as error:
        raise InputError(
            f"{folder / MAP_RECORDING} cannot be written ({error}): make room, or give another --out"
        ) from None
    stream.log("world", rr.ViewCoordinates.RDF, static=True)
    if found is not None:
        stream.log(f"world/{method}/map", _mesh(found.mesh), static=True)
    for name, each in laser.items():
        if name != TRUE:
            step = max(1, len(each.points) // SHOWN_POINTS)
            xyz = each.points.xyz_in_world[::step]
            points = rr.Points3D(xyz, colors=colours.packed(colours.of(name)), radii=POINT_M)
            stream.log(f"world/{name}/laser", points, static=True)
    stream.disconnect()
    part.replace(folder / MAP_RECORDING)


def _mesh(mesh: Mesh) -> rr.Mesh3D:
    points = mesh.points
    return rr.Mesh3D(
        vertex_positions=points.xyz,
        triangle_indices=mesh.triangles,
        vertex_normals=points.normals,
        vertex_colors=points.rgb,
    )


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
    chosen = _chosen(options, ran, method) if options.dense else None
    laser = None if options.laser is None else measured(ran, options.laser, int(ran.file.options.get("seed") or 0))
    folder = options.out or options.run / MAP
    if options.out is None:
        require_no_links(options.run, folder / "any")
    claim_folder(folder, "map")
    found = None
    if chosen is not None:
        made_of = looks(ran.sequence, chosen.path, chosen.settings)
        with progress(len(made_of)) as advance:
            found = dense(made_of, chosen.settings, advance)
        write_dense(folder, found)
    points: dict[str, Placed] = {}
    if laser is not None:
        with progress(None) as advance:
            points = dict(placed(ran, laser, options.interpolate, advance))
        write_laser(folder, laser.points, points)
        if laser.unmeasured:
            _print_line(laser.unmeasured)
        _draw(options, points)
    write_recording(folder, options.run, method, found, points)
    write_numbers(folder, _numbers(method, options, chosen, found, points))
    _print(options, method, chosen, found, points)
    return 0


@dataclass(frozen=True, eq=False)
class _Chosen:
    """What the dense model is made with."""

    path: Trajectory
    settings: DenseSettings
    segment: tuple[int, list[int]] | None
    """Of a method with a unit of its own: the segment's index, and the number of poses of each segment."""


def _chosen(options: Map, ran: Ran, method: str) -> _Chosen:
    """InputError where the run does not allow what the options ask for."""
    segment = None
    if method in ran.own:
        index = ran.segment(method, options.segment)
        segment, path = (index, [len(part) for part in ran.own[method]]), ran.own[method][index]
    elif options.segment is not None:
        raise InputError(f"--segment is for methods with a unit of their own, and {method} is metric: leave it out")
    else:
        path = ran.paths[method]
    paired = segment is None and has_pairs(ran.sequence)
    depth_from = options.depth_from or ("stereo" if paired else "video")
    if depth_from != "video" and segment is not None:
        raise InputError(f"{method} has a unit of its own, and a pair's depth is in metres: give --depth-from video")
    if depth_from != "video":
        stereo_pairs(ran.sequence)
    if paired:
        baseline = ran.sequence.rig.baseline_m
        voxel = baseline / VOXELS_PER_BASELINE
    else:
        near = ran.near_depth(method, path)
        baseline, voxel = near / NEAREST_BASELINES, near / VOXELS_IN_NEAR_DEPTH
    settings = _settings(options, baseline, voxel)
    return _Chosen(path, replace(settings, depth_from=depth_from, as_given=not paired), segment)


def _settings(options: Map, baseline: float, voxel: float) -> DenseSettings:
    voxel = voxel if options.voxel_m is None else options.voxel_m
    depth = baseline * MAX_DEPTH_BASELINES if options.max_depth_m is None else options.max_depth_m
    for flag, value in (("voxel-m", voxel), ("max-depth-m", depth), ("memory-gb", options.memory_gb)):
        if not 0 < value < math.inf:
            raise InputError(f"--{flag} is {value:g}: give a positive number")
    return DenseSettings(baseline, voxel, depth, options.memory_gb, options.interpolate)


def _draw(options: Map, points: dict[str, Placed]) -> None:
    """Where the truth is known: what else is there to see."""
    folder = options.out or options.run / MAP
    if not any(each.true_world is not None for each in points.values()):
        return
    if find_spec("matplotlib") is None:
        _print_line("no picture of the laser's points: it is drawn with Matplotlib, run pip install 'ispom[plots]'")
        return
    from .laser import picture

    write_whole(folder / LASER_PICTURE, picture(points))


def _numbers(
    method: str, options: Map, chosen: _Chosen | None, found: Dense | None, points: dict[str, Placed]
) -> dict[str, Any]:
    numbers: dict[str, Any] = {"method": method, "interpolate": options.interpolate}
    if found is not None and chosen is not None:
        settings = chosen.settings
        if chosen.segment is None:
            sizes: dict[str, Any] = {"unit": "m", "voxel_m": settings.voxel, "max_depth_m": settings.max_depth}
        else:
            index, counts = chosen.segment
            sizes = {"unit": "own", "voxel": settings.voxel, "max_depth": settings.max_depth}
            sizes |= {"segment": index + 1, "segments": len(counts)}
        numbers["dense"] = {
            **sizes,
            "depth_from": settings.depth_from,
            "fused": found.fused,
            "skipped": found.skipped,
            "triangles": len(found.mesh),
            "points": len(found.cloud),
        }
    if points:
        numbers["laser"] = {name: each.numbers for name, each in points.items()}
    return numbers


def _print(options: Map, method: str, chosen: _Chosen | None, found: Dense | None, points: dict[str, Placed]) -> None:
    if found is not None and chosen is not None:
        skipped = f", {found.skipped} skipped" if found.skipped else ""
        _print_line(
            f"{found.fused} {LOOKS[chosen.settings.depth_from]} with the poses of {method}{skipped}: "
            f"{len(found.mesh)} triangles, {len(found.cloud)} points, {_unit(method, chosen)}"
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
    _print_line(f"in {options.out or options.run / MAP}")


def _unit(method: str, chosen: _Chosen) -> str:
    """What lengths are in, and of which segment the model is."""
    if chosen.segment is None:
        return "in metres"
    index, counts = chosen.segment
    if len(counts) == 1:
        return f"in the own unit of {method}"
    others = f"the other {len(counts) - 1} share no unit with it (--segment N)"
    return f"in the own unit of {method}, segment {index + 1} of {len(counts)} with {counts[index]} poses; {others}"


def _print_line(line: str) -> None:
    sys.stdout.write(f"{printable(line)}\n")
