"""Lessons in a real browser: one leads, each answers for themselves, and no answer is shown before it is revealed."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest
from ispom_app.features.lessons.library import built_in

from tests.app.page.test_browser import CHROMIUM, FAKE, App, Page, browser, serving  # noqa: F401 - a fixture

NAMES = [lesson.name for lesson in built_in()]
ALWAYS = ("stereo",)
"""They have every kind of question."""
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")
TEXT = """() => {
  const copy = document.documentElement.cloneNode(true);
  for (const other of copy.querySelectorAll("script, style, svg")) other.remove();
  const names = ["title", "aria-label", "value", "data-plot"];
  const said = [...copy.querySelectorAll("*")].flatMap((each) => names.map((name) => each.getAttribute(name)));
  return [copy.textContent, ...said.filter(Boolean)].join(" ");
}"""
UNKNOWN = (
    "lesson.after === null && lesson.truth === null && lesson.verdict === null && !Object.keys(lesson.chosen).length"
)
NUMBER = re.compile(r"\d+\.\d{2,}|\d{3,}")
"""What hardly stands in a page by chance."""


@pytest.fixture(scope="module")
def own(tmp_path_factory: pytest.TempPathFactory) -> Iterator[App]:
    yield from serving("serve_lessons", tmp_path_factory.mktemp("own"), "own")


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[App]:
    yield from serving("serve_lessons", tmp_path_factory.mktemp("recordings"))


class Learner(Page):
    """A page at a lesson."""

    @property
    def lesson(self):
        """In the tab that is open then."""
        self.open_tab("Lesson")
        return self.tab.locator("#lesson")

    def asked(self, title: str) -> None:
        """The question of this step is open."""
        self.tab.locator("#lesson").get_by_role("heading", name=title).wait_for()
        self.lesson.locator(".reveal").wait_for(state="attached")

    def revealed(self) -> None:
        self.lesson.locator(".after").wait_for()

    def text(self) -> str:
        """All words in the page and in the frame of its panels, shown or not."""
        return " ".join(frame.evaluate(TEXT) for frame in self.tab.frames)


@pytest.fixture(scope="module")
def both(browser, own: App) -> Iterator[tuple[Learner, Learner]]:  # noqa: F811
    teacher, student = (Learner(browser, own.url, viewer=FAKE) for _ in range(2))
    student.until("state.people.driver === 1", "the first one drives")
    yield teacher, student
    for page in (teacher, student):
        assert not page.faults
        page.tab.close()


def test_the_lessons_are_listed_and_a_click_begins_one_for_all(both: tuple[Learner, Learner]):
    teacher, student = both
    assert teacher.tab.locator("#modes input[value=learn]").is_checked()
    teacher.tab.locator("#learn [data-learn=stand-ins]").click()
    for page in both:
        page.asked("Choose")
        assert page.lesson.get_by_text("About stand-ins.").is_visible()
    assert not student.lesson.locator(".reveal").is_visible()
    student.lesson.get_by_text("Person 1 leads through the lesson.").wait_for()


def test_while_a_question_is_open_panels_and_numbers_are_gone(both: tuple[Learner, Learner]):
    for page in both:
        page.controls.get_by_role("tab").first.wait_for(state="detached")
        assert page.tab.locator("#methods").inner_text() == "" and "double:" not in page.text()
        status = page.tab.evaluate("fetch('numbers/run').then((answer) => answer.status)")
        assert status == 403
        page.faults.clear()  # the browser's own line about the 403


def test_each_answers_for_themselves_and_sees_who_was_right(both: tuple[Learner, Learner]):
    teacher, student = both
    teacher.lesson.get_by_role("button", name="It is wrong").click()
    student.lesson.get_by_role("button", name="It is exact").click()
    teacher.lesson.get_by_text("2 people have answered.").wait_for()
    assert teacher.lesson.get_by_role("button", name="It is wrong").get_attribute("aria-pressed") == "true"
    assert student.lesson.get_by_role("button", name="It is wrong").get_attribute("aria-pressed") == "false"
    assert not teacher.tab.locator("#lesson .right").count()
    teacher.lesson.locator(".reveal").click()
    for page, verdict in zip(both, ("Your answer is not what the run shows.", "Your answer is right."), strict=True):
        page.revealed()
        page.lesson.get_by_text(verdict).wait_for()
        page.lesson.get_by_text("1 of 2 answers are right.").wait_for()
        page.controls.get_by_role("tab").first.wait_for()
    assert "Off by 0.000 m, 3.0 poses a second." in teacher.lesson.inner_text()


def test_a_number_is_kept_over_a_reload_and_the_page_says_where_the_text_is_wrong(both: tuple[Learner, Learner]):
    teacher, student = both
    teacher.lesson.get_by_role("button", name="Next").click()
    student.asked("Give a number")
    student.lesson.get_by_label("your answer").fill("29.5")
    student.until("window.ispom.lesson.yours === 29.5", "the answer to be kept")
    teacher.lesson.get_by_text("Reveal without an answer").wait_for()
    student.tab.reload()
    student.asked("Give a number")
    assert student.lesson.get_by_label("your answer").input_value() == "29.5"
    teacher.lesson.locator(".reveal").click()
    student.lesson.get_by_text("Your answer is right.").wait_for()
    student.lesson.get_by_text("the run: 30 tracks").wait_for()
    student.lesson.get_by_text("On this machine the run came out otherwise").wait_for()


def test_a_click_points_at_the_nearest_track_and_a_drag_draws(both: tuple[Learner, Learner]):
    teacher, student = both
    teacher.lesson.get_by_role("button", name="Next").click()
    student.asked("Point")
    student.lesson.locator("svg").click()
    student.lesson.locator("svg .yours[visibility=visible]").wait_for()
    assert not student.lesson.locator("circle.right").count()
    teacher.lesson.locator(".reveal").click()
    student.lesson.locator("circle.right").first.wait_for()
    teacher.lesson.get_by_role("button", name="Next").click()
    student.asked("Draw")
    drawn(student)
    student.until("window.ispom.lesson.yours", "the answer to be kept")
    teacher.lesson.get_by_text("Reveal without an answer").wait_for()
    teacher.lesson.locator(".reveal").click()
    student.lesson.locator(".verdict").wait_for()
    assert len(student.lesson.locator("polyline.right").get_attribute("points").split()) == 24
    assert student.lesson.locator("polyline.yours").get_attribute("points") != ""


def test_the_address_names_lesson_and_step_and_ending_it_brings_the_page_back(both: tuple[Learner, Learner]):
    teacher, _ = both
    teacher.until("location.hash === '#lesson=stand-ins:4&mode=learn'", "the address")
    teacher.tab.evaluate("location.hash = '#lesson=stand-ins:2&mode=learn'")
    teacher.asked("Give a number")
    teacher.lesson.get_by_role("button", name="end the lesson").click()
    teacher.tab.locator("#lesson").wait_for(state="hidden")
    teacher.until("location.hash.startsWith('#run=double')", "the address without a lesson")
    teacher.tab.locator("#learn").get_by_text("4 of 5 steps").wait_for()


def drawn(page: Learner) -> None:
    """A level line through the whole chart."""
    box = page.lesson.locator("svg").bounding_box()
    page.tab.mouse.move(box["x"] + 5, box["y"] + box["height"] / 2)
    page.tab.mouse.down()
    page.tab.mouse.move(box["x"] + box["width"] - 2, box["y"] + box["height"] / 2)
    page.tab.mouse.up()


@pytest.fixture(scope="module")
def learner(browser, app: App) -> Iterator[Learner]:  # noqa: F811
    page = Learner(browser, app.url, viewer=FAKE)
    yield page
    assert not [fault for fault in page.faults if "403" not in fault], "pictures of runs are not shown while it is open"
    page.tab.close()


MOST_CLICKS = 5
"""Of a person, from the start page to the first answer of a lesson; and from each answer to the next one."""


@pytest.mark.parametrize("name", [pytest.param(n, marks=() if n in ALWAYS else pytest.mark.slow) for n in NAMES])
def test_a_lesson_takes_few_clicks_and_shows_no_answer_before_it_is_revealed(learner: Learner, name: str):
    lesson = next(each for each in built_in() if each.name == name)
    clicks = begin(learner, name)
    for number, step in enumerate(lesson.steps, 1):
        learner.asked(step.title)
        before = NUMBER.findall(learner.text())
        assert learner.tab.evaluate(f"(() => {{ const lesson = window.ispom.lesson; return {UNKNOWN}; }})()")
        answer(learner)
        learner.tab.locator("#lesson").get_by_role("button", name="Run and reveal").click()
        learner.revealed()
        assert clicks + 2 <= MOST_CLICKS
        said, own = NUMBER.findall(learner.lesson.locator(".after").inner_text()), NUMBER.findall(step.after)
        values = [value for value in said if value not in own and float(value) != 0]
        assert not set(values) & set(before), "the answer was there before"
        assert learner.lesson.locator(".verdict").count() == 1, "the text says something else than the run"
        on = "Finish" if number == len(lesson.steps) else "Next"
        learner.tab.locator("#lesson").get_by_role("button", name=on).click()
        clicks = 1
    learner.tab.locator("#lesson").wait_for(state="hidden")


def begin(page: Learner, name: str) -> int:
    """Begins a lesson from the start page by its controls. Returns the number of clicks."""
    page.tab.locator("#home").click()
    page.tab.locator("#start").wait_for()
    page.tab.locator("#all-lessons").click()
    page.tab.locator(f"#learn [data-learn={name}]").click()
    return 2


def answer(page: Learner) -> None:
    """Of whatever kind, by one click or one stroke."""
    question = page.tab.locator("#lesson").locator(".question")
    if question.locator(".option").count():
        question.locator(".option").first.click()
    elif question.locator("input").count():
        question.locator("input").fill("1")
    elif question.locator("image").count():
        question.locator("svg").click()
    else:
        drawn(page)
