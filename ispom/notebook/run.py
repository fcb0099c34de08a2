"""A whole run in one call, and what can be asked of it: `ispom.run("kitti/sequences/06", "stereo")`."""

from __future__ import annotations

from collections.abc import Mapping
from collections.abc import Sequence as Listed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ispom.calibration.opening import open_calibrated
from ispom.ensemble import Ensemble, build
from ispom.errors import InputError, counted
from ispom.geometry import Array
from ispom.methods import Config, kinds_of, method, with_dependencies
from ispom.notebook.result import Result
from ispom.notebook.run_folders import run_folders
from ispom.settings import checked
from ispom.settings import settings as settings_of
from ispom.types import Frame, Rig, Sequence, Step, Trajectory

RATE_HZ = 30.0
"""Of images without times."""
Source = Sequence | str | Path | Listed[Any]
"""A sequence, a path or name as `ispom run` takes it, or images: arrays of a video, or pairs of arrays."""


def run(
    source: Source,
    name: str,
    *,
    rig: Rig | None = None,
    rate_hz: float = RATE_HZ,
    frames: int | None = None,
    **settings: Any,
) -> Run:
    """Runs a method, with those that it depends on, over a source.

    `rig` and `rate_hz` are for images only. `frames` is the number of frames after which the run ends. `settings` are
    settings of the method, as in max_tracks=300. Raises InputError where the source or the method cannot be used, or
    where the method has no such setting.
    """
    sequence = opened(source, rig, rate_hz)
    if frames is not None:
        sequence = sequence[: positive("frames", frames)]
    ensemble, steps = built(sequence, name, settings), list[Step]()
    sequence = sequence.used_by(kinds_of(ensemble.methods))
    state = ensemble.start()
    for i in range(len(sequence)):
        state, found = ensemble.step(state, sequence[i])
        steps += found
    trajectories = ensemble.finish(state)
    results = {each: (tuple(s for s in steps if s.method == each), trajectories[each]) for each in ensemble.methods}
    own, trajectory = results.pop(name)
    return Run(
        source=sequence.name,
        rig=sequence.rig,
        truth=sequence.truth,
        span_ns=(int(sequence.times_ns[0]), int(sequence.times_ns[-1])),
        method=name,
        settings=settings,
        steps=own,
        trajectory=trajectory,
        sequence=sequence,
        dependencies=results,
        address=str(source) if isinstance(source, (str, Path)) else "",
        frames=frames,
    )


def opened(source: Source, rig: Rig | None = None, rate_hz: float = RATE_HZ) -> Sequence:
    """Returns the source as a sequence. Raises InputError as `run`."""
    if isinstance(source, Sequence):
        return source
    if isinstance(source, (str, Path)):
        return open_calibrated(str(source))
    if not isinstance(source, (Listed, np.ndarray)) or not len(source):
        raise InputError(f"the source is {str(source)[:40]!r}: give a path, a name, a Sequence, or images")
    if rig is None:
        raise InputError("images need their cameras: give rig=ispom.Rig.of(video=ispom.Camera(...))")
    if not isinstance(rig, Rig):
        raise InputError(f"the rig is a {type(rig).__name__}: give an ispom.Rig")
    if not rate_hz > 0:
        raise InputError(f"rate_hz is {rate_hz:g}: give a positive number of images per second")
    times_ns = np.rint(np.arange(len(source)) * 1e9 / rate_hz).astype(np.int64)
    loaded = [_frame(int(t), images) for t, images in zip(times_ns, source, strict=True)]
    return Sequence("images", rig, times_ns, tuple(frame.kind for frame in loaded), loaded.__getitem__)


def positive(name: str, value: int) -> int:
    """Returns the value. Raises InputError where it is no number from 1."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < 1:
        raise InputError(f"{name} is {str(value)[:40]!r}: give a whole number from 1")
    return int(value)


def _frame(time_ns: int, images: Any) -> Frame:
    if isinstance(images, (tuple, list)):
        if len(images) != 2:
            raise InputError(f"{counted(len(images), 'image')} at {time_ns} ns: give one array, or a pair of them")
        return Frame.stereo(time_ns, *images)
    return Frame.video(time_ns, images)


def built(sequence: Sequence, name: str, settings: dict[str, Any]) -> Ensemble:
    """Returns the method with these settings, and those that it depends on, for the sequence. Raises InputError as
    `run`."""
    if not isinstance(name, str):
        raise InputError(f"the method is {str(name)[:40]!r}: give its name, as in ispom.run(source, 'stereo')")
    config = method(name).config
    known = [setting.name for setting in settings_of(config)]
    if unknown := [each for each in settings if each not in known]:
        raise InputError(f"{name} has no setting {unknown[0]!r}: choose from {', '.join(known)}")
    ensemble = build(Config({name: checked(config(**settings))}), with_dependencies((name,)), sequence.rig)
    if not method(name).sensors.intersection(sequence.kinds):
        uses, has = " or ".join(sorted(method(name).sensors)), " and ".join(sorted(set(sequence.kinds)))
        raise InputError(f"{name} uses {uses} frames, and {sequence.name} has only {has} ones: choose another method")
    return ensemble


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Run(Result):
    """A finished run of one method. `settings` are those that were given."""

    sequence: Sequence
    steps: tuple[Step, ...]
    dependencies: Mapping[str, tuple[tuple[Step, ...], Trajectory]]
    """By method that this one depends on: its steps and its trajectory."""
    address: str
    """The path or name that the sequence was opened by; empty where it was none."""
    frames: int | None
    """Number of first frames that were asked for; None for all."""

    @property
    def covariances(self) -> Array:
        """(S, 6, 6) of each step's pose as it was given then, of the twist (rho, phi) on its right; NaN where the step
        has none."""
        none = np.full((6, 6), np.nan)
        return np.array([none if step.covariance is None else step.covariance for step in self.steps]).reshape(-1, 6, 6)

    def step_at(self, frame: int) -> Step:
        """Returns the step at a frame of the sequence. Raises InputError where the method did not use that frame."""
        if not -len(self.sequence) <= frame < len(self.sequence):
            raise InputError(f"there is no frame {frame}: {self.source} has frames 0 to {len(self.sequence) - 1}")
        time_ns, kind = int(self.sequence.times_ns[frame]), self.sequence.kinds[frame]
        found = next((step for step in self.steps if step.time_ns == time_ns), None)
        if found is None or not method(self.method).uses(self.sequence[frame]):
            raise InputError(f"{self.method} did not step at frame {frame}, which is a {kind} frame")
        return found

    def save(self, folder: str | Path) -> Path:
        """Writes the run into a new or empty folder as `ispom run` does, and returns that folder.

        All that takes a run takes it: the page, `ispom report`, `ispom diff`, `ispom.read_run`. The images are read
        again, for the recording. Raises InputError where the folder holds something else, or cannot be written.
        """
        return run_folders().save(self, Path(folder))
