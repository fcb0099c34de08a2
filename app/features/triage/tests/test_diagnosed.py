"""`ispom triage` with real methods and the doctor: a run that is dark, and a recording that is fine."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from ispom_app.cli.main import main

from ispom.evaluation.doctor.suspects import SUSPECTS


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("triage") / "clips"
    source = ["run", "sim:tiny?fault=darkness", "--methods", "monocular", "--max-exposures", "33"]
    assert main([*source, "--no-recording", "--out", str(out / "dark")]) == 0
    return out


@pytest.mark.slow
def test_a_dark_run_is_to_be_filmed_again(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert main(["triage", str(folder), "--out", str(out), "--workers", "0"]) == 1
    found = json.loads((out / "triage.json").read_text())
    (row,) = found["clips"]
    assert row["suspect"] == "darkness" and row["action"] == "film again" and row["run"] == str(folder / "dark")
    (lesson,) = found["how_to_film"]
    remedy = next(suspect.remedy for suspect in SUSPECTS if suspect.key == "darkness")
    assert lesson["clips"] == ["dark"] and lesson["advice"] == remedy
    assert remedy in (out / "how_to_film.md").read_text() and remedy in (out / "index.html").read_text()


def test_without_the_doctor_the_event_is_the_cause(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    main(["triage", str(folder), "--out", str(out), "--workers", "0", "--no-doctor"])
    (row,) = json.loads((out / "triage.json").read_text())["clips"]
    assert not row["suspect"] and not row["advice"]
