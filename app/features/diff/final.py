"""What two whole runs gave: their final trajectories."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from ispom.io.files import exists
from ispom.io.tum import read_tum
from ispom.types import Frame, Trajectory

from ...engine.differences.compare import ORIENTATION, Difference, Divergence, distance, further
from ...engine.run_folder.run_folder import trajectory_file


def final_divergences(
    a: Path, b: Path, methods: tuple[str, ...], frame: Frame, tolerance: float
) -> Iterator[Divergence]:
    """Of each method whose final trajectories differ: the first pose that does. InputError where one is unreadable."""
    for method in methods:
        name = trajectory_file(method)
        if exists(a / name) and exists(b / name):
            poses = read_tum(a / name, frame), read_tum(b / name, frame)
            yield from _first(method, *poses, tolerance)


def _first(method: str, a: Trajectory, b: Trajectory, tolerance: float) -> Iterator[Divergence]:
    for i in range(min(len(a), len(b))):
        time_ns = int(a.times_ns[i])
        pairs = {
            "final_time_s": (time_ns / 1e9, int(b.times_ns[i]) / 1e9),
            "final_position": (tuple(a.translations[i].tolist()), tuple(b.translations[i].tolist())),
            f"final_{ORIENTATION}": (tuple(a.pose(i).xyzw.tolist()), tuple(b.pose(i).xyzw.tolist())),
        }
        found = [Difference(f"{method}.{k}", x, y, distance(k, x, y)) for k, (x, y) in pairs.items() if x != y]
        found = [difference for difference in found if further(difference, tolerance)]
        if found:
            yield Divergence(None, time_ns, tuple(found))
            return
    if len(a) != len(b):
        longer = a if len(a) > len(b) else b
        counts = Difference(f"{method}.final_poses", len(a), len(b), abs(len(a) - len(b)))
        yield Divergence(None, int(longer.times_ns[min(len(a), len(b))]), (counts,))
