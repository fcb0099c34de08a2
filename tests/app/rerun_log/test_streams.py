"""The live stream never makes the worker wait."""

from __future__ import annotations

import socket

import pytest
import rerun as rr
from ispom_app.rerun_log import blueprint, streams
from ispom_app.run.playback import Playback

from ispom.estimators import METHODS
from ispom.types import VideoFrame
from tests import doubles
from tests.app import helpers

rr.set_strict_mode(True)


@pytest.fixture
def run() -> Playback:
    return Playback(doubles.sequence(), METHODS, builder=helpers.build)


def test_a_reader_that_never_comes_costs_pictures_only(run):
    mailbox = streams.Mailbox(pictures=3)
    while not run.done:
        mailbox.put(run.step())
    count = len(run.sequence)
    assert mailbox.dropped == count - 3
    events = [mailbox.take() for _ in range(count)]
    assert [e.index for e in events] == list(range(count))  # type: ignore[union-attr]
    sizes = [e.exposure.image.size for e in events if isinstance(e.exposure, VideoFrame)]  # type: ignore[union-attr]
    assert sizes[0] == 0 and sizes[-1] > 0
    mailbox.close()
    assert mailbox.take() is None


def test_the_live_stream_hands_over_without_waiting(run, monkeypatch):
    """The sender is stuck for good: `write`, another `open` and `close` return all the same."""
    monkeypatch.setattr(streams.LiveStream, "_run", lambda *_: streams.threading.Event().wait())
    live = streams.LiveStream()
    live.open(run.opened)
    while not run.done:
        live.write(run.step())
    assert live.dropped == max(0, len(run.sequence) - streams.PICTURES_WAITING)
    live.open(run.opened)
    live.write(run.finish())
    live.close()


def test_the_live_stream_listens_on_this_machine_only(run):
    live = streams.LiveStream()
    assert live.url == f"rerun+http://127.0.0.1:{live.port}/proxy"
    with socket.create_connection(("127.0.0.1", live.port), timeout=10) as connection:
        assert connection.getpeername()[0] == "127.0.0.1"
    with socket.socket() as other:
        other.settimeout(2)
        assert other.connect_ex(("127.0.0.2", live.port)) != 0
    live.close()


@pytest.mark.parametrize("hidden", [(), ("clouds", "monocular", "trails")])
def test_the_layout_can_be_made_for_every_rig(run, hidden):
    assert blueprint.blueprint(run.opened, hidden) is not None
