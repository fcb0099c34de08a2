"""The files of a map: for other tools, for the Rerun viewer, and for the page."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr

from ispom.errors import InputError
from ispom.io.files import exists
from ispom.io.meshes import glb_bytes
from ispom.io.ply import surface_ply
from ispom.io.timed_points import timed_points_csv
from ispom.io.whole import create_file, part_of, write_whole
from ispom.reconstruction.model import Mesh, simplified
from ispom.types import TimedPoints

from ...engine.run_folder.made_map import MAP_NUMBERS, MAP_PREVIEW, MAP_RECORDING
from ...engine.run_folder.run_folder import RECORDING
from ...presentation import colours
from ...session.review.recording import identity
from ...views.rerun.streams import APPLICATION
from .laser import TRUE, Placed
from .looks import Dense

MESH, CLOUD, GLTF, MEASURED = "mesh.ply", "cloud.ply", "mesh.glb", "points.csv"
LASER_PICTURE = "laser.png"
PREVIEW_TRIANGLES = 150_000
"""Of what the page draws beside everything else."""
SHOWN_POINTS = 300_000
"""Of a laser's cloud in the Rerun viewer, evenly; the files have all."""
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
