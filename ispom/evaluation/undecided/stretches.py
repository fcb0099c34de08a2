"""What the images of a recording, or those of a planned motion, do not decide: stretch after stretch."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array, Pose
from ispom.types import Rig, Sequence, Trajectory

from ..doctor.adjustment import adjust
from ..doctor.examination import examination
from ..doctor.scene import CAMERAS, Observations, Scene
from ..doctor.start import KNOTS, LEAST_TRACKS, SIGNIFICANT
from .motions import MOTIONS, Moved, looked_at, motion_of, with_motion
from .weakest import DECIDED_PX, Decided, decided

NOISE_PX = 0.3
"""Noise of future observations: corners are tracked to about a third of a pixel."""
LEAST_FRAMES = 5
NEW_POINTS = 20
"""Points that come into view at each pose of a planned motion."""
DEPTHS = (0.5, 2.0)
"""Nearest and farthest of them, over the stated distance: a room, or a street."""


@dataclass(frozen=True, eq=False)
class Answer:
    """The answer for one stretch."""

    first_ns: int
    last_ns: int
    decided: Decided | None
    """None where the tracks are too few or show no parallax: then nothing is decided."""
    moved: Moved | None
    cures: dict[str, float]
    """By name of MOTIONS: the pixels by which the weakest combination could still move the points after this motion.
    Empty where all is decided."""

    @property
    def best_cure(self) -> str | None:
        """The motion after which the weakest combination is known best."""
        return min(self.cures, key=lambda name: self.cures[name]) if self.cures else None


def of_recording(
    sequence: Sequence,
    seconds: float,
    step_s: float,
    advance: Callable[[], None] = lambda: None,
    skip: int = 0,
    most: int | None = None,
) -> Iterator[Answer]:
    """Yields the answer for each stretch of `seconds`. Stretches begin every `step_s`. The first `skip` are skipped; at
    most `most` follow.

    Raises InputError where an image is unreadable. `advance` is called after each measurement that was read, and may
    raise to end the work.
    """
    kind = "video" if sequence.rig.video is not None else "stereo"
    own = np.flatnonzero([each == kind for each in sequence.kinds])
    for first, last in spans(sequence.times_ns[own], seconds, step_s)[skip:][:most]:
        seen = examination(sequence, int(own[first]), int(own[last]), advance)
        times = int(sequence.times_ns[own[first]]), int(sequence.times_ns[own[last]])
        if seen.start is None or seen.baseline is None:
            yield Answer(*times, None, None, {})
            continue
        scene, _, _ = adjust(seen.baseline.scene, seen.rig, seen.start.seen)
        yield answer(times, scene, seen.rig, seen.start.seen)


def of_motion(
    poses: Trajectory, rig: Rig, distance: float, seconds: float, step_s: float, seed: int = 0
) -> Iterator[Answer]:
    """Yields the same for a motion before it is recorded: random points about `distance` away from the camera, in the
    unit of the poses (world_from_rig), are seen with errors of NOISE_PX."""
    for first, last in spans(poses.times_ns, seconds, step_s):
        stretch = np.unique(np.linspace(first, last, min(KNOTS, last - first + 1)).round().astype(int))
        times = int(poses.times_ns[first]), int(poses.times_ns[last])
        scene = _imagined(poses, stretch, rig, distance, np.random.default_rng(seed))
        cameras = [CAMERAS.index(name) for name in CAMERAS if name in rig.cameras and _takes_part(rig, name)]
        seen = looked_at(scene, rig, cameras, np.arange(len(scene.points)), scene.times_s, NOISE_PX, seed)
        often = np.bincount(seen.point, minlength=len(scene.points)) >= 3
        if np.count_nonzero(often) < LEAST_TRACKS or _parallax_px(scene, rig) < SIGNIFICANT * NOISE_PX:
            yield Answer(*times, None, None, {})
            continue
        yield answer(times, scene, rig, seen.select(often[seen.point]))


def answer(times_ns: tuple[int, int], scene: Scene, rig: Rig, seen: Observations) -> Answer:
    """Returns the answer for a stretch whose scene fits its observations."""
    found = decided(scene, rig, seen)
    cures = {}
    if found.weakest_px > DECIDED_PX:
        cures = {name: with_motion(scene, rig, seen, name, NOISE_PX).weakest_px for name in MOTIONS}
    return Answer(*times_ns, found, motion_of(scene), cures)


def spans(times_ns: NDArray[np.int64], seconds: float, step_s: float) -> list[tuple[int, int]]:
    """Returns the first and the last place of each stretch; stretches of fewer than LEAST_FRAMES are left out."""
    if not len(times_ns):
        return []
    starts = np.arange(times_ns[0], max(times_ns[-1] - seconds * 1e9, times_ns[0]) + 1, step_s * 1e9)
    firsts = np.searchsorted(times_ns, starts)
    lasts = np.searchsorted(times_ns, starts + seconds * 1e9, side="right") - 1
    return [(int(a), int(b)) for a, b in zip(firsts, lasts, strict=True) if b - a + 1 >= LEAST_FRAMES]


def _takes_part(rig: Rig, name: str) -> bool:
    """Returns whether this camera of the rig takes part: the video camera, or both cameras of a pair."""
    return name == "video" or rig.has_stereo


def _parallax_px(scene: Scene, rig: Rig) -> float:
    """Returns the parallax [px] of a point at the median distance between two poses, without their rotation."""
    return motion_of(scene).distance * rig.camera("video" if rig.video is not None else "left").fx


def _imagined(
    poses: Trajectory, stretch: NDArray[np.int64], rig: Rig, distance: float, random: np.random.Generator
) -> Scene:
    name = "video" if rig.video is not None else "left"
    camera, rig_from_camera = rig.camera(name), rig.rig_from(name)
    points: list[Array] = []
    for k in stretch:
        uv = random.uniform(0, 1, (NEW_POINTS, 2)) * (camera.width - 1, camera.height - 1)
        depths = distance * np.exp(random.uniform(np.log(DEPTHS[0]), np.log(DEPTHS[1]), NEW_POINTS))
        rays = np.column_stack([camera.normalise(uv), np.ones(NEW_POINTS)])
        world_from_camera = Pose(poses.rotations[k], poses.translations[k]) @ rig_from_camera
        points.append(world_from_camera.apply(rays * depths[:, None]))
    times_s = (poses.times_ns[stretch] - poses.times_ns[stretch[0]]) * 1e-9
    return Scene(times_s, poses.rotations[stretch], poses.translations[stretch], np.concatenate(points))
