"""A run without end, as the app keeps it: does a frame cost as much, and the process hold as much, as at first?

`python -m tests.app.soak` takes 20,000 frames of small made images through playback, history, run model, recorder
and live stream, and prints a table; `tests/app/run/test_long_run.py` takes fewer, and looks at counts only.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil
from ispom_app.engine.playback import Playback
from ispom_app.session.current_run import CurrentRun
from ispom_app.views.rerun import live, tape
from ispom_app.views.rerun.recorder import Recorder

from ispom.persistent_list import PersistentList
from ispom.types import Frame, Kind, Landmarks, Measurement, Rig, Sequence, Step, Tracks, Trajectory, is_stereo
from tests import doubles

EXPOSURES = 20_000
BUDGET_MB = 60
TRACKS, POINTS, WINDOW = 200, 60, 20
FRAME_NS = 33_333_333
COLUMNS = ("scenario", "ms 1,000-2,000", "ms last 1,000", "ratio", "MB halfway", "MB at the end", "ms step back")
"""Milliseconds are the process's own, all threads together, on average."""
SCENARIOS: dict[str, tuple[tuple[str, ...], Callable[[int], Kind]]] = {
    "single camera": (("monocular",), lambda i: "video"),
    "stereo": (("stereo",), lambda i: "stereo"),
    "both": (("monocular", "stereo", "integrated"), lambda i: "stereo" if i % 4 == 0 else "video"),
    "pairs stop": (("monocular", "stereo", "integrated"), lambda i: "stereo" if i in (0, 4) else "video"),
}
"""Methods, and the kind of each frame."""


class Walker:
    """An estimator that says as much as a real one, of a State that does not grow; each step revises the last poses."""

    def __init__(self, method: str) -> None:
        self.method = method

    def start(self) -> tuple[int, tuple[int, ...], PersistentList[int]]:
        return 0, (), PersistentList()

    def step(self, state, exposure: Measurement, asked=None):
        (count, recent, times), time_ns = state, exposure.time_ns
        rng = np.random.default_rng(count)
        camera = "left" if is_stereo(exposure) else "video"
        place = rng.random((TRACKS, 2)) * (75, 55)
        ids = np.arange(TRACKS) + 10 * count
        xyz = rng.random((POINTS, 3)) * 9
        step = Step(
            time_ns,
            doubles.Status.TRACKING,
            "video" if self.method == "monocular" else "rig",
            _straight((time_ns,), 0).pose(0),
            method=self.method,
            covariance=np.eye(6),
            key_frame=count % 10 == 0,
            tracks={camera: Tracks.of(ids, place, uv_prev=place, status=rng.integers(0, 3, TRACKS))},
            landmarks=Landmarks(ids[:POINTS], xyz, np.zeros((POINTS, 3), np.uint8)),
            residuals_px=rng.random(TRACKS),
            revised=_straight(recent, count),
            seconds={"track": 0.004, "pose": 0.001},
            decisions=(doubles.Decision("parallax", 14.2, 20.0, False, "px"),) * 6,
        )
        return (count + 1, (*recent, time_ns)[-WINDOW:], times.appended(time_ns)), step

    def finish(self, state, asked=None) -> Trajectory:
        return _straight(tuple(state[2]), 0)


def _straight(times_ns: tuple[int, ...], version: int) -> Trajectory:
    """A trajectory along z, as it is known after `version` steps."""
    times = np.array(times_ns, np.int64)
    places = np.stack([0.0 * times, np.full(len(times), 1e-3 * version), 1e-9 * times], axis=1)
    return Trajectory(times, np.tile(np.eye(3), (len(times), 1, 1)), places)


def sequence(kind_of: Callable[[int], Kind], count: int) -> Sequence:
    texture = np.random.default_rng(0).integers(0, 256, (60, 240), np.uint8)
    kinds = tuple(kind_of(i) for i in range(count))

    def load(i: int) -> Measurement:
        image = texture[:, i % 160 : i % 160 + 80].copy()
        return Frame.video(i * FRAME_NS, image) if kinds[i] == "video" else Frame.stereo(i * FRAME_NS, image, image)

    small = doubles.rig().left
    assert small is not None
    pair = doubles.rig().changed(left=small.scaled(0.5), right=small.scaled(0.5))
    rig = Rig.single(pair.video) if set(kinds) == {"video"} and pair.video else pair
    return Sequence("soak", rig, np.arange(count) * FRAME_NS, kinds, load)


@dataclass(frozen=True)
class Measured:
    """One frame, as the app kept and drew it."""

    entries: int
    """What the recorder logs."""
    seconds: float
    """Processor time of all threads, without the estimators'."""


def walked(scenario: str, count: int, budget_bytes: int, sink: live.LiveStream | None) -> Iterator[Measured]:
    """Yields after each frame; `CurrentRun` and recorder stay alive meanwhile."""
    methods, kind_of = SCENARIOS[scenario]
    playback = Playback(
        sequence(kind_of, count), methods, builder=lambda _c, wanted, _r: doubles.ensemble(wanted, Walker)
    )
    run, spent = CurrentRun(playback, budget_bytes), [0.0]
    step = playback.ensemble.step

    def timed(*arguments):
        start = time.thread_time()
        found = step(*arguments)
        spent[0] += time.thread_time() - start
        return found

    object.__setattr__(playback.ensemble, "step", timed)
    recorder = Recorder(run.opened)
    if sink is not None:
        sink.open(run.opened, run.history)
    while not playback.done:
        start, spent[0] = time.process_time(), 0.0
        event, _ = run.step()
        entries = len(recorder.batch(event).entries)
        if sink is not None:
            sink.write(event)
        yield Measured(entries, time.process_time() - start - spent[0])
        assert run.history.used_bytes <= budget_bytes
    assert len(run.history) == count and run.history[0].index == 0 and not run.history[0].thinned


def main() -> int:
    process = psutil.Process()
    sys.stdout.write(" ".join(f"{name:>13}" for name in COLUMNS) + "\n")
    for scenario in sys.argv[1:] or SCENARIOS:
        with tempfile.TemporaryDirectory() as folder:
            tape.user_cache_path = lambda _, folder=folder: Path(folder)
            sink, ms, memory = live.LiveStream(), np.zeros(EXPOSURES), []
            for i, measured in enumerate(walked(scenario, EXPOSURES, BUDGET_MB * 1_000_000, sink)):
                ms[i] = 1e3 * measured.seconds
                if i in (EXPOSURES // 2, EXPOSURES - 1):
                    memory.append(process.memory_info().rss / 1e6)
            first, last = ms[1000:2000].mean(), ms[-1000:].mean()
            history = sink._feed.history if sink._feed is not None else None
            start = time.thread_time()
            assert history is not None and history[5].index == 5
            back = 1e3 * (time.thread_time() - start)
            numbers = (first, last, last / first, *memory, back)
            sys.stdout.write(" ".join([f"{scenario:>13}", *(f"{number:13.2f}" for number in numbers)]) + "\n")
            sys.stdout.flush()
            sink.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
