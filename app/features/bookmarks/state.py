"""The bookmarks of the source."""

from __future__ import annotations

from dataclasses import dataclass

from ...engine.events import Bookmark
from ...session.state import FeatureState


@dataclass(frozen=True)
class Bookmarks(FeatureState):
    marks: tuple[Bookmark, ...] = ()
    """In the order of their frames."""
