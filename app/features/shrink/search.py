"""The search for the smallest clip in which a failure remains, over any test for that. It reads no image.

The failure need not come and go evenly: a shorter clip may fail where a longer one does not. What is promised is that
the clip fails, and that it does not without any single part: see `neighbours`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

from ispom.errors import counted
from ispom.types import Kind


@dataclass(frozen=True)
class Clip:
    """A part of a recording, and what runs over it."""

    frames: tuple[int, ...]
    """Increasing numbers of its frames in the recording, by the times at which any camera has one."""
    methods: tuple[str, ...]
    cameras: tuple[Kind, ...]
    """Kinds of frames: video, stereo."""
    halvings: int = 0
    """How many times the images were halved in width and height."""

    @property
    def count(self) -> int:
        """The number of its frames."""
        return len(self.frames)

    def of_count(self, count: int) -> Clip:
        """Returns the clip of the last `count` of its frames."""
        return replace(self, frames=self.frames[-count:])

    def of_begin(self, count: int) -> Clip:
        """Returns the clip of the first `count` of its frames."""
        return replace(self, frames=self.frames[:count])

    def thinned(self, count: int) -> Clip:
        """Returns the clip of every K-th frame: at most `count` frames, at least 3. The first frame stays, and the last
        two: a larger step to the frame of a failure could be a failure of its own."""
        every = -(-(self.count - 2) // (count - 2))
        kept = self.frames[-2::-every][::-1]
        return replace(
            self, frames=(*(kept if kept[0] == self.frames[0] else (self.frames[0], *kept)), self.frames[-1])
        )

    def words(self) -> str:
        """In a line of a list of trials."""
        size = "" if self.halvings == 0 else f", size 1/{2**self.halvings}"
        what = f"{', '.join(self.methods)} on {' and '.join(self.cameras)}"
        return f"{counted(self.count, 'frame')} ({spans(self.frames)}){size}: {what}"


def spans(frames: Sequence[int]) -> str:
    """Returns increasing numbers in words: 3, 5 to 9, 12 to 18 by 2."""
    parts, i = list[str](), 0
    while i < len(frames):
        step = frames[i + 1] - frames[i] if i + 1 < len(frames) else 1
        j = i
        while j + 1 < len(frames) and frames[j + 1] - frames[j] == step:
            j += 1
        if j - i < (1 if step == 1 else 2):  # two numbers with a gap are no sequence
            j = i
        by = "" if step == 1 or i == j else f" by {step}"
        parts.append(str(frames[i]) if i == j else f"{frames[i]} to {frames[j]}{by}")
        i = j + 1
    return ", ".join(parts)


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


class Spent(Exception):
    """No trial is left, or no time. The test of a clip may raise it, too."""


@dataclass
class _Search:
    """Runs each clip once, and keeps the smallest one that fails."""

    best: Clip
    fails: Callable[[Clip], bool]
    most: int
    known: dict[Clip, bool] = field(default_factory=dict)

    def ok(self, clip: Clip) -> bool:
        """Whether a clip fails; then it is the best one. Raises Spent."""
        if clip not in self.known:
            if len(self.known) >= self.most:
                raise Spent
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
        self._least(self.best.thinned, 3, self.best.count)
        while self.ok(replace(self.best, halvings=self.best.halvings + 1)):
            pass
        self._leave_out()

    def _drop(self, what: str) -> None:
        """Drops methods or cameras: all but one at once, else one after the other."""
        names = getattr(self.best, what)
        if len(names) > 1 and any(self.ok(replace(self.best, **{what: (name,)})) for name in names):
            return
        for name in names:
            left = tuple(other for other in getattr(self.best, what) if other != name)
            if left:
                self.ok(replace(self.best, **{what: left}))

    def _leave_out(self) -> None:
        """Leaves out frames between the others, first half of them at a time, at last each alone."""
        size = max(self.best.count // 2, 1)
        while size:
            at = 0
            while at < self.best.count:
                left = self.best.frames[:at] + self.best.frames[at + size :]
                if not left or not self.ok(replace(self.best, frames=left)):
                    at += size
            size //= 2

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

    `end` is the place of the failure's frame in `whole`; `fails` says whether it remains, and always the same of a
    clip.
    """
    search = _Search(whole, fails, most)
    complete = True
    try:
        if not search.ok(whole):
            return None
        search.ok(whole.of_begin(end + 1))  # mostly nothing after it is needed
        before = None
        while before != search.best:
            before = search.best
            search.sweep()
    except Spent:
        complete = False
    if not search.known.get(search.best):
        return None
    return Shrunk(search.best, tuple(Trial(*each) for each in search.known.items()), complete)


def neighbours(clip: Clip) -> Iterator[Clip]:
    """Yields the clips that are smaller by one step: without one method, camera or frame; of images of half the size.
    None of them fails where the search was complete."""
    for what in ("methods", "cameras"):
        for name in (names := getattr(clip, what)):
            if len(names) > 1:
                yield replace(clip, **{what: tuple(other for other in names if other != name)})
    for i in range(clip.count if clip.count > 1 else 0):
        yield replace(clip, frames=clip.frames[:i] + clip.frames[i + 1 :])
    yield replace(clip, halvings=clip.halvings + 1)
