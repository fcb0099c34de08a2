"""Learn: the lessons that there are, and how far one came in each. A click begins one, or goes on with it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import viser

from ...session.state import State
from ...views.viser.markup import renderer
from ...views.viser.panels import Panel
from .lesson import Lesson
from .library import Library
from .state import Lessons

if TYPE_CHECKING:
    from ...session.session import Session

render = renderer(__package__)

NAME = "Learn"


class LearnPanel:
    def __init__(self, gui: viser.GuiApi, session: Session) -> None:
        self._lessons = session.extra(Library).lessons
        self._html = gui.add_html("")
        self._shown: Mapping[str, int] | None = None

    def show(self, state: State) -> None:
        if state[Lessons].progress is not self._shown:
            self._shown = state[Lessons].progress
            self._html.content = listed(self._lessons, state[Lessons].progress)


def listed(lessons: tuple[Lesson, ...], progress: Mapping[str, int]) -> str:
    """As HTML."""
    rows = [(lesson, min(progress.get(lesson.name, 0), len(lesson.steps))) for lesson in lessons]
    return render("learn.html", rows=rows)


PANELS = (Panel(NAME, 800, LearnPanel, leads=lambda session: session.extra(Library).leads),)
