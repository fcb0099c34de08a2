"""`ispom export`: what a run found, in the formats of other tools."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import yaml

from ispom.errors import InputError
from ispom.estimators import ALL_METHODS
from ispom.io.colmap import colmap_model
from ispom.io.euroc import euroc_text
from ispom.io.kitti import poses_text
from ispom.io.maps import read_maps
from ispom.io.ply import ply_bytes
from ispom.io.rig import read_rig
from ispom.io.rows import read_text
from ispom.io.tables import landmarks_csv, trajectory_csv
from ispom.io.tum import read_tum, seconds_text, tum_text
from ispom.io.whole import write_whole
from ispom.types import Frame, Trajectory

from .colours import METHOD
from .options import Export
from .run.run_folder import MARKER

Files = dict[str, str | bytes]
FRAMES: tuple[Frame, ...] = ("rig", "left", "video")


def export(options: Export) -> int:
    """Writes one method after the other; InputError where the folder is no run, or lacks what the format needs."""
    run = options.run
    frame = _frame(run)
    methods = _methods(options)
    folder = options.out or run / "export" / options.format
    lines = [f"{run} is not complete: what there is of it is exported"] if (run / MARKER).exists() else []
    for method in methods:
        files, told = _files(options, method, frame)
        for name, content in files.items():
            write_whole(folder / name, content)
        lines.append(f"{method:<11} {told}: {', '.join(files)}")
    sys.stdout.write("\n".join([*lines, f"in {folder}"]) + "\n")
    return 0


def _frame(run: Path) -> Frame:
    """Whose poses the run's trajectories hold."""
    if not (run / "run.yaml").is_file():
        raise InputError(f"{run} is no folder of a run (it has no run.yaml): give one that `ispom run` wrote")
    try:
        frame: Any = yaml.safe_load(read_text(run / "run.yaml"))["options"]["frame"]
    except (yaml.YAMLError, ValueError, TypeError, KeyError, RecursionError):
        frame = None
    if frame not in FRAMES:
        raise InputError(f"{run / 'run.yaml'} does not tell the frame of the poses: run again")
    return frame


def _methods(options: Export) -> list[str]:
    present = [m for m in ALL_METHODS if (options.run / f"{m}.tum").exists()]
    missing = [m for m in options.methods if m not in present]
    if missing or not present:
        raise InputError(f"{options.run} has no trajectory of {missing[0] if missing else 'any method'}: run it first")
    return [m for m in present if not options.methods or m in options.methods]


def _files(options: Export, method: str, frame: Frame) -> tuple[Files, str]:
    """The files of one method by name, and what they hold."""
    if options.format == "colmap":
        return _colmap(options.run, method)
    trajectory = read_tum(options.run / f"{method}.tum", frame)
    unit = "a unit of its own" if method == "monocular" else "metres"
    told = f"{len(trajectory)} poses world_from_{frame} in {unit}"
    match options.format:
        case "tum":
            return {f"{method}.tum": tum_text(trajectory)}, told
        case "kitti":
            return {f"{method}.txt": poses_text(trajectory), f"{method}_times.txt": _times(trajectory)}, told
        case "euroc":
            return {f"{method}.csv": euroc_text(trajectory)}, told
    scene = read_maps(options.run / "landmarks.npz").get(method)
    if scene is None:
        raise InputError(f"{options.run / 'landmarks.npz'} has no points of {method}: run again")
    told = f"{told}, {len(scene.landmarks)} points"
    if options.format == "ply":
        return {f"{method}.ply": ply_bytes(scene.landmarks, trajectory, METHOD[method])}, told
    tables: Files = {f"{method}.csv": trajectory_csv(trajectory)}
    return tables | {f"{method}_landmarks.csv": landmarks_csv(scene.landmarks)}, told


def _colmap(run: Path, method: str) -> tuple[Files, str]:
    scene, rig = read_maps(run / "landmarks.npz").get(method), read_rig(run / "rig.yaml")
    if scene is None or getattr(rig, scene.key_frames.frame) is None:
        raise InputError(f"{run} has no points of {method}, or not their camera: run again")
    model = colmap_model(scene, rig.camera(scene.key_frames.frame))
    files: Files = {"cameras.txt": model.cameras, "images.txt": model.images, "points3D.txt": model.points}
    error = "" if model.mean_error_px is None else f", mean reprojection error {model.mean_error_px:.2f} px"
    told = f"{len(scene.key_frames)} images, {model.point_count} points, {model.kept} of {model.observations} "
    return {f"{method}/{name}": content for name, content in files.items()}, f"{told}observations fit{error}"


def _times(trajectory: Trajectory) -> str:
    return "".join(f"{seconds_text(t)}\n" for t in trajectory.times_ns.tolist())
