"""Rows of a run's folder are those of its Steps in memory, bit for bit."""

from __future__ import annotations

from pathlib import Path

import pytest
from ispom_app.engine.differences.compare import step_row
from ispom_app.engine.history.quantities import by_method
from ispom_app.engine.playback import Playback
from ispom_app.engine.run_folder.run_folder import DECISIONS, STEPS, RunFolder
from ispom_app.engine.run_folder.step_log import StepLog
from ispom_app.features.diff.command import run_rows

from ispom.errors import InputError
from tests import doubles
from tests.app.helpers import build_full

METHODS = ("monocular", "stereo", "integrated")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    playback = Playback(doubles.sequence(40), METHODS, builder=build_full)
    with StepLog(RunFolder(tmp_path)) as log:
        while not playback.done:
            log.add(playback.step())
    return tmp_path


def test_the_folder_gives_what_was_in_memory(folder: Path) -> None:
    playback = Playback(doubles.sequence(40), METHODS, builder=build_full)
    expected = []
    while not playback.done:
        event = playback.step()
        steps = by_method(event.steps).values()
        expected += [step_row(event.index, step, event.errors_m.get(step.method)) for step in steps]
    with run_rows(folder) as found:
        read = list(found)
    assert read == expected
    assert [list(row.values) for row in read] == [list(row.values) for row in expected], "in the same order"


@pytest.mark.parametrize(
    ("name", "before", "after", "said"),
    [
        (STEPS, "exposure,time_ns", "exposure,time", "line 1 does not name the columns"),
        (STEPS, ",tracking,", ",tracking,,", "has not"),
        (STEPS, "\n3,", "\n-3,", "exposure is '-3'"),
        (STEPS, "\n5,", "\nfive,", "exposure is 'five'"),
        (DECISIONS, ",14.2,", ",many,", "value is 'many'"),
        (DECISIONS, ",14.2,", ",nan,", "value is 'nan'"),
        (DECISIONS, "\n4,", "\n44,", "exposure is"),
        (DECISIONS, "\n4,", '\n4"x",', "column"),
    ],
)
def test_a_damaged_file_is_reported_with_its_place(folder: Path, name: str, before: str, after: str, said: str) -> None:
    content = (folder / name).read_text()
    assert before in content
    (folder / name).write_text(content.replace(before, after, 1))
    with pytest.raises(InputError, match=name) as caught, run_rows(folder) as found:
        list(found)
    assert said in str(caught.value) or said == "column"


@pytest.mark.parametrize("name", [STEPS, DECISIONS])
def test_a_missing_file_is_reported(folder: Path, name: str) -> None:
    (folder / name).unlink()
    with pytest.raises(InputError, match=f"has no {name}: finish it with `ispom repair`"), run_rows(folder):
        pass


def test_a_file_that_is_no_text_is_reported(folder: Path) -> None:
    with (folder / STEPS).open("ab") as file:
        file.write(b"\xff\xfe\n")
    with pytest.raises(InputError, match="not a text file"), run_rows(folder) as found:
        list(found)


@pytest.mark.parametrize("name", [STEPS, DECISIONS])
def test_either_file_may_end_first(folder: Path, name: str) -> None:
    """As they do where the disk was full."""
    lines = (folder / name).read_text().splitlines(keepends=True)
    (folder / name).write_text("".join(line for line in lines if not line.startswith(("42,", "43,"))))
    with run_rows(folder) as found:
        read = list(found)
    last = {row.exposure for row in read if "parallax" in row.values}
    assert max(last) == 41 and max(row.exposure for row in read) == (41 if name == STEPS else 43)
