"""`ispom experiment`: every run a folder and a row; what was done is not done again."""

from __future__ import annotations

import csv
import json
import sys
from io import StringIO
from pathlib import Path

import pyarrow.parquet
import pytest
import yaml
from ispom_app.cli.main import INTERRUPTED, main
from ispom_app.engine.run_folder.run_folder import locked
from ispom_app.features.experiments.plan import MEASURED

from tests.app import helpers
from tests.sequences.kitti_folder import make_drive


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    drive = str(make_drive(tmp_path / "kitti"))
    lines = {"B": {"method": "monocular"}, "C": {"method": "stereo", "settings": {"stereo.max_tracks": 400}}}
    statements = [{"text": "C < B", "quantity": "ate_m", "line": "C", "over_line": "B", "at_most": 1e6}]
    file = tmp_path / "own.yaml"
    fields = [{"name": "Field C", "line": "C", "ellipse": [50, 30, 20, 10, 5], "label": [50, 30]}]
    content = {"title": "Own", "sources": [drive], "lines": lines, "statements": statements, "fields": fields}
    file.write_text(yaml.safe_dump(content))
    return file


def run(plan: Path, out: Path, *options: str, builder=helpers.build) -> int:
    return main(["experiment", str(plan), "--out", str(out), "--workers", "0", *options], builder)


def rows(out: Path) -> list[dict[str, str]]:
    with (out / "results.csv").open() as file:
        return list(csv.DictReader(file))


def test_every_run_is_a_folder_and_a_row(plan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert run(plan, out) == 0
    found = rows(out)
    assert [(r["line"], r["method"], r["failure"]) for r in found] == [("B", "monocular", ""), ("C", "stereo", "")]
    for r in found:
        entry = json.loads((out / r["run"] / "metrics.json").read_text())["methods"][r["method"]]
        assert float(r["ate_m"]) == entry["ate_m"]
        assert float(r["ate_percent"]) == pytest.approx(100 * entry["ate_m"] / float(r["path_length_m"]))
        assert float(r["m_per_unit"]) > 0
    assert found[0]["images_sha256"] == found[1]["images_sha256"] != ""
    assert found[1]["stereo.max_tracks"] == "400"
    assert not (out / found[0]["run"] / "run.rrd").exists()
    table = pyarrow.parquet.read_table(out / "results.parquet").to_pylist()
    assert [r["ate_m"] for r in table] == [float(r["ate_m"]) for r in found]
    summary = json.loads((out / "summary.json").read_text())
    assert summary["statements"][0]["holds"] in (True, False) and summary["plan"]["title"] == "Own"
    page = (out / "index.html").read_text()
    assert all(f'href="{r["run"]}/"' in page for r in found) and "http" not in page.replace("http-equiv", "")
    assert '<a href="#line-C">' in page and 'id="line-C"' in page and ">Field C<" in page
    assert {f"{n}.{e}" for n in ("paths", "quantities") for e in ("png", "svg")} <= {p.name for p in out.iterdir()}
    assert "2 runs, 0 failed" in capsys.readouterr().out


def test_without_matplotlib_only_the_figures_are_missing(
    plan: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    out = tmp_path / "out"
    assert run(plan, out) == 0
    assert [r["failure"] for r in rows(out)] == ["", ""] and (out / "index.html").exists()
    assert not list(out.glob("*.svg")) and "matplotlib" in capsys.readouterr().out


def test_nothing_is_computed_twice_and_the_files_stay_the_same(plan: Path, tmp_path: Path) -> None:
    def never(*_):
        raise AssertionError("computed again")

    out = tmp_path / "out"
    assert run(plan, out) == 0
    before = {path.name: path.read_bytes() for path in out.iterdir() if path.is_file()}
    assert run(plan, out, builder=never) == 0
    assert {path.name: path.read_bytes() for path in out.iterdir() if path.is_file()} == before


def test_a_failing_run_is_a_row_that_says_why(plan: Path, tmp_path: Path) -> None:
    def build(config, methods, rig):
        if "stereo" in methods:
            raise RuntimeError("no such disparity")
        return helpers.build(config, methods, rig)

    out = tmp_path / "out"
    assert run(plan, out, builder=build) == 0
    assert [r["failure"] for r in rows(out)] == ["", "RuntimeError: no such disparity"]
    assert "no such disparity" in (out / "index.html").read_text()
    assert run(plan, out) == 0, "what failed is tried again"
    assert [r["failure"] for r in rows(out)] == ["", ""]


def test_a_source_that_is_not_there_is_a_row(plan: Path, tmp_path: Path) -> None:
    there = yaml.safe_load(plan.read_text())["sources"][0]
    assert run(plan, tmp_path / "out", "--sources", "no/such", there) == 0
    failures = [r["failure"] for r in rows(tmp_path / "out")]
    assert [bool(f) for f in failures] == [True, True, False, False] and "no/such" in failures[0]


def test_interrupted_it_can_be_resumed(plan: Path, tmp_path: Path) -> None:
    def build(config, methods, rig):
        if "stereo" in methods:
            raise KeyboardInterrupt
        return helpers.build(config, methods, rig)

    out = tmp_path / "out"
    assert run(plan, out, builder=build) == INTERRUPTED
    assert [r["line"] for r in rows(out)] == ["B"]
    assert run(plan, out) == 0 and [r["line"] for r in rows(out)] == ["B", "C"]
    whole = tmp_path / "whole"
    assert run(plan, whole) == 0
    for name in ("results.csv", "results.parquet", "summary.json", "paths.svg", "quantities.svg", "index.html"):
        assert (whole / name).read_bytes() == (out / name).read_bytes(), name


def test_a_folder_of_other_settings_is_refused(plan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert run(plan, out) == 0
    plan.write_text(plan.read_text().replace("400", "300"))
    assert run(plan, out) == 2
    assert "another config" in capsys.readouterr().err


def test_the_folder_of_something_else_is_left_alone(plan: Path, tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("precious")
    assert run(plan, tmp_path / "mine") == 2
    assert [p.name for p in (tmp_path / "mine").iterdir()] == ["thesis.txt"]


def test_what_is_missing_is_said_before_the_first_run(
    plan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    content = yaml.safe_load(plan.read_text())
    content["lines"]["F"] = {"method": "fused", "settings": {"fused.scheme": "8"}}
    content["statements"] = [{"text": "t", "quantity": "ate_m", "line": "F", "at_most": 1}]
    plan.write_text(yaml.safe_dump(content))
    monkeypatch.setattr("ispom.estimators.survey.fused.find_spec", lambda name: None)
    said = list[str]()

    def build(config, methods, rig):
        said.append(capsys.readouterr().err)
        return helpers.build(config, methods, rig)

    assert run(plan, tmp_path / "out", "--sources", content["sources"][0], "no/such", builder=build) == 0
    assert "F: fused needs gtsam" in said[0] and "no/such" in said[0]
    verdicts = json.loads((tmp_path / "out" / "summary.json").read_text())["statements"]
    assert [v["verdict"] for v in verdicts] == ["could not be tested"]


def test_coverage_stands_beside_the_errors(plan: Path, tmp_path: Path) -> None:
    plan.write_text(plan.read_text() + "quantities: [ate_m]\n")
    assert run(plan, tmp_path / "out") == 0
    page = (tmp_path / "out" / "index.html").read_text()
    assert "<th>frames located [%]</th>" in page


def test_a_folder_has_one_experiment_at_a_time(plan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, codes = tmp_path / "out", list[int]()

    def build(config, methods, rig):
        codes.append(run(plan, out))
        return helpers.build(config, methods, rig)

    assert run(plan, out, builder=build) == 0
    err = capsys.readouterr().err
    assert codes == [2, 2] and str(out) in err and "by another" in err
    assert [r["failure"] for r in rows(out)] == ["", ""]


def test_a_part_that_is_computed_is_waited_for(plan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert run(plan, out, "--shard", "1/2") == 0
    with locked(out / "shards" / "1-of-2.json"):
        assert run(plan, out, "--shard", "1/2") == 2 and run(plan, out) == 2
        assert "shard 1-of-2" in capsys.readouterr().err
    assert run(plan, out) == 0


def test_what_was_measured_stands_beside_the_errors_of_a_plan_that_asks_for_it(plan: Path, tmp_path: Path) -> None:
    assert run(plan, tmp_path / "without") == 0
    assert not set(MEASURED) & rows(tmp_path / "without")[0].keys()
    times = list(csv.DictReader(StringIO((tmp_path / "without" / "times.csv").read_text())))
    assert all(float(row["cpu_ms"]) >= 0 and float(row["peak_memory_mb"]) > 20 for row in times)
    plan.write_text(plan.read_text() + "quantities: [cpu_ms, cpu_ms_p95, peak_memory_mb, ate_m]\n")
    assert run(plan, tmp_path / "with") == 0
    assert all(float(row["cpu_ms_p95"]) >= float(row["cpu_ms"]) >= 0 for row in rows(tmp_path / "with"))
    spreads = json.loads((tmp_path / "with" / "summary.json").read_text())["spreads"]
    assert {s["quantity"] for s in spreads if s["median"] is not None} >= {"cpu_ms", "peak_memory_mb", "ate_m"}
