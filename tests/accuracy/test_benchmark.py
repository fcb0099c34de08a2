"""The benchmark: its errors on exact paths, its records that are written once, and the page that is made of them."""

from __future__ import annotations

import json
import re
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from ispom_app.engine.run_folder.statistics import RunStatistics

from ispom.simulation.cameras import simulated_rig
from ispom.types import Trajectory
from tests.accuracy import studies
from tests.accuracy.__main__ import main
from tests.accuracy.benchmark import STILL_S, row_of, rpe_delta, rpe_of
from tests.accuracy.figures import Run
from tests.accuracy.page import marks
from tests.accuracy.records import (
    FOLDER,
    PAGE,
    STUDY,
    Machine,
    Record,
    Row,
    append_record,
    markdown,
    read_records,
    record_text,
)
from tests.accuracy.test_figures import STILL

MACHINE = Machine(
    processor="P",
    cores=2,
    memory_gb=8.0,
    system="Linux",
    python="3.12.1",
    packages={"numpy": "2.0"},
    unit_ms=10.0,
    unit_pair="a made pair",
    load=None,
)
TRACKED = Row(
    recording="sim:tiny",
    method="stereo",
    frames=9,
    located=8,
    segments=1,
    ms=20.0,
    cpu_s=1.0,
    alignment="se3",
    path=5.0,
    ate=0.01,
    rpe_over="1",
    rpe=0.5,
    rpe_deg=0.1,
)
REFUSED = Row(recording="hard/pan", method="monocular", refused="No map yet: only a rotation.", frames=70, cpu_s=1.0)
FAILED = Row(recording="hard/pan", method="stereo", failed="failed, please report it: no | camera")
METRES = np.linspace(0, 100, 1001)


def record_of(name: str, *rows: Row, left_out: tuple[str, ...] = ()) -> Record:
    about: dict[str, Any] = {"version": name, "date": "2026-11-30", "commit": 40 * "a", "command": "python"}
    return Record(**about, machine=MACHINE, left_out=[*left_out], rows=[*rows])


def straight(metres: np.ndarray) -> Trajectory:
    """A path along z without rotation, 10 Hz."""
    positions = np.column_stack([np.zeros((len(metres), 2)), metres])
    return Trajectory(np.arange(len(metres)) * 100_000_000, np.tile(np.eye(3), (len(metres), 1, 1)), positions)


def run_of(estimate: Trajectory, truth: Trajectory | None, located: int, **report: Any) -> Run:
    found = {"located": located, "lost": 0, "aligned": "se3", "ate_m": 0.1, "ms_per_exposure": {"median": 12.34}}
    path = None if truth is None else truth.length
    return Run(len(METRES), 1.0, RunStatistics(), truth, simulated_rig(), estimate, path, found | report)


def test_the_relative_error_of_a_path_that_is_one_percent_too_long() -> None:
    found = rpe_of(run_of(straight(1.01 * METRES), straight(METRES), 1001))
    assert found["rpe_over"] == "20" and found["rpe"] == pytest.approx(1, rel=1e-3) and found["rpe_deg"] < 1e-3


def test_the_relative_error_under_noise_is_that_of_two_positions() -> None:
    noise = np.random.default_rng(0).normal(0, 0.01, len(METRES))
    found = rpe_of(run_of(straight(METRES + noise), straight(METRES), 1001))
    assert found["rpe"] == pytest.approx(100 * np.sqrt(2) * 0.01 / 20, rel=0.1)


@pytest.mark.parametrize(
    ("length", "expected"), [(500, 100), (499, 50), (60, 10), (1.1, 0.2), (0.5, 0.1), (0.49, STILL_S), (0, STILL_S)]
)
def test_the_motions_of_the_relative_error_fit_into_the_path(length: float, expected: float) -> None:
    delta = rpe_delta(straight(np.array([0, length])))
    assert delta.value == expected and delta.unit == ("s" if expected is STILL_S else "m")


def test_held_poses_have_no_error_and_the_row_says_why_there_is_no_map() -> None:
    row = row_of("sim:tiny", "stereo", run_of(straight(METRES), straight(METRES), 0, never_located="Why."))
    assert (row.refused, row.located, row.rpe_over, row.rpe, row.ate) == ("Why.", 0, "20", None, None)
    good = row_of("sim:tiny", "stereo", run_of(straight(METRES), None, 900, lost=3))
    assert (good.refused, good.lost, good.ms, good.path, good.rpe_over) == (None, 3, 12.3, None, None)


def test_a_record_is_read_as_it_was_written(tmp_path: Path) -> None:
    written = record_of("0.1.0", TRACKED, REFUSED, FAILED, left_out=("hard/far",))
    path = append_record(written, tmp_path)
    assert read_records(tmp_path) == [written] and path.name == "0.1.0.json"
    assert len([line for line in path.read_text().split("\n") if '"recording"' in line]) == 3


@pytest.mark.parametrize(
    "change",
    [
        lambda content: content | {"more": 1},
        lambda content: {key: value for key, value in content.items() if key != "commit"},
        lambda content: content | {"rows": [{"recording": "a", "method": "b", "ate": "0.1"}]},
        lambda content: content | {"version": "0.2.0"},
    ],
    ids=["unknown key", "missing key", "wrong type", "other version"],
)
def test_what_is_no_record_is_refused_with_its_name(change: Any, tmp_path: Path) -> None:
    content = msgspec.to_builtins(record_of("0.1.0", TRACKED))
    (tmp_path / "0.1.0.json").write_text(json.dumps(change(content)))
    with pytest.raises(ValueError, match=r"0\.1\.0\.json"):
        read_records(tmp_path)


def test_a_new_release_is_appended_and_older_records_stay_as_they_are(tmp_path: Path) -> None:
    first = append_record(record_of("0.9.0", TRACKED), tmp_path)
    before = first.read_bytes()
    append_record(record_of("0.10.0", TRACKED, REFUSED), tmp_path)
    assert first.read_bytes() == before
    assert [record.version for record in read_records(tmp_path)] == ["0.9.0", "0.10.0"]
    with pytest.raises(FileExistsError):
        append_record(record_of("0.9.0", REFUSED), tmp_path)
    assert first.read_bytes() == before
    for name in ("../0.9.0", "next", ""):
        with pytest.raises(ValueError):
            append_record(record_of(name, TRACKED), tmp_path)


def test_the_page_has_releases_one_beside_another_and_failures_in_the_tables() -> None:
    text = markdown([record_of("0.1.0", TRACKED, REFUSED, FAILED), record_of("0.2.0", TRACKED)])
    lines = text.split("\n")
    at = [i for i, line in enumerate(lines) if line.startswith("| `stereo` | ") and "8 of 9" in line]
    assert len(at) == 2 and at[1] == at[0] + 1 and "0.1.0" in lines[at[0]] and "0.2.0" in lines[at[1]]
    (refused,) = (line for line in lines if "**none** of 70" in line)
    (failed,) = (line for line in lines if "**failed**" in line)
    assert REFUSED.refused is not None and REFUSED.refused in refused
    head = next(line for line in lines if line.startswith("| method"))
    assert {len(re.findall(r"(?<!\\)\|", line)) for line in (refused, failed, head, lines[at[0]])} == {12}
    assert "no \\| camera" in failed
    assert "0.1.0, of 3 runs: 1 ended with an error, 1 localised no frame" in text


def test_the_page_is_made_of_the_stored_records() -> None:
    begin, end = marks(STUDY)
    shown = PAGE.read_text(encoding="utf-8").partition(begin)[2].partition(end)[0]
    records = read_records(PAGE.parent / FOLDER)
    hint = "run python -m tests.accuracy benchmark --table docs/evaluation/benchmark.md"
    assert shown.strip() == markdown(records).strip(), hint
    assert all(f"`{name}`" in PAGE.read_text(encoding="utf-8") for name in STILL)
    for record in records:
        assert (PAGE.parent / FOLDER / f"{record.version}.json").read_text(encoding="utf-8") == record_text(record)


def test_figures_of_other_programs_have_their_rules_and_sources_and_are_not_called_ours() -> None:
    text = PAGE.read_text(encoding="utf-8").partition("\n## Other programs, as published\n")[2]
    assert "**not measured here**" in text.partition("\n| program")[0]
    rows = [line.split(" | ") for line in text.partition(marks(STUDY)[0])[0].split("\n") if line.startswith("| ")][2:]
    assert {"ORB-SLAM3", "SVO", "COLMAP"} <= {cells[0].strip("| ").partition(",")[0] for cells in rows}
    for cells in rows:
        assert len(cells) == 5 and len(cells[3]) > 15 and "](https://" in cells[4]


@pytest.fixture
def page(tmp_path: Path) -> Path:
    """A page between whose marks something old stands."""
    begin, end = marks(STUDY)
    page = tmp_path / "benchmark.md"
    page.write_text(f"# Title\n\n{begin}\nold\n{end}\n\nend\n")
    return page


@pytest.fixture
def measured(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, str]]:
    """The tasks that were given to other processes, which answer at once: stereo with an error."""
    tasks = list[dict[str, str]]()

    def found(module: str, task: dict[str, Any]) -> Any:
        if "unit" in task:
            return {"ms": 10.0, "pair": "a made pair"}
        tasks.append(task)
        if task["method"] == "stereo":
            return {"error": "failed, please report it"}
        return msgspec.to_builtins(TRACKED) | {"method": task["method"]}

    monkeypatch.setattr(studies, "found", found)
    return tasks


def test_the_command_writes_the_record_of_this_version_once(
    page: Path, measured: list[dict[str, str]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    append_record(record_of("0.0.1", REFUSED), tmp_path / FOLDER)
    before = (tmp_path / FOLDER / "0.0.1.json").read_bytes()
    command = ["benchmark", "--data", str(tmp_path / "none"), "--only", "sim:tiny", "--table", str(page)]
    command += ["--release", version("ispom")]
    assert main(command) == 0
    assert {task["name"] for task in measured} == {"sim:tiny"} and len(measured) == 6
    old, new = read_records(tmp_path / FOLDER)
    assert (tmp_path / FOLDER / "0.0.1.json").read_bytes() == before and old.version == "0.0.1"
    assert [row.method for row in new.rows if row.failed is not None] == ["stereo"] and len(new.rows) == 6
    assert "kitti/sequences/06" in new.left_out and "sim:tiny" not in new.left_out
    text = page.read_text()
    assert markdown([old, new]) in text and "\nold\n" not in text and text.endswith("end\n")
    with pytest.raises(SystemExit):
        main(command)
    assert len(measured) == 6 and "never changed" in capsys.readouterr().err


def test_the_page_alone_is_written_without_a_measurement(
    page: Path, measured: list[dict[str, str]], tmp_path: Path
) -> None:
    append_record(record_of("0.0.1", REFUSED), tmp_path / FOLDER)
    assert main(["benchmark", "--table", str(page)]) == 0
    assert not measured and markdown(read_records(tmp_path / FOLDER)) in page.read_text()


@pytest.mark.parametrize("words", [["benchmark", "--release", "0.0.7"], ["gaps", "--release", version("ispom")]])
def test_a_release_is_this_version_and_of_the_benchmark(
    words: list[str], measured: list[dict[str, str]], page: Path
) -> None:
    with pytest.raises(SystemExit):
        main([*words, "--table", str(page)])
    assert not measured and not (page.parent / FOLDER).exists()
