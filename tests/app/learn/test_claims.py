"""What the texts of the lessons say is what the runs show, whatever the seed.

Seed 0 is that of the app: tests/app/page/test_lessons.py finds no doubt in its page after any answer.
"""

from __future__ import annotations

import pytest
from ispom_app.features.lessons.lesson import Choose, Lesson, Point
from ispom_app.features.lessons.library import built_in
from ispom_app.features.lessons.page_message import html

from tests.app.learn.runs import shown


@pytest.mark.slow
@pytest.mark.parametrize("lesson", built_in(), ids=lambda lesson: lesson.name)
@pytest.mark.parametrize("seed", [1, 2])
def test_each_answer_is_what_the_text_claims(lesson: Lesson, seed: int):
    for number, (step, found) in enumerate(shown(lesson, seed), 1):
        where = f"step {number} of {lesson.name}: {dict(found.values)}"
        assert not found.broken, where
        assert step.claims or isinstance(step.ask, Point), where
        if isinstance(step.ask, Choose):
            assert len(found.right) == 1, where
        if isinstance(step.ask, Point):
            assert found.right, where
        assert "nan" not in html(step.after, found.values), where
