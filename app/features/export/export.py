"""`ispom export`: what a run found, in the formats of other tools."""

from __future__ import annotations

import math
import sys
from pathlib import Path

from ispom.errors import InputError, printable
from ispom.io.colmap import colmap_model
from ispom.io.colmap_binary import colmap_binary
from ispom.io.files import exists
from ispom.io.kitti import poses_text
from ispom.io.maps import read_maps
from ispom.io.meshes import ply_bytes
from ispom.io.rig import read_rig
from ispom.io.trajectories import (
    euroc_text,
    landmarks_csv,
    read_tum,
    seconds_text,
    trajectory_csv,
    tum_text,
    vslam_lab_text,
    world_lines_csv,
)
from ispom.io.whole import require_no_links, write_whole
from ispom.methods import GROUPS, members, names
from ispom.methods import method as registered
from ispom.types import FrameName, Trajectory

from ...engine.outputs import claim_folder
from ...engine.run_folder.results import in_frame
from ...engine.run_folder.run_file import read_run_file
from ...engine.run_folder.run_folder import MARKER
from ...presentation import colours
from .options import Export
from .panorama import panorama_png
from .scenes import Files, mcap_files, nerfstudio_files, scene_of, settings_files

OF_RUN = ("kalibr", "orbslam")
"""Formats whose files are those of the run, not of a method."""
VSLAM_LAB_FILE = "00000_KeyFrameTrajectory.csv"
"""Name that VSLAM-LAB looks for; the digits are the number of the iteration."""
MOST_NAMED = 8
"""Files of a method that are printed."""
MIN_SHARE = 0.8
"""A COLMAP model of less of the observations is not what the run saw."""


def export(options: Export) -> int:
    """Writes one method after the other; InputError where the folder is no run, or, when all others are written, of the
    first method that lacks what the format needs."""
    run = options.run
    frame = read_run_file(run).frame
    methods = _methods(options)
    methods = methods[:1] if options.format in OF_RUN else methods
    if not 0 < options.max_error_px < math.inf:
        raise InputError(f"--max-error-px is {options.max_error_px}: give a positive number of pixels")
    folder = options.out or run / "export" / options.format
    if exists(run / MARKER):
        _print(f"{run} is not complete: the part that was computed is exported")
    failures: list[InputError] = []
    for method in methods:
        try:
            files, summary = _files(options, method, frame)
        except InputError as error:
            failures.append(error)
            continue
        if options.out is None:
            require_no_links(run, folder / "any")
        claim_folder(folder, f"export {options.format}")
        for name, content in files.items():
            require_no_links(run if options.out is None else folder, folder / name)
            write_whole(folder / name, content)
        named = [*files] if len(files) <= MOST_NAMED else [*[*files][:MOST_NAMED], "..."]
        _print(f"{method}: {summary}: {', '.join(named)}")
    if len(failures) < len(methods):
        _print(f"in {folder}")
    if failures:
        raise failures[0]
    return 0


def _print(line: str) -> None:
    sys.stdout.write(f"{printable(line)}\n")


def _methods(options: Export) -> list[str]:
    present = [m for m in names() if exists(options.run / f"{m}.tum")]
    missing = [m for m in options.methods if m not in present and m not in GROUPS]
    if missing or not present:
        raise InputError(f"{options.run} has no trajectory of {missing[0] if missing else 'any method'}: run it first")
    chosen = [m for m in present if not options.methods or m in members(options.methods)]
    if not chosen:
        raise InputError(f"{options.run} has no trajectory of {' or '.join(options.methods)}: run it first")
    return chosen


def _files(options: Export, method: str, frame: FrameName) -> tuple[Files, str]:
    """The files of one method by name, and what they hold."""
    if options.format in ("colmap", "colmap-binary"):
        return _colmap(options, method)
    if options.format == "nerfstudio":
        return nerfstudio_files(options.run, method)
    trajectory = read_tum(options.run / f"{method}.tum", frame)
    unit = "a unit of its own" if registered(method).unit == "own" else "metres"
    summary = f"{len(trajectory)} poses world_from_{frame} in {unit}"
    match options.format:
        case "tum":
            return {f"{method}.tum": tum_text(trajectory)}, summary
        case "kitti":
            return {f"{method}.txt": poses_text(trajectory), f"{method}_times.txt": _times(trajectory)}, summary
        case "euroc":
            return {f"{method}.csv": euroc_text(trajectory)}, summary
        case "vslam-lab":
            return _vslam_lab(options.run, method, trajectory)
        case "mcap":
            return mcap_files(options.run, method, trajectory, 1.0 if registered(method).unit == "metric" else None)
        case "kalibr" | "orbslam":
            return settings_files(options.run, options.format, trajectory)
        case "panorama":
            png, shown = panorama_png(options.run, trajectory)
            return {f"{method}.png": png}, shown
    scene = read_maps(options.run / "landmarks.npz").get(method)
    if scene is None:
        raise InputError(f"{options.run / 'landmarks.npz'} has no points of {method}: run again")
    lines = scene.lines
    summary = f"{summary}, {len(scene.landmarks)} points" + (f", {len(lines)} lines" if len(lines) else "")
    if options.format == "ply":
        colour, line_rgb = colours.of(method), colours.of_groups(lines.group)
        return {f"{method}.ply": ply_bytes(scene.landmarks, trajectory, colour, lines, line_rgb)}, summary
    tables: Files = {f"{method}.csv": trajectory_csv(trajectory)}
    tables |= {f"{method}_landmarks.csv": landmarks_csv(scene.landmarks)}
    if len(lines):
        tables |= {f"{method}_lines.csv": world_lines_csv(lines)}
    return tables, summary


def _vslam_lab(run: Path, method: str, trajectory: Trajectory) -> tuple[Files, str]:
    """The poses of the left camera, or of the only one, as its other baselines write them."""
    rig = read_rig(run / "rig.yaml")
    camera: FrameName = "left" if rig.has_stereo else "video"
    metric = registered(method).unit == "metric"
    poses = in_frame(trajectory, rig, camera, 1.0 if metric else None)
    summary = f"{len(poses)} poses world_from_{camera} in {'metres' if metric else 'a unit of its own'}"
    return {f"{method}/{VSLAM_LAB_FILE}": vslam_lab_text(poses)}, summary


def _colmap(options: Export, method: str) -> tuple[Files, str]:
    """The model; InputError where the run's own poses do not agree with what its keyframes saw."""
    run = options.run
    scene, camera = scene_of(run, method)
    model = colmap_model(scene, camera, options.max_error_px)
    if not model.observations:
        raise InputError(f"{run}: no two keyframes of {method} saw the same point: give a run with motion")
    fitting = f"{model.kept} of {model.observations} observations ({100 * model.kept / model.observations:.0f} %)"
    within = f"within {options.max_error_px:g} px of reprojection error"
    if model.kept < MIN_SHARE * model.observations:
        raise InputError(
            f"{run}: the poses of {method} do not agree with what it saw, only {fitting} are {within}: "
            "give other --methods, or a larger --max-error-px"
        )
    files: Files = {"cameras.txt": model.cameras, "images.txt": model.images, "points3D.txt": model.points}
    if options.format == "colmap-binary":
        files = {**colmap_binary(model)}
    mean = f"{within}, mean {model.mean_error_px:.2f} px"
    return (
        {f"{method}/{name}": content for name, content in files.items()},
        f"{len(scene.key_frames)} images, {model.point_count} points, {fitting} {mean}",
    )


def _times(trajectory: Trajectory) -> str:
    return "".join(f"{seconds_text(t)}\n" for t in trajectory.times_ns.tolist())
