"""`python -m tests.accuracy cameras`: the same flight filmed by cameras of other kinds.

4K, 12 bits in 16-bit files, a variable rate, portrait, fisheye lenses, and rolling shutters whose line delay is known,
or not. `python -m tests.accuracy.cameras '{...}'` prints what was found as one line of JSON.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from ispom.child import end_with_parent
from ispom.ensemble import build
from ispom.evaluation.metrics import path_errors
from ispom.io.rig import rig_text
from ispom.io.trajectories import tum_text
from ispom.methods import Config
from ispom.methods import method as registered
from ispom.sequences import open_sequence
from ispom.sequences.formats.simulated import open_scenario
from ispom.simulation.rendering.cache import default_folder
from ispom.simulation.scenario.scenario import scenario_of_words
from ispom.types import Image, Sequence, Status, is_stereo, is_video

FLIGHT = "city?duration_s=3"
SEEDS = 16
"""The ratio of two errors over three flights is off by a factor of two by chance, over eight by one and a half."""
PLAIN, LARGE, BITS, BLIND = "plain", "4K", "12 bits", "rolling, 20 ms, not told"
CAMERAS: Mapping[str, str] = {
    PLAIN: "",
    LARGE: "width_px=3840",
    BITS: "",
    "variable rate": "fault=dropped:share=0.3",
    "portrait": "portrait=true",
    "fisheye": "fisheye=true",
    "rolling, 10 ms": "rolling_shutter_ms=10",
    "rolling, 20 ms": "rolling_shutter_ms=20",
    "rolling, 30 ms": "rolling_shutter_ms=30",
    BLIND: "rolling_shutter_ms=20&fault=wrong-shutter",
}
"""By name: what differs from the plain flight."""
COSTLY = frozenset({LARGE})
"""Rendered for the first seed only: that takes 15 minutes of one core."""
CAMERA_METHODS = ("monocular", "stereo", "integrated")
MOST = 1.5
"""Times the error with plain cameras that is allowed."""
LEAST_BLIND = 5.0
"""Times that error which a rolling shutter must lead to where nothing is said of it, or the flight tests nothing."""


@dataclass(frozen=True)
class Filmed:
    """What a method makes of a flight."""

    seed: int
    cameras: str
    method: str
    ate_m: float
    """Aligned by a rigid motion, or with scale; nan with too few poses."""
    lost: int
    """Steps."""


def filmed(seed: int, cameras: str, methods: tuple[str, ...]) -> Iterator[Filmed]:
    """The flight of a seed as one kind of cameras film it."""
    with _opened(seed, cameras) as sequence:
        assert sequence.truth is not None
        ensemble = build(Config(), methods, sequence.rig)
        state, lost = ensemble.start(), dict.fromkeys(methods, 0)
        for i in range(len(sequence)):
            state, steps = ensemble.step(state, sequence[i])
            for step in steps:
                lost[step.method] += step.status is Status.LOST
        for name, trajectory in ensemble.finish(state).items():
            found = path_errors(trajectory, sequence.truth, sequence.rig, registered(name).unit == "metric")["ate_m"]
            yield Filmed(seed, cameras, name, float("nan") if found is None else found, lost[name])


@contextmanager
def _opened(seed: int, cameras: str) -> Iterator[Sequence]:
    # Not with the user's simulations: the flights of a study would push out the ones that are really used.
    cache = default_folder().parent / "cameras"
    sequence = open_scenario(scenario_of_words(f"{FLIGHT}&{CAMERAS[cameras]}"), seed, cache)
    if sequence.prepare:
        sequence.prepare(0)
    if cameras != BITS:
        yield sequence
        return
    with tempfile.TemporaryDirectory() as folder:
        write_12_bits(sequence, Path(folder))
        yield open_sequence(folder)


def write_12_bits(sequence: Sequence, folder: Path) -> None:
    """The sequence as a folder with 16-bit PNG files, whose values are 12 bits."""
    assert sequence.truth is not None
    times = dict[str, list[int]]()
    for i in range(len(sequence)):
        for name, image in _images(sequence, i):
            times.setdefault(name, []).append(int(sequence.times_ns[i]))
            (folder / name).mkdir(exist_ok=True)
            deep = cv2.cvtColor(image, cv2.COLOR_RGB2BGR).astype(np.uint16) * 16
            cv2.imwrite(str(folder / name / f"{len(times[name]):06d}.png"), deep)
    lines = []
    for name, stamps in times.items():
        (folder / f"{name}.txt").write_text("".join(f"{t * 1e-9:.9f}\n" for t in stamps))
        lines.append(f"{name}: {{source: {name}, times: {name}.txt}}\n")
    (folder / "sequence.yaml").write_text("".join(lines) + "truth: truth.tum\n")
    (folder / "rig.yaml").write_text(rig_text(sequence.rig))
    (folder / "truth.tum").write_text(tum_text(sequence.truth))


def _images(sequence: Sequence, i: int) -> list[tuple[str, Image]]:
    seen = sequence[i]
    if is_stereo(seen):
        return [("left", seen.left), ("right", seen.right)]
    assert is_video(seen)
    return [("video", seen.image)]


def print_cameras(console: Console, found: list[Filmed]) -> None:
    """Errors over all seeds, as multiples of those of the same flights with plain cameras: one alone is right by
    chance."""
    methods = list(dict.fromkeys(f.method for f in found))
    table, beyond = Table("sim:city, 3 s", *methods, "lost", box=None), list[str]()
    for cameras in dict.fromkeys(f.cameras for f in found):
        cells, seeds = list[str](), {f.seed for f in found if f.cameras == cameras}
        for method in methods:
            error, plain = (
                _rms([f.ate_m for f in found if (f.cameras, f.method) == (c, method) and f.seed in seeds])
                for c in (cameras, PLAIN)
            )
            cells.append(f"{1e3 * error:.1f} mm ({error / plain:.2f})")
            right = error >= LEAST_BLIND * plain if cameras == BLIND else error <= MOST * plain
            beyond += [] if right else [f"{method} with {cameras}"]
        table.add_row(cameras, *cells, str(sum(f.lost for f in found if f.cameras == cameras)))
    console.print(table)
    limits = (
        f"{MOST:g} times the error with plain cameras, or less than {LEAST_BLIND:g} times where a shutter is not told"
    )
    console.print(f"more than {limits}: {', '.join(beyond) or 'none'}")


def _rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values else float("nan")


def cameras_found(rows: list[dict[str, Any]]) -> list[Filmed]:
    """What processes printed."""
    return [Filmed(**row) for row in rows]


def main(argument: str) -> None:
    task = json.loads(argument)
    cv2.setNumThreads(1)
    found = filmed(task["seed"], task["cameras"], tuple(task["methods"]))
    sys.stdout.write(json.dumps([asdict(f) for f in found]) + "\n")


if __name__ == "__main__":
    end_with_parent()
    main(sys.argv[1])
