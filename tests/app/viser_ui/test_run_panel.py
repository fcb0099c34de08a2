"""What the panel of the run says, without a browser."""

from __future__ import annotations

from ispom_app.features.playback.panel import _text
from ispom_app.session.state import Opening, OpeningFailed, State, reduce


def test_a_page_that_comes_after_a_failed_opening_says_why() -> None:
    failed = reduce(State("nowhere"), OpeningFailed("nowhere does not exist: correct the path"))
    assert "Nothing is open" in _text(failed) and "nowhere does not exist: correct the path" in _text(failed)
    assert "does not exist" not in _text(reduce(failed, Opening("sim:tiny")))
