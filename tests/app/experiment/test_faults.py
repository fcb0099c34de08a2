"""`ispom experiment faults`: a row for each fault, stretch and seed, and a table that is written by the command."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from ispom_app.cli.main import main
from ispom_app.features.experiments import faults as study
from ispom_app.features.experiments.fault_table import BEGIN, END, markdown

from tests.app import helpers
from tests.sequences.kitti_folder import make_drive


@pytest.fixture
def drive(tmp_path: Path) -> str:
    return str(make_drive(tmp_path / "kitti", frames=12))


def run(*options: str, builder=helpers.build) -> int:
    return main(["experiment", "faults", *options], builder)


def rows(out: Path) -> list[dict]:
    return [json.loads(line) for line in (out / "rows.jsonl").read_text().splitlines()]


def test_each_fault_is_a_row_with_methods_and_doctor(
    drive: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    given = ("--fault", "healthy", "--fault", "exchanged", "--fault", "focal:focal_percent=5", "--fault", "traffic")
    assert run(drive, *given, "--methods", "stereo", "--out", str(out)) == 0
    found = rows(out)
    assert [row["kind"] for row in found] == ["healthy", "exchanged", "focal:focal_percent=5"]
    assert "traffic" in capsys.readouterr().err
    assert all(row["failure"] is None and set(row["methods"]) == {"stereo"} for row in found)
    assert all(row["methods"]["stereo"]["frames"] == 11 for row in found)
    assert (out / "faults.md").read_text() == markdown(found, study.rules_hash())


def test_nothing_is_computed_twice_and_other_commands_add(
    drive: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = str(tmp_path / "out")
    assert run(drive, "--fault", "blur", "--doctor-only", "--stretches", "0-11", "--out", out) == 0
    before = rows(tmp_path / "out")
    computed, whole = list[str](), study.row_of
    monkeypatch.setattr(study, "row_of", lambda case, *rest: computed.append(case.name) or whole(case, *rest))
    again = (drive, "--fault", "blur", "--fault", "noise", "--doctor-only", "--stretches", "0-11,12-23", "--out", out)
    assert run(*again) == 0
    assert computed == ["noise", "blur", "noise"], "all faults of a stretch before the next one"
    assert rows(tmp_path / "out")[0] == before[0] and len(rows(tmp_path / "out")) == 4


def test_rows_of_other_rules_do_not_count(
    drive: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    given = (drive, "--fault", "healthy", "--doctor-only", "--out", str(tmp_path / "out"))
    assert run(*given) == 0
    monkeypatch.setattr(study, "rules_hash", lambda: "0" * 12)
    assert run(*given) == 2 and "other rules" in capsys.readouterr().err


def test_what_is_right_is_said_by_the_kinds_of_today(drive: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert run(drive, "--fault", "blur", "--doctor-only", "--out", str(out)) == 0
    (row,) = rows(out)
    (out / "rows.jsonl").write_text(json.dumps(row | {"right": ["softness"]}) + "\n")
    assert [each["right"] for each in study.read_rows(out / "rows.jsonl")] == [["blur"]]


def test_the_table_goes_between_its_marks(drive: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page, given = tmp_path / "page.md", (drive, "--fault", "healthy", "--doctor-only", "--out", str(tmp_path / "out"))
    page.write_text(f"Words.\n\n{BEGIN}\nold\n{END}\n\nMore words.\n")
    assert run(*given, "--table", str(page)) == 0
    text = page.read_text()
    assert text.startswith("Words.\n") and text.endswith("\nMore words.\n") and "old" not in text
    assert (tmp_path / "out" / "faults.md").read_text() in text
    page.write_text("no marks")
    assert run(*given, "--table", str(page)) == 2 and page.read_text() == "no marks"
    assert BEGIN in capsys.readouterr().err


@pytest.mark.parametrize(
    "given",
    [
        (),
        ("DRIVE", "--fault", "nothing"),
        ("DRIVE", "--stretches", "40-60"),
        ("DRIVE", "--stretches", "9-3"),
        ("DRIVE", "--stretches", "all"),
        ("DRIVE", "--shard", "1/2"),
        ("no/such",),
    ],
)
def test_a_mistake_is_one_sentence(
    drive: str, tmp_path: Path, given: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    words = [drive if word == "DRIVE" else word for word in given]
    assert run(*words, "--doctor-only", "--out", str(tmp_path / "out")) == 2
    error = capsys.readouterr().err
    assert error.startswith("ispom: ") and error.count("\n") == 1


def made(kind: str, right: list[str], causes: list[str], simulated: bool = True, **more) -> dict:
    given = {
        "source": "sim:tiny" if simulated else "../data/drive", "seed": 0, "stretch": "1/1", "first": 0, "last": 44,
        "kind": kind, "right": right, "simulated": simulated, "rules": "r", "failure": None, "causes": causes,
        "silent": ["clock"], "figures": {}, "methods": None,
    }  # fmt: skip
    return given | more


def test_the_table_counts_alarms_places_and_figures() -> None:
    focal = {"said": -2.9, "right": -3.0, "sigma": 0.1}
    found = [
        made("healthy", [], []),
        made("healthy", [], ["blur"], simulated=False),
        made("healthy", [], ["blur"], simulated=False, stretch="0-44"),
        made("focal", ["video-focal"], ["video-focal", "blur"], figures={"video_focal_percent": focal}),
        made(
            "focal", ["video-focal"], ["blur", "clock", "video-focal"], seed=1, figures={"a": focal | {"sigma": 0.01}}
        ),
        made("focal", ["video-focal"], ["a", "b", "c", "video-focal"], seed=2, figures={"a": focal | {"sigma": None}}),
        made("jpeg", [], []),
        made("jpeg", [], ["blur"], seed=1),
        made("clock", ["clock"], []),
        made("blur", ["blur"], [], simulated=False),
        made("unlevel+blur", ["blur"], ["blur"], simulated=False, source="../data/hard/rover"),
    ]
    text = markdown(found, "r")
    assert "Of 2 stretches" in text
    simulated, real = text.partition("## Faults on recordings")[::2]
    assert "| focal | video-focal | 3 | 1 | 2 | 0 | 1 of 2 | video-focal 1, blur 1, a 1 |" in simulated
    assert "| clock | clock | 1 | 0 | 0 | 1 |  | no cause 1 |" in simulated
    assert "| jpeg | none is known | 2 | 1 named nothing |  |  |  | no cause 1, blur 1 |" in simulated
    assert "| all 2 kinds |  | 4 | 25 % | 50 % | 1 | 1 of 2 |  |" in simulated
    assert "| blur | blur | 2 | 1 | 1 | 0 |  | no cause 1, blur 1 |" in real
    assert "On `drive`, `hard/rover` (after `unlevel`)." in real


def test_options_of_faults_are_not_those_of_a_plan(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["experiment", "fig8", "--out", str(tmp_path / "out"), "--doctor-only"]) == 2
    assert "--doctor-only" in capsys.readouterr().err
