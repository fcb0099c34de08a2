"""The search for the smallest clip in which a failure remains, over any test for that. It reads no image.

The failure need not come and go evenly: a shorter clip may fail where a longer one does not. What is promised is that
the clip fails, and that no single step further does: see `neighbours`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

from ispom.types import Kind


@dataclass(frozen=True)
class Clip:
    """A part of a recording, and what runs over it. Frames are numbered by the times at which any camera has one."""

    first: int
    last: int
    """Frames of the recording, both included."""
    methods: tuple[str, ...]
    cameras: tuple[Kind, ...]
    """Kinds of frames: video, stereo."""
    every: int = 1
    """Every K-th frame, counted back from the last one."""
    halvings: int = 0
    """How many times the images were halved in width and height."""

    @property
    def frames(self) -> range:
        """The frames of the recording that it has, in order."""
        return range(self.last - (self.count - 1) * self.every, self.last + 1, self.every)

    @property
    def count(self) -> int:
        """The number of its frames."""
        return (self.last - self.first) // self.every + 1

    def of_count(self, count: int) -> Clip:
        """Returns the clip of the last `count` of its frames."""
        return replace(self, first=self.last - (count - 1) * self.every)

    def of_begin(self, count: int) -> Clip:
        """Returns the clip of the first `count` of its frames."""
        return replace(self, first=self.frames[0], last=self.frames[count - 1])

    def thinned(self, count: int) -> Clip:
        """Returns the clip of at most so many frames, at least 2, at a lower rate over the same stretch: it may begin
        a little earlier."""
        every = -(-(self.last - self.first) // (count - 1))
        steps = min(-(-(self.last - self.first) // every), self.last // every)
        return replace(self, every=every, first=self.last - steps * every)

    def words(self) -> str:
        """In a line of a list of trials."""
        rate = "" if self.every == 1 else f", every {self.every}."
        size = "" if self.halvings == 0 else f", size 1/{2**self.halvings}"
        what = f"{', '.join(self.methods)} on {' and '.join(self.cameras)}"
        return f"frames {self.first} to {self.last}{rate}{size} ({self.count}): {what}"


@dataclass(frozen=True)
class Trial:
    """One clip that was run."""

    clip: Clip
    fails: bool
    """Whether the failure is in it."""


@dataclass(frozen=True)
class Shrunk:
    """The smallest clip that was found."""

    clip: Clip
    trials: tuple[Trial, ...]
    """In the order in which they were made, each clip once."""
    complete: bool
    """Whether no further step could be made; else the trials were used up."""


class _Spent(Exception):
    """No trial is left."""


@dataclass
class _Search:
    """Runs each clip once, and keeps the smallest one that fails."""

    best: Clip
    fails: Callable[[Clip], bool]
    most: int
    known: dict[Clip, bool] = field(default_factory=dict)

    def ok(self, clip: Clip) -> bool:
        """Whether a clip fails; then it is the best one. Raises _Spent."""
        if clip not in self.known:
            if len(self.known) >= self.most:
                raise _Spent
            self.known[clip] = self.fails(clip)
        if self.known[clip]:
            self.best = clip
        return self.known[clip]

    def sweep(self) -> None:
        """Tries to make everything smaller once: what makes the later trials shorter comes first."""
        self._drop("methods")
        self._drop("cameras")
        if self.best.count > 1 and self.ok(self.best.of_begin(self.best.count - 1)):
            self._least(self.best.of_begin, 1, self.best.count)
        self._least(self.best.of_count, 1, self.best.count)
        self._least(self.best.thinned, 2, self.best.count)
        while self.ok(replace(self.best, halvings=self.best.halvings + 1)):
            pass

    def _drop(self, what: str) -> None:
        """Drops methods or cameras: all but one at once, else one after the other."""
        names = getattr(self.best, what)
        if len(names) > 1 and any(self.ok(replace(self.best, **{what: (name,)})) for name in names):
            return
        for name in names:
            left = tuple(other for other in getattr(self.best, what) if other != name)
            if left:
                self.ok(replace(self.best, **{what: left}))

    def _least(self, clip: Callable[[int], Clip], least: int, most: int) -> None:
        """Finds a number of frames that fails, whose predecessor does not: by doubling, as short clips are run soon,
        and then by halves. The clip of `most` frames is known to fail."""
        bad, good = least - 1, least
        while good < most and not self.ok(clip(good)):
            bad, good = good, min(2 * good, most)
        while good - bad > 1:
            middle = (bad + good) // 2
            bad, good = (bad, middle) if self.ok(clip(middle)) else (middle, good)


def shrunk(whole: Clip, end: int, fails: Callable[[Clip], bool], most: int) -> Shrunk | None:
    """Returns the smallest clip that was found in at most `most` trials, or None where `whole` does not fail.

    `end` is the frame of the failure, after which nothing is needed; `fails` says whether it remains, and always the
    same of a clip.
    """
    search = _Search(whole, fails, most)
    complete = True
    try:
        if not search.ok(whole):
            return None
        if end < whole.last:  # mostly one trial: nothing after it is needed
            search.ok(replace(whole, last=end))
        before = None
        while before != search.best:
            before = search.best
            search.sweep()
    except _Spent:
        complete = False
    if not search.known.get(search.best):
        return None
    return Shrunk(search.best, tuple(Trial(*each) for each in search.known.items()), complete)


def neighbours(clip: Clip) -> Iterator[Clip]:
    """Yields the clips that are smaller by one step: without one method, camera, the last frame or the first one; at
    the next lower rate that has fewer frames; of images of half the size. None of them fails where the search was
    complete."""
    for what in ("methods", "cameras"):
        for name in (names := getattr(clip, what)):
            if len(names) > 1:
                yield replace(clip, **{what: tuple(other for other in names if other != name)})
    if clip.count > 1:
        yield clip.of_begin(clip.count - 1)
        yield clip.of_count(clip.count - 1)
    if clip.count > 2:
        yield clip.thinned(clip.count - 1)
    yield replace(clip, halvings=clip.halvings + 1)
