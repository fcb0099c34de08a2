"""The sequence of measurements on which estimators run."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from collections.abc import Sequence as Listed
from dataclasses import dataclass, replace
from typing import overload

import numpy as np
from numpy.typing import NDArray

from ispom.cameras import Camera
from ispom.types.measurements import VIDEO, Kind, Measurement, is_video
from ispom.types.rig import Rig
from ispom.types.trajectory import Trajectory


@dataclass(frozen=True)
class Guess:
    """The focal length of an uncalibrated camera, for no distortion and a principal point in the middle."""

    focal_px: float
    """Focal length in heights of a pixel."""
    sigma: float
    """Standard deviation, relative to the focal length."""
    origin: str
    """Description of its source."""
    aspect: float = 1.0
    """Width of a pixel, relative to its height."""

    def camera(self, size: tuple[int, int]) -> Camera:
        """Returns the camera of images of `size` (width, height)."""
        width, height = size
        return Camera(width, height, self.focal_px / self.aspect, self.focal_px, (width - 1) / 2, (height - 1) / 2)

    @property
    def note(self) -> str:
        """A sentence about the assumption and its uncertainty."""
        pixels = "" if self.aspect == 1 else f", pixels {self.aspect:.4g} times as wide as high"
        return (
            f"The camera has no calibration: focal length {self.focal_px:.0f} px +- {100 * self.sigma:.0f} % "
            f"({self.origin}), no distortion{pixels}."
        )


@dataclass(frozen=True)
class Found:
    """A file in or beside a source, and its use."""

    what: str
    """Its content: lens, times, truth, or the kind of a sensor."""
    where: str
    """The file, the folder, or the topic of a bag."""
    used: bool = True
    why: str = ""
    """The rest of a sentence about it: why it is not used, and how to use it; or an assumption about it."""

    @property
    def note(self) -> str:
        """One sentence."""
        return f"{self.where} {self.why}"


@dataclass(frozen=True, eq=False, repr=False)
class Sequence:
    """A time-ordered stream of measurements with their rig; images are read on demand."""

    name: str
    """Name for people: "sim:city seed 0", "KITTI 06"."""
    rig: Rig
    times_ns: NDArray[np.int64]
    """(N,) not decreasing. At the same time, measurements of other sensors come first, then a stereo frame, then a
    video frame."""
    kinds: tuple[Kind, ...]
    """(N,) the kind of measurement i."""
    load: Callable[[int], Measurement]
    """Reads measurement i, from any thread. Raises InputError where its files are unreadable or of the wrong size."""
    truth: Trajectory | None = None
    """world_from_rig, in the source's own world; may cover only part of the measurements."""
    notes: tuple[str, ...] = ()
    """Sentences that are needed to interpret results of this sequence (an emulation, a nominal frame rate)."""
    prepare: Callable[[int], None] | None = None
    """Renders or reads measurements from i on in the background; None where loading is always fast."""
    grow: Callable[[int, float | None], Sequence] | None = None
    """For a live source: waits for more measurements than the first argument says, at most for the seconds of the
    second (None: until the source ends), and returns the sequence of all measurements so far. Raises InputError where
    the source fails. None for a complete sequence."""
    stop: Callable[[], None] | None = None
    """For a live source: ends the recording and releases the camera; all measurements so far are kept."""
    guess: Guess | None = None
    """The focal length of an uncalibrated video camera; its note is one of the notes."""
    found: tuple[Found, ...] = ()
    """Files in or beside the source, used or not; the notes of those that are not used are among the notes."""
    beside: frozenset[Kind] = frozenset()
    """Kinds of measurements that were added only because their files are beside the source: a run skips those that none
    of its methods uses."""
    whole: Sequence | None = None
    """The sequence with all measurements, if this one skips some."""

    def __post_init__(self) -> None:
        """Raises ValueError where kinds are missing, or times decrease."""
        if len(self.kinds) != len(self.times_ns) or (np.diff(self.times_ns) < 0).any():
            raise ValueError(f"{len(self.times_ns)} times, which must not decrease, with {len(self.kinds)} kinds")

    def __len__(self) -> int:
        return len(self.times_ns)

    @overload
    def __getitem__(self, i: int) -> Measurement: ...

    @overload
    def __getitem__(self, i: slice) -> Sequence: ...

    def __getitem__(self, i: int | slice) -> Measurement | Sequence:
        """Returns measurement i, or the sequence of a slice. Raises ValueError for a step that is not positive."""
        if isinstance(i, slice):
            chosen = range(len(self))[i]
            if chosen.step < 0:
                raise ValueError("a sequence does not go backwards: give a slice with a positive step")
            return self.selected(chosen)
        if not -len(self) <= i < len(self):
            raise IndexError(f"measurement {i} of {len(self)}")
        return self.load(range(len(self))[i])

    def used_by(self, kinds: Collection[Kind]) -> Sequence:
        """Returns the sequence without measurements from files beside the source that are of none of these kinds."""
        whole = self.whole or self
        unused = whole.beside.difference(kinds)
        chosen = [i for i, kind in enumerate(whole.kinds) if kind not in unused]
        if len(chosen) == len(self):
            return self
        return whole if len(chosen) == len(whole) else replace(whole.selected(chosen), whole=whole)

    def selected(self, chosen: Listed[int]) -> Sequence:
        """Returns the sequence of these measurements, in this order, which must be that of time."""
        at, prepare = np.asarray(chosen, np.int64), self.prepare
        return replace(
            self,
            times_ns=self.times_ns[at],
            kinds=tuple(self.kinds[i] for i in chosen),
            load=lambda i: self.load(chosen[i]),
            prepare=None if prepare is None else lambda i: prepare(chosen[i]),
            grow=None,
            whole=None,
        )

    def __repr__(self) -> str:
        kinds = ", ".join(f"{self.kinds.count(kind)} {kind}" for kind in dict.fromkeys(self.kinds))
        seconds = (self.times_ns[-1] - self.times_ns[0]) * 1e-9 if len(self) else 0.0
        truth = ", with ground truth" if self.truth is not None else ""
        return f"Sequence({self.name}: {kinds or 'empty'} over {seconds:.2f} s{truth})"

    def with_notes(self, notes: Iterable[str]) -> Sequence:
        """Returns the sequence with more notes, each once."""
        return replace(self, notes=tuple(dict.fromkeys((*self.notes, *notes))))

    def with_found(self, found: Iterable[Found]) -> Sequence:
        """Returns the sequence with further files in or beside its source."""
        more = tuple(found)
        return replace(self, found=(*self.found, *more)).with_notes(each.note for each in more if not each.used)

    def with_measurements(self, measurements: Iterable[Measurement]) -> Sequence:
        """Returns the sequence with measurements of other sensors among its own, in the order of time.

        The rig must have those sensors. Raises ValueError for a live sequence.
        """
        if self.grow is not None:
            raise ValueError("a live sequence takes in no other measurements")
        others = tuple(measurements)
        times_ns = np.concatenate([self.times_ns, np.array([m.time_ns for m in others], np.int64)])
        order = np.lexsort((np.arange(len(times_ns)) < len(self), times_ns))
        own_before = np.cumsum(order < len(self))  # own measurements up to each of the new stream
        kinds = (*self.kinds, *(m.kind for m in others))

        def load(i: int) -> Measurement:
            at = int(order[i])
            return self.load(at) if at < len(self) else others[at - len(self)]

        def prepare(i: int) -> None:
            if self.prepare is not None and own_before[i] < len(self):
                self.prepare(int(own_before[i]))

        ahead = None if self.prepare is None else prepare
        return replace(
            self, times_ns=times_ns[order], kinds=tuple(kinds[i] for i in order), load=load, prepare=ahead, whole=None
        )

    def with_video_later(self, by_s: float, drift: float = 0.0) -> Sequence:
        """Returns the sequence with the stamps of the video increased by `by_s` seconds, and by `drift` of the time
        since the first one.

        The truth gets the time stamps of the frames that it belongs to. A stereo frame comes before the video frame of
        the same time. The result does not prefetch.
        """
        video = np.array([kind == VIDEO for kind in self.kinds])
        shift_ns = round(by_s * 1e9) + np.rint(drift * (self.times_ns - self.times_ns[0])).astype(np.int64)
        times_ns = self.times_ns + np.where(video, shift_ns, 0)
        order = np.lexsort((video, times_ns))

        def load(i: int) -> Measurement:
            measured = self.load(int(order[i]))
            return replace(measured, time_ns=int(times_ns[order[i]])) if is_video(measured) else measured

        truth = self.truth
        if truth is not None:
            stamps = zip(times_ns, self.times_ns, strict=True)
            truth = Trajectory.of([(int(t), pose) for t, was in stamps if (pose := truth.at(int(was))) is not None])
        kinds = tuple(self.kinds[i] for i in order)
        return replace(self, times_ns=times_ns[order], kinds=kinds, load=load, truth=truth, prepare=None, whole=None)

    def truncated(self, count: int) -> Sequence:
        """Returns the first `count` measurements."""
        return replace(self, times_ns=self.times_ns[:count], kinds=self.kinds[:count], whole=None)

    def part(self, first: int, last: int) -> Sequence:
        """Returns measurements `first` to `last`, both included, as 0 and on."""
        return self[first : last + 1]
