"""The tab Tracks."""

from __future__ import annotations

from ...views.viser.panels import Panel
from .tab import NAME, LookTab

PANELS = (Panel(NAME, 200, LookTab),)
