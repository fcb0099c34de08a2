"""A recording, as the estimators get it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ispom.types.camera import Rig
from ispom.types.exposure import Exposure, Kind, VideoFrame
from ispom.types.guess import Guess
from ispom.types.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Sequence:
    """A time-ordered list of exposures with its rig; images are read when asked for."""

    name: str
    """What a person recognises: "sim:city seed 0", "KITTI 06"."""
    rig: Rig
    times_ns: NDArray[np.int64]
    """(N,) not decreasing; a stereo pair comes before the video frame of the same time."""
    kinds: tuple[Kind, ...]
    """(N,) what exposure i is."""
    load: Callable[[int], Exposure]
    """Reads exposure i; InputError where its files are unreadable or of the wrong size. Safe from several threads."""
    truth: Trajectory | None = None
    """world_from_rig, in the source's own world; may cover only part of the exposures."""
    notes: tuple[str, ...] = ()
    """What a person must know to read results of this sequence rightly (an emulation, a nominal frame rate)."""
    prepare: Callable[[int], None] | None = None
    """Renders or fetches ahead from exposure i on, in the background; None where loading is always quick."""
    grow: Callable[[int, float | None], Sequence] | None = None
    """Of a live source: waits for more than N exposures, at most so many seconds (None: until it ends), and gives the
    sequence of all that came so far. InputError where the source fails. None where nothing more will come."""
    stop: Callable[[], None] | None = None
    """Of a live source: ends the recording and frees the camera; what came so far stays."""
    guess: Guess | None = None
    """Of a video camera without a calibration; its note is one of the notes."""

    def __len__(self) -> int:
        return len(self.times_ns)

    def __getitem__(self, i: int) -> Exposure:
        return self.load(i)

    def with_video_later(self, by_s: float, drift: float = 0.0) -> Sequence:
        """With the stamps of the video increased by so many seconds, and by `drift` of the time since the first one.

        The truth is stamped like what it is the truth of. A stereo pair comes before the video frame of the same time.
        Nothing is fetched ahead.
        """
        video = np.array([kind == "video" for kind in self.kinds])
        shift_ns = round(by_s * 1e9) + np.rint(drift * (self.times_ns - self.times_ns[0])).astype(np.int64)
        times_ns = self.times_ns + np.where(video, shift_ns, 0)
        order = np.lexsort((video, times_ns))

        def load(i: int) -> Exposure:
            exposure = self.load(int(order[i]))
            return replace(exposure, time_ns=int(times_ns[order[i]])) if isinstance(exposure, VideoFrame) else exposure

        truth = self.truth
        if truth is not None:
            stamps = zip(times_ns, self.times_ns, strict=True)
            truth = Trajectory.of([(int(t), pose) for t, was in stamps if (pose := truth.at(int(was))) is not None])
        kinds = tuple(self.kinds[i] for i in order)
        return replace(self, times_ns=times_ns[order], kinds=kinds, load=load, truth=truth, prepare=None)

    def truncated(self, count: int) -> Sequence:
        """The first `count` exposures."""
        return replace(self, times_ns=self.times_ns[:count], kinds=self.kinds[:count])
