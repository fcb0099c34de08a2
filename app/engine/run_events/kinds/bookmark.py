"""A person marked a frame."""

from __future__ import annotations

from ...verdict import Severity
from ..event import EventKind

KIND = EventKind("bookmark", "Bookmark", Severity.OK, "A frame that a person marked.", scope="person")
