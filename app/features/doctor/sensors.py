"""What the doctor compares other sensors with: the path that a method of the run found from images alone."""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from ispom.evaluation.sensors.scene import FEWEST_POSES, SensorScene
from ispom.geometry import Pose
from ispom.methods import method
from ispom.sequences.sensor_doubts import readings_of
from ispom.types import Sequence, Trajectory

from ...engine.differences.compare import ORIENTATION, POSITION, MethodRow
from ...engine.run_events.stretch import Stretch
from .origin import Origin

AROUND_NS = 60_000_000_000
"""Time before and after the stretch in which sensors are judged [ns]: clocks and mounts stay the same, and no turn is
near every stretch. Two minutes of images take a few seconds."""
IMAGES = frozenset({"video", "stereo"})


def sensor_scene(origin: Origin, sequence: Sequence, stretch: Stretch) -> SensorScene | None:
    """Returns the readings, and the longest unbroken path of images around a stretch, a metric one if there is one.

    None without sensors, or without such a path.
    """
    readings = {name: found for name, found in readings_of(sequence).items() if found.values}
    if not readings:
        return None
    times = sequence.times_ns
    near = (times >= times[stretch.first] - AROUND_NS) & (times <= times[stretch.last] + AROUND_NS)
    first, last = (int(i) for i in np.flatnonzero(near)[[0, -1]])
    paths, used = defaultdict[str, list[list[tuple[int, Pose]]]](lambda: [[]]), set[str]()
    for row in origin.rows(first, last):
        sensors = method(row.method).sensors
        used |= sensors - IMAGES
        if sensors <= IMAGES:
            _add(paths[row.method], row)
    longest = {name: max(stretches, key=len) for name, stretches in paths.items()}
    enough = [name for name, path in longest.items() if len(path) >= FEWEST_POSES]
    if not enough:
        return None
    best = max(enough, key=lambda name: (method(name).unit == "metric", len(longest[name])))
    metric = method(best).unit == "metric"
    path = Trajectory.of(longest[best], "rig" if metric else "video")
    return SensorScene.of(sequence.rig, path, readings, metric, frozenset(used))


def _add(stretches: list[list[tuple[int, Pose]]], row: MethodRow) -> None:
    """Adds the pose of a row; a new world begins another stretch."""
    if row.values.get("restarted") or row.values.get("provisional"):
        stretches.append([])
    if POSITION in row.values and not row.values.get("provisional"):
        position, xyzw = (np.array(row.values[name], float) for name in (POSITION, ORIENTATION))
        stretches[-1].append((row.time_ns, Pose.from_xyzw(xyzw, position)))
