"""What must be known to read an evaluation's numbers rightly."""

from __future__ import annotations

from ispom.errors import InputError
from ispom.io.trajectories import TrajectoryFile

from ...engine.run_folder.run_file import read_run_file
from ...presentation.texts import ALIGNMENTS
from .options import Evaluate


def frame_of(file: TrajectoryFile) -> str | None:
    """Whose poses a file holds, where that is known: EuRoC's truth is of the body; `ispom run` says it beside."""
    if file.format == "EuRoC":
        return "body"
    try:
        return read_run_file(file.path.parent).frame
    except InputError:
        return None


def protocol_of(reference: TrajectoryFile, files: list[TrajectoryFile], options: Evaluate) -> dict[str, str]:
    """What must be known to read the numbers rightly."""
    frames = {str(file.path): frame_of(file) for file in (reference, *files)}
    known = {frame for frame in frames.values() if frame}
    frame = ", ".join(f"{path}: {frame or 'unknown'}" for path, frame in frames.items())
    warning = " (different frames: the lever arm between them counts as error)" if len(known) > 1 else ""
    row = "row by row: these KITTI files have no times"
    time = f"each pose of the shorter file with the nearest in time, at most {options.max_difference_s:g} s away"
    poses, path_m = len(reference.trajectory), reference.trajectory.length
    seconds = (reference.trajectory.times_ns[-1] - reference.trajectory.times_ns[0]) * 1e-9
    span = f" over {seconds:.1f} s" if reference.timed else ""
    return {
        "reference": f"{reference.path} ({_kind(reference)}, {poses} poses, {path_m:.1f} m{span})",
        "estimates": ", ".join(f"{f.path} ({_kind(f)}, {len(f.trajectory)} poses)" for f in files),
        "frames": f"poses are compared as the files have them{warning}; {frame}",
        "association": time if reference.timed else row,
        "alignment": ALIGNMENTS[options.alignment],
        "RPE": f"over all pairs of compared poses i, i + {options.delta}",
        "KITTI": "mean over 100 to 800 m from every tenth pose; below 200 m over 5 to 40 m from every pose",
        "local scale": "path in the estimate, before alignment, over path in the reference, in ten windows along it",
    }


def _kind(file: TrajectoryFile) -> str:
    """The format, and the unit of times that the file does not say itself."""
    return f"{file.format} with times in {file.unit}" if file.unit else file.format
