"""The example of a method in a package of its own: checked, run, forked and reported like any other."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
import yaml

from tests.examples.conftest import FRAMES
from tests.examples.packages import EXAMPLES, install, python

EXAMPLE = EXAMPLES / "own_estimator"
FORKED_AT = 12


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return install(tmp_path_factory.mktemp("installed"), "own_estimator")


def test_it_is_short() -> None:
    lines = (EXAMPLE / "own_estimator.py").read_text().splitlines()
    assert sum(bool(line.strip()) for line in lines) <= 60


def test_it_keeps_the_contract(installed: Path) -> None:
    found = python(installed, "-c", "from ispom.testing import check_estimator; check_estimator('frames')")
    assert found.returncode == 0, found.stderr


def test_it_has_flags(installed: Path) -> None:
    found = python(installed, "-m", "ispom_app", "run", "--help", "--methods", "frames")
    assert "--frames.min-inliers" in found.stdout and "Fewer tracks that agree" in found.stdout
    refused = python(installed, "-m", "ispom_app", "run", "sim:tiny", "--methods", "frames", "--frames.max-tracks", "7")
    assert refused.returncode == 2 and "--frames.max-tracks is 7" in refused.stderr


def test_it_has_a_colour_of_its_own(installed: Path) -> None:
    code = (
        "from ispom_app.presentation import colours as c; assert c.of('frames') == c.OTHERS[0] not in c.METHOD.values()"
    )
    found = python(installed, "-c", code)
    assert found.returncode == 0, found.stderr


def test_it_is_run_forked_and_reported(installed: Path, recording: Path, tmp_path: Path) -> None:
    run, fork, report = tmp_path / "run", tmp_path / "fork", tmp_path / "report.html"
    words = ("-m", "ispom_app", "run", recording, "--methods", "frames", "monocular.paper", "--no-recording")
    found = python(installed, *words, "--frames.min-inliers", "15", "--out", run)
    assert found.returncode == 0, found.stderr
    assert yaml.safe_load((run / "run.yaml").read_text())["config"]["frames"]["min_inliers"] == 15
    assert len((run / "frames.tum").read_text().splitlines()) >= FRAMES - 2
    with (run / "decisions.csv").open() as file:
        assert {row["key"] for row in csv.DictReader(file) if row["method"] == "frames"} == {"inliers"}
    found = python(installed, "-m", "ispom_app", "fork", run, "--at", str(FORKED_AT), "--out", fork)
    assert found.returncode == 0, found.stderr
    assert (fork / "frames.tum").read_bytes() == (run / "frames.tum").read_bytes()
    found = python(installed, "-m", "ispom_app", "report", run, "--out", report)
    assert found.returncode == 0, found.stderr
    assert "frames" in report.read_text() and "#965ad2" in report.read_text(), "neither its name nor its colour"


def test_it_stops_on_its_check_and_is_distinguished(installed: Path, recording: Path, tmp_path: Path) -> None:
    run, stopped, other = tmp_path / "run", tmp_path / "stopped", tmp_path / "other"
    words = ("-m", "ispom_app", "run", recording, "--methods", "frames", "--no-recording", "--out")
    assert python(installed, *words, run).returncode == 0
    with (run / "decisions.csv").open() as file:
        made = {int(row["exposure"]): float(row["value"]) for row in csv.DictReader(file)}
    until = f"exposure >= {FORKED_AT} and frames.inliers <= {made[FORKED_AT]} and frames.inliers.passed"
    found = python(installed, *words, stopped, "--until", until)
    assert found.returncode == 0, found.stderr
    assert yaml.safe_load((stopped / "run.yaml").read_text())["stopped"]["exposure"] == FORKED_AT
    assert python(installed, *words, other, "--frames.max-tracks", "150").returncode == 0
    alike = python(installed, "-m", "ispom_app", "diff", run, run)
    assert alike.returncode == 0 and "alike: frames" in alike.stdout, alike.stderr
    comparison = python(installed, "-m", "ispom_app", "diff", run, other)
    assert comparison.returncode == 1 and "frames.max_tracks: 400 | 150" in comparison.stdout, comparison.stderr
