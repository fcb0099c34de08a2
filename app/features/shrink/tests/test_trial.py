"""What counts as the same failure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from ispom_app.engine.run_events.event import RunEvent
from ispom_app.engine.verdict import Severity
from ispom_app.features.shrink.search import Clip
from ispom_app.features.shrink.trial import Bench, Failure, Outcome, control_of, quiet_stretches

from ispom.ensemble import Ensemble
from ispom.methods import Config
from ispom.types import Measurement, Rig, Sequence, Status, Step, images_of
from tests import doubles

TIMES = [100 * i for i in range(20)]
EVENT = RunEvent("lost", "monocular", 10, 1000, Severity.LOST, "Lost.", cause="pose_points")


def test_an_event_is_the_same_by_kind_method_cause_and_nearly_its_frame() -> None:
    failure = Failure.of(EVENT, TIMES, 2)
    assert failure.is_in(replace(EVENT, time_ns=800)) and failure.is_in(replace(EVENT, time_ns=1200, frame=3))
    for other in (
        replace(EVENT, time_ns=700), replace(EVENT, time_ns=1300), replace(EVENT, kind="scale"),
        replace(EVENT, method="stereo"), replace(EVENT, cause="parallax"),
    ):  # fmt: skip
        assert not failure.is_in(other)
    assert failure.at_any_time.is_in(replace(EVENT, time_ns=0))


def test_a_control_lies_where_no_such_event_is_near() -> None:
    assert quiet_stretches([30, 60], 5) == (range(36, 55), range(25))
    assert quiet_stretches([3], 5) == (range(0),)
    clip = Clip((50, 52, 60), ("monocular",), ("video",))
    video = [frozenset({"video"})] * 61
    control = control_of(clip, (range(36, 55), range(25)), video)
    assert control is not None and control.frames == (44, 46, 54)
    long = control_of(replace(clip, frames=(40, 60)), (range(36, 55), range(25)), video)
    assert long is not None and long.frames == (4, 24)
    assert control_of(replace(clip, frames=(0, 60)), (range(25),), video) is None
    pairs = [frozenset({"video", "stereo"} if i % 3 == 0 else {"video"}) for i in range(61)]
    both = control_of(replace(clip, cameras=("stereo", "video")), (range(36, 55),), pairs)
    assert both is not None and both.frames == (44, 46, 54)
    one_later = control_of(replace(clip, cameras=("stereo", "video")), (range(36, 54),), pairs)
    assert one_later is not None and one_later.frames == (41, 43, 51)


class Shaky(doubles.FakeEstimator):
    """Is lost at dark images, and wherever an image is small."""

    def step(self, state: tuple, exposure: Measurement, asked: object = None) -> tuple[tuple, Step]:
        after, step = super().step(state, exposure, asked)
        image = next(iter(images_of(exposure).values()))
        if (image.mean() < 20 or image.shape[1] < 80) and len(state) >= 2:
            return after, replace(step, status=Status.LOST, world_from_frame=None, decisions=())
        return after, step


@pytest.fixture
def bench() -> Bench:
    whole = doubles.sequence(30)
    dark = whole.times_ns[-5]

    def load(i: int) -> Measurement:
        measured = whole.load(i)
        images = {n: np.zeros_like(image) for n, image in images_of(measured).items()}
        return replace(measured, images=images) if measured.time_ns >= dark else measured

    def build(config: Config, methods: tuple[str, ...], rig: Rig) -> Ensemble:
        return doubles.ensemble(methods, Shaky)

    sequence: Sequence = replace(whole, load=load)
    times = sorted(set(whole.times_ns.tolist()))
    at = times.index(int(dark))
    event = replace(EVENT, time_ns=int(dark), cause="")
    failure = Failure.of(event, times, 2)
    return Bench(sequence, Config(), build, failure, lambda: None, quiet_stretches([at], 2))


def test_a_failure_that_the_cut_makes_anywhere_is_none(bench: Bench) -> None:
    times = sorted(set(bench.whole.times_ns.tolist()))
    at = next(i for i, t in enumerate(times) if t > bench.failure.from_ns) + 1
    clip = Clip(tuple(range(at - 6, at + 1)), ("monocular",), ("video",))
    assert bench.outcome(clip) == Outcome.REMAINS
    short = replace(clip, frames=clip.frames[-3:])
    assert bench.outcome(short) == Outcome.REMAINS
    assert bench.outcome(replace(short, halvings=1)) == Outcome.ANYWHERE
    assert bench.outcome(replace(clip, methods=("stereo",), cameras=("stereo",))) == Outcome.GONE
    assert bench.outcome(replace(clip, frames=clip.frames[-1:])) == Outcome.GONE


def test_a_larger_step_to_the_failure_is_another_one(bench: Bench) -> None:
    times = sorted(set(bench.whole.times_ns.tolist()))
    at = next(i for i, t in enumerate(times) if t > bench.failure.from_ns) + 1
    clip = Clip(tuple(range(at - 6, at + 1)), ("monocular",), ("video",))
    assert bench.outcome(replace(clip, frames=(*clip.frames[:-3], at))) == Outcome.GONE
    assert bench.outcome(replace(clip, frames=(*clip.frames[:2], *clip.frames[-3:]))) == Outcome.REMAINS
