"""A lesson as the page shows it: what is known of its answer goes out when it is revealed, and not before."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
from markdown_it import MarkdownIt

from ispom.types import Sequence

from ...session.current_run import CurrentRun
from ...session.state import State
from ...views.viser.drawing import in_view, picture
from ...views.web.messages import PageLink, PageMessage
from ...views.web.news import Look, News
from ..tracks.track_picture import image_of
from .answers import Answers
from .lesson import Ask, Choose, Draw, Number, Point
from .reveal import Revealed, places, true_heights
from .state import Learning, Lessons


def html(markdown: str, values: Mapping[str, float] | None = None) -> str:
    """With the values in their places; without values, as it stands."""
    return _renderer().render(markdown if values is None else markdown.format(**values))


@cache
def _renderer() -> MarkdownIt:
    return MarkdownIt("js-default")


WIDTH = 640
"""Width of the image at which a person points [px]."""
NOT_SO = (
    "On this machine the run came out otherwise than the text says (it holds for the versions of the libraries that it "
    "was tested with)."
)


class Answer(PageMessage, frozen=True):
    """An answer to the question of a lesson, from whomever it comes."""

    given: Any
    """As it was sent."""

    def heard(self, page: PageLink) -> None:
        learning = page.session.state[Lessons].now
        if page.session.extra(Answers).put(page.person.key, learning, self.given):
            page.ring()


class LessonNews(News):
    """What a page has been sent of lessons."""

    def __init__(self) -> None:
        self._sent: tuple[object, ...] = (None, 0)

    def of(self, look: Look) -> Mapping[str, Any]:
        return self.since(look.state, look.run, look.session.extra(Answers), look.person)

    def since(self, state: State, run: CurrentRun | None, answers: Answers, person: str) -> dict[str, Any]:
        """The lesson, where there is something new of it: None for none any more."""
        learning = state[Lessons].now
        now = (learning, answers.version if learning is not None else 0)
        if now == self._sent:
            return {}
        self._sent = now
        if learning is None:
            return {"lesson": None}
        sequence = run.opened.sequence if run is not None else None
        return {"lesson": lesson_message(learning, sequence) | answers.seen_by(person, learning)}


def lesson_message(learning: Learning, sequence: Sequence | None) -> dict[str, Any]:
    """Without what differs from person to person. The sequence is that of the run that is shown."""
    lesson, step, found = learning.lesson, learning.step, learning.revealed
    return {
        "name": lesson.name,
        "title": lesson.title,
        "about": html(lesson.about) if learning.place == 0 else "",
        "place": learning.place,
        "steps": len(lesson.steps),
        "heading": step.title,
        "before": html(step.before),
        "phase": learning.phase,
        "covers": learning.covers,
        "ask": _question(step.ask, learning, sequence),
        "after": None if found is None else html(step.after, found.values),
        "doubt": NOT_SO if found is not None and found.broken else "",
        "truth": None if found is None else _truth(step.ask, found),
    }


def _question(ask: Ask, learning: Learning, sequence: Sequence | None) -> dict[str, Any]:
    match ask:
        case Choose(options):
            return {"kind": "choose", "options": [option.text for option in options]}
        case Number(unit=unit):
            return {"kind": "number", "unit": unit}
        case Draw(x=x, y=y, x_range=across, y_range=up):
            return {"kind": "draw", "x": x, "y": y, "x_range": across, "y_range": up, "at": places(ask).tolist()}
        case Point():
            return {"kind": "point"} | _picture(learning, sequence)


def _picture(learning: Learning, sequence: Sequence | None) -> dict[str, Any]:
    """The image and its tracks, drawn the same; nothing before the question is open, or without the image."""
    pointed = learning.pictured
    image = None if pointed is None or sequence is None else image_of(sequence, pointed[0])
    if pointed is None or image is None:
        return {"image": None, "dots": []}
    tracks = pointed[1]
    seen = np.isfinite(tracks.uv).all(1)
    places = np.round(in_view(tracks.uv[seen]), 1).tolist()
    dots = [[number, u, v] for number, (u, v) in zip(tracks.ids[seen].tolist(), places, strict=True)]
    return {"image": picture(image, WIDTH), "width": image.shape[1], "height": image.shape[0], "dots": dots}


def _truth(ask: Ask, found: Revealed) -> Any:
    """Places of the options or ids of the tracks that are right, the number, or the curve's heights at `at`."""
    match ask:
        case Choose() | Point():
            return sorted(found.right)
        case Number(value):
            return found.values[value]
        case Draw():
            return true_heights(found, ask).tolist()


NEWS = (LessonNews,)
