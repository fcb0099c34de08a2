"""The contract test finds each way in which an estimator can break the contract, and says which."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Annotated, Any

import numpy as np
import pytest

from ispom.estimator import Method
from ispom.geometry import Pose
from ispom.persistent_list import PersistentList
from ispom.settings import Range
from ispom.testing import check_estimator
from ispom.testing.values import depth, digest
from ispom.types import Check, Exposure, Rig, Status, Step, Tracks, TrackStatus, Trajectory, VideoFrame

CONTRAST = Check("contrast", "contrast", "requirement")
CHECK = CONTRAST.of(3, 2)


@dataclass(frozen=True, eq=False)
class WalkerState:
    poses: PersistentList[tuple[int, Pose]] = PersistentList()
    counted: Any = 0
    """What a broken walker keeps besides."""


@dataclass(frozen=True)
class WalkerConfig:
    """Settings of a walker."""

    pace: Annotated[float, Range(0.1, 2)] = 1.0
    """Its unit."""

    def build(self, rig: Rig) -> Walker:
        return Walker(self)


@dataclass
class Walker:
    """Walks straight on while it sees something; keeps the contract."""

    config: Any
    hidden: list[Any] = field(default_factory=list)
    """Of broken walkers: what they must not have."""

    def start(self) -> Any:
        return WalkerState()

    def step(self, state: Any, exposure: Exposure) -> tuple[Any, Step]:
        assert isinstance(exposure, VideoFrame)
        if exposure.image.std() < 1:
            return state, Step(exposure.time_ns, Status.LOST, "video", seconds={"look": 0.0})
        pose = Pose(translation=np.array([0.0, 0.0, self.config.pace * len(state.poses)]))
        tracks = Tracks.of(np.array([len(state.poses)]), np.array([[3.0, 4.0]]), status=np.array([TrackStatus.LOST]))
        step = Step(exposure.time_ns, Status.TRACKING, "video", pose, seconds={"look": 0.0})
        step = replace(step, tracks={"video": tracks}, decisions=(CHECK,))
        return replace(state, poses=state.poses.appended((exposure.time_ns, pose))), step

    def finish(self, state: Any) -> Trajectory:
        return Trajectory.of(list(state.poses), "video")


def method(broken: type[Walker] = Walker, config: type = WalkerConfig, **changes: Any) -> Method:
    built = type("Config", (config,), {"build": lambda self, rig: broken(self), "__module__": __name__})
    return Method(
        **{
            "name": "walker",
            "needs": frozenset({"video"}),
            "config": built,
            "unit": "own",
            "source": "a walk",
            "checks": {"contrast": CONTRAST},
        }
        | changes
    )


def saying(**what: Any) -> type[Walker]:
    """A walker whose Steps say something else."""

    class Saying(Walker):
        def step(self, state: Any, exposure: Exposure) -> tuple[Any, Step]:
            after, step = super().step(state, exposure)
            found = {name: value(step, state) if callable(value) else value for name, value in what.items()}
            return after, replace(step, **found)

    return Saying


def keeping(counted: Callable[[Walker, Any, Exposure], Any]) -> type[Walker]:
    """A walker whose State holds something else."""

    class Keeping(Walker):
        def step(self, state: Any, exposure: Exposure) -> tuple[Any, Step]:
            after, step = super().step(state, exposure)
            return replace(after, counted=counted(self, state, exposure)), step

    return Keeping


def revising(time_ns: int, **more: Any) -> type[Walker]:
    moved = Trajectory.of([(time_ns, Pose(translation=np.ones(3)))], "video")
    return saying(revised=lambda step, _: moved if step.time_ns > 10**9 else Trajectory.empty("video"), **more)


def growing_list(walker: Walker, state: WalkerState, _: Exposure) -> list[int]:
    kept = state.counted or []
    kept.append(len(kept))
    return kept


class Printing(Walker):
    def start(self) -> Any:
        sys.stdout.write("hello")
        return super().start()


class Thawed(Walker):
    def start(self) -> Any:
        return (WalkerState(),)

    def step(self, state: Any, exposure: Exposure) -> tuple[Any, Step]:
        after, step = super().step(state[0], exposure)
        return (after,), step

    def finish(self, state: Any) -> Trajectory:
        return super().finish(state[0])


class Scribbling(Walker):
    def step(self, state: Any, exposure: Exposure) -> tuple[Any, Step]:
        found = super().step(state, exposure)
        exposure.image[0, 0] ^= 1  # type: ignore[union-attr]
        return found


class Impatient(Walker):
    def finish(self, state: Any) -> Trajectory:
        return Trajectory.of([list(state.poses)[-1]], "video")


class Counting(Walker):
    """Remembers in itself what belongs into the State."""

    def step(self, state: Any, exposure: Exposure) -> tuple[Any, Step]:
        after, step = super().step(state, exposure)
        self.hidden.append(exposure.time_ns)
        return after, replace(step, residuals_px=np.array([float(len(self.hidden))]))


class Afraid(Walker):
    def step(self, state: Any, exposure: Exposure) -> tuple[Any, Step]:
        if not exposure.image.any():  # type: ignore[union-attr]
            raise ZeroDivisionError("nothing there")
        return super().step(state, exposure)


class Settled(Walker):
    """Cannot go on from a State of another pace."""

    def step(self, state: Any, exposure: Exposure) -> tuple[Any, Step]:
        if state.counted not in (0, self.config.pace):
            raise ValueError("another pace")
        after, step = super().step(state, exposure)
        return replace(after, counted=self.config.pace), step


@dataclass(frozen=True)
class Unexplained(WalkerConfig):
    size: Annotated[int, Range(1, 3)] = 2


@dataclass(frozen=True)
class Unlimited(WalkerConfig):
    size: int = 2
    """How large."""


TRACKED = Tracks.of(np.array([1, 1]), np.array([[3.0, 4.0], [5.0, 6.0]]))
BROKEN = {
    "prints on standard output": Printing,
    "has a State that is no frozen dataclass (tuple), at the start": Thawed,
    "writes into the images that it is given, at frame 0": Scribbling,
    "cannot finish after (IndexError: list index out of range), at the start": Impatient,
    "gives something else when it is stepped twice from one State: another Step, at frame 0": Counting,
    "gives something else in another run: another State": keeping(lambda *_: object.__hash__(object()) + id(_)),
    "cannot step (ZeroDivisionError: nothing there), at frame 0 all black": Afraid,
    "cannot step (ValueError: another pace)": Settled,
    "State that was kept from before": keeping(growing_list),
    "has a State nested": keeping(lambda w, state, _: (state.counted,)),
    "has a State that grows by": keeping(lambda w, s, e: (*(s.counted or ()), e.image.copy())),  # type: ignore
    "tracks in images without texture, at frame 0 without texture": saying(status=Status.TRACKING),
    "never tracks": saying(status=Status.LOST),
    "gives a Step of the time 7 ns, at frame 0": saying(time_ns=7),
    "gives no wall time": saying(seconds={}),
    "covariance that is not (6, 6)": saying(covariance=-np.eye(6)),
    "residuals that are no list": saying(residuals_px=np.array([-1.0])),
    "whose ids are not unique": saying(tracks={"video": TRACKED}),
    "which the rig does not have": saying(tracks={"top": TRACKED}),
    "outside of its image": saying(tracks={"video": Tracks.of(np.array([1]), np.array([[900.0, 4.0]]))}),
    "not int64": saying(tracks={"video": replace(TRACKED, ids=np.array([1.0, 2.0]))}),
    "that had ended before": saying(
        tracks={"video": Tracks.of(np.array([1]), np.ones((1, 2)), status=np.array([TrackStatus.LOST]))}
    ),
    "whose key is not of small letters": saying(decisions=(replace(CHECK, key="Contrast!"),)),
    "a check twice in one Step": saying(decisions=(CHECK, CHECK)),
    "describes its check 'contrast' in two ways": saying(
        decisions=lambda step, state: (replace(CHECK, unit="px" if len(state.poses) > 3 else ""),)
    ),
    "makes a check 'colour' that is not in Method.checks": saying(decisions=(replace(CHECK, key="colour"),)),
    "which is a trigger, but of no question": saying(decisions=(replace(CHECK, kind="trigger"),)),
    "revises poses of later frames": revising(99 * 10**9),
    "revises a pose at a time of no frame": revising(5),
    "which was declared final": revising(0, final_until_ns=lambda step, _: step.time_ns // 2),
    "takes back what it declared final": saying(final_until_ns=lambda step, _: -step.time_ns),
    "gives poses of the frame rig after some of the frame video": saying(
        frame=lambda step, state: "rig" if len(state.poses) > 3 else "video"
    ),
}


def test_one_that_keeps_the_contract_passes() -> None:
    check_estimator(method())


@pytest.mark.parametrize("sentence", BROKEN)
def test_what_is_broken_is_named(sentence: str) -> None:
    with pytest.raises(AssertionError) as told:
        check_estimator(method(BROKEN[sentence]))
    text = str(told.value)
    assert text.startswith("walker ") and sentence in text and "\n" not in text


@pytest.mark.parametrize(
    ("sentence", "broken"),
    [
        ("does not explain its setting size", method(config=Unexplained)),
        ("has no Range for its setting size", method(config=Unlimited)),
        ("has a name that is not", method(name="My Walker")),
        ("gives no reference in Method.source", method(source=" ")),
    ],
)
def test_what_a_method_says_about_itself(sentence: str, broken: Method) -> None:
    with pytest.raises(AssertionError, match=sentence):
        check_estimator(broken)


def test_digests_differ_where_values_do() -> None:
    state = WalkerState(PersistentList().extended([(1, Pose())]), {"a": np.zeros(2), "b": (1.5, None)})
    assert digest(state) == digest(replace(state))
    for other in ({"a": np.zeros(2, np.float32), "b": (1.5, None)}, {"a": np.zeros(2), "b": (1.5, 0)}, -0.0):
        assert digest(replace(state, counted=other)) != digest(state)
    assert digest(0.0) != digest(-0.0) and digest(1) != digest(True) and digest((1, 2)) != digest([1, 2])


def test_depth_counts_nesting_and_not_length() -> None:
    nested: tuple[Any, ...] = ()
    for _ in range(5_000):
        nested = (nested,)
    assert depth(nested) == 5_001
    assert depth(PersistentList().extended(range(5_000))) < 10
