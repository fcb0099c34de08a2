"""A feed: every frame once and in order, for a reader at its own pace, and no more than a second of images waits."""

from __future__ import annotations

import gc
import weakref
from dataclasses import replace
from threading import Thread

import pytest
from ispom_app.engine.events import Event, Finished, Pictured, Stepped
from ispom_app.engine.history.feed import IMAGES_WAITING, Feed
from ispom_app.engine.history.history import History
from ispom_app.engine.history.record import ExposureRecord
from ispom_app.engine.playback import Playback

from ispom.errors import UnreadableImage
from ispom.types import Measurement, is_video
from tests import doubles
from tests.alone import METHODS
from tests.app import helpers

N = 2 * IMAGES_WAITING


@pytest.fixture
def run() -> Playback:
    return Playback(doubles.sequence(N), METHODS, builder=helpers.build)


def fed(run: Playback, feed: Feed, count: int) -> None:
    for _ in range(count):
        event = run.step()
        feed.history.append(ExposureRecord.of(event, feed.history.last))
        feed.offer(event)


def taken(feed: Feed) -> list[Event]:
    found = list[Event]()
    while (event := feed.take()) is not None:
        found.append(event)
    return found


def pixels(event: Event) -> int:
    assert isinstance(event, Stepped)
    return event.exposure.image.size if is_video(event.exposure) else event.exposure.left.size


@pytest.mark.parametrize("rereads", [True, False])
def test_a_late_reader_gets_every_exposure_and_the_newest_images(run: Playback, rereads: bool) -> None:
    feed = Feed(run.opened, History(memory_bytes=0), rereads=rereads)
    fed(run, feed, N)
    feed.finish(run.finish(), ends=True)
    events = taken(feed)
    assert [e.index for e in events[:-1] if isinstance(e, Stepped)] == list(range(N))
    assert isinstance(events[-1], Finished) and feed.take() is None
    assert pixels(events[N - 1]) > 0 and (pixels(events[0]) > 0) == rereads
    assert feed.dropped == (0 if rereads else N - IMAGES_WAITING)


def test_what_comes_after_the_end_is_not_given(run: Playback) -> None:
    feed = Feed(run.opened, History(), rereads=True)
    fed(run, feed, 5)
    feed.finish(None, ends=True)
    fed(run, feed, 5)
    assert len(taken(feed)) == 5


def test_a_reader_waits_and_is_let_go(run: Playback) -> None:
    feed, found = Feed(run.opened, History(), rereads=True), list[Event]()
    reader = Thread(target=lambda: found.extend(taken(feed)))
    reader.start()
    fed(run, feed, 3)
    feed.finish(run.finish())
    fed(run, feed, 2)
    feed.finish(None, ends=True)
    reader.join(10)
    assert not reader.is_alive() and sum(isinstance(e, Stepped) for e in found) == 5
    feed.close()
    assert feed.take() is None


def test_an_image_that_went_missing_is_blank(run: Playback) -> None:
    def gone(_: int) -> Measurement:
        raise UnreadableImage("image 0 is gone: restore it")

    opened = replace(run.opened, sequence=replace(run.sequence, load=gone))
    feed = Feed(opened, History(), rereads=True)
    fed(run, feed, N)
    assert pixels(feed.take() or Finished({}, {})) == 0


def test_images_that_were_taken_are_not_kept(run: Playback) -> None:
    feed = Feed(run.opened, History(), rereads=False)
    fed(run, feed, 5)
    kept = []
    for _ in range(4):
        event = feed.take()
        assert event is not None and pixels(event) > 0
        kept.append(weakref.ref(event))
    del event
    gc.collect()
    assert [ref() for ref in kept] == [None] * 4


def test_a_pause_ends_when_it_is_closed(run: Playback) -> None:
    feed = Feed(run.opened, History(), rereads=False)
    pausing = Thread(target=lambda: feed.pause(3600.0), daemon=True)
    pausing.start()
    feed.close()
    pausing.join(60.0)
    assert not pausing.is_alive()


def test_an_exposure_that_is_looked_at_gets_the_images_that_it_came_without(run: Playback) -> None:
    history = History(memory_bytes=0)
    for _ in range(N):
        event = run.step()
        history.append(ExposureRecord.of(event, history.last))
    feed = Feed(run.opened, history, rereads=False)
    feed.look_at(12)
    events = [feed.take() for _ in range(13 + 2)]
    pictured = [e for e in events if isinstance(e, Pictured)]
    kinds = run.opened.sequence.kinds
    other = next(i for i in reversed(range(12)) if kinds[i] != kinds[12])
    assert sorted(p.index for p in pictured) == [other, 12], "its own, and the other camera's latest"
    for picture in pictured:
        exposure = picture.exposure
        image = exposure.image if is_video(exposure) else exposure.left
        assert image.size and [s.time_ns for s in picture.steps] == [s.time_ns for s in history[picture.index].steps]
    assert [e.index for e in events if isinstance(e, Stepped)] == list(range(13)), "all others in their order"
    feed.look_at(12)
    assert isinstance(feed.take(), Stepped), "once is enough"
