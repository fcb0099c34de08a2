"""`ispom gate` from plan to exit code, on stand-ins and on a run that is really worse."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from ispom_app.cli.main import main

from tests.app import helpers
from tests.sequences.kitti_folder import make_drive

SEVEN = 7
"""Runs that one line needs at the level of 1 %."""


@pytest.fixture(scope="module", autouse=True)
def without_figures() -> Iterator[None]:
    """Experiments draw no figures without Matplotlib, which take most of the time here."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setitem(sys.modules, "matplotlib", None)
        yield


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Seven short recordings: seeds count for simulations only."""
    folder = tmp_path_factory.mktemp("plan")
    first = make_drive(folder / "0")
    drives = [first.rename(first.with_name("10"))]
    drives += [Path(shutil.copytree(drives[0], drives[0].with_name(f"1{n}"))) for n in range(1, SEVEN)]
    for drive in drives:
        shutil.copy(folder / "0" / "poses" / "07.txt", folder / "0" / "poses" / f"{drive.name}.txt")
    file = folder / "own.yaml"
    lines = {"pair": {"method": "stereo"}}
    file.write_text(
        yaml.safe_dump({"title": "<Own>", "sources": list(map(str, drives)), "lines": lines, "quantities": ["ate_m"]})
    )
    return file


def ispom(command: str, plan: Path, out: Path, *options: object) -> int:
    return main([command, str(plan), "--out", str(out), "--workers", "0", *map(str, options)], helpers.build)


@pytest.fixture(scope="module")
def before(plan: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("before") / "out"
    assert ispom("experiment", plan, out) == 0
    return out


@pytest.fixture
def after(before: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(before, tmp_path / "after"))


def scaled(folder: Path, factor: float) -> None:
    """Multiplies the error of every run."""
    for file in folder.glob("runs/*/*/metrics.json"):
        report = json.loads(file.read_text())
        report["methods"]["stereo"]["ate_m"] *= factor
        file.write_text(json.dumps(report))


def test_code_that_did_not_change_passes(before: Path, plan: Path, tmp_path: Path, capsys) -> None:
    out = tmp_path / "gate"
    assert ispom("gate", plan, out, "--baseline", before) == 0
    report = json.loads((out / "gate.json").read_text())
    assert report["verdict"] == "same" and report["worst"] is None
    assert report["lines"][0]["tested"][0]["change"]["same"] == SEVEN
    assert [pair["errors"][0][3] for pair in report["pairs"]] == [0.0] * SEVEN
    page = (out / "gate.html").read_text()
    assert "&lt;Own&gt;" in page and "<Own>" not in page and page.count("<circle") == SEVEN
    assert ispom("gate", plan, out, "--baseline", before) == 2, "its runs may be of other code"
    assert "--out" in capsys.readouterr().err
    assert ispom("gate", plan, tmp_path / "again", "--baseline", out / "after", "--candidate", before) == 0


@pytest.mark.parametrize(("factor", "code", "verdict"), [(1.03, 1, "worse"), (0.97, 0, "better"), (1.005, 0, "same")])
def test_a_change_decides_the_exit_code(
    before: Path, after: Path, plan: Path, tmp_path: Path, factor: float, code: int, verdict: str
) -> None:
    scaled(after, factor)
    assert ispom("gate", plan, tmp_path / "gate", "--baseline", before, "--candidate", after) == code
    assert json.loads((tmp_path / "gate" / "gate.json").read_text())["verdict"] == verdict


def test_the_first_divergence_of_the_worst_case_is_named(
    before: Path, after: Path, plan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scaled(after, 1.04)
    steps = sorted(after.glob("runs/*/*/steps.csv"))[3]
    rows = steps.read_text().splitlines()
    place = rows[0].split(",").index("inliers")
    cells = rows[3].split(",")
    cells[place] = "12345"
    steps.write_text("\n".join([*rows[:3], ",".join(cells), *rows[4:]]) + "\n")
    metrics = steps.with_name("metrics.json")
    report = json.loads(metrics.read_text())
    report["methods"]["stereo"]["ate_m"] *= 2
    metrics.write_text(json.dumps(report))
    assert ispom("gate", plan, tmp_path / "gate", "--baseline", before, "--candidate", after) == 1
    worst = json.loads((tmp_path / "gate" / "gate.json").read_text())["worst"]
    assert worst["run"] == steps.parent.relative_to(after).as_posix() and worst["frames"] == 1
    difference = worst["first"][0]["differences"][0]
    assert (difference["name"], difference["b"]) == ("stereo.inliers", 12345)
    assert "stereo.inliers" in capsys.readouterr().out
    assert "stereo.inliers" in (tmp_path / "gate" / "gate.html").read_text()


def test_a_baseline_that_lacks_a_run_is_a_mistake(
    before: Path, after: Path, plan: Path, tmp_path: Path, capsys
) -> None:
    shutil.rmtree(next(after.glob("runs/*/*")))
    for folder in (after, tmp_path / "nothing", plan):
        assert ispom("gate", plan, tmp_path / "gate", "--baseline", folder, "--candidate", before) == 2
        assert "--baseline" in capsys.readouterr().err
    assert not (tmp_path / "gate").exists()


def test_damaged_metrics_are_a_mistake(before: Path, after: Path, plan: Path, tmp_path: Path, capsys) -> None:
    next(after.glob("runs/*/*/metrics.json")).write_text('{"methods": []}')
    assert ispom("gate", plan, tmp_path / "gate", "--baseline", after, "--candidate", before) == 2
    assert "damaged" in capsys.readouterr().err


def test_the_power_is_stated_before_the_runs_and_after_them(before: Path, plan: Path, tmp_path: Path, capsys) -> None:
    out = tmp_path / "gate"
    assert ispom("gate", plan, out, "--baseline", before) == 0
    printed = capsys.readouterr().out.splitlines()
    power = json.loads((out / "gate.json").read_text())["power"]
    assert [each["source"] for each in power] == ["assumed", "pairs"], "one seed of each recording has no scatter"
    assert power[1]["spread"] == 0.0 and power[1]["smallest"] < 0.011 < power[0]["smallest"]
    stated = [line for line in printed if line.startswith(f"pair: {SEVEN} runs find")]
    assert len(stated) == 2 and printed.index(stated[0]) == 0, "at once, and after the first pairs"


def test_runs_that_scatter_end_with_a_code_of_their_own_and_the_number_that_decides(
    before: Path, after: Path, plan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ratios = (13.7, 9.7, 6.6, 15.1, 0.55, 1.7, 0.38)
    for file, ratio in zip(sorted(after.glob("runs/*/*/metrics.json")), ratios, strict=True):
        report = json.loads(file.read_text())
        report["methods"]["stereo"]["ate_m"] *= ratio
        file.write_text(json.dumps(report))
    out = tmp_path / "gate"
    assert ispom("gate", plan, out, "--baseline", before, "--candidate", after) == 3
    report = json.loads((out / "gate.json").read_text())
    line = report["lines"][0]
    assert report["verdict"] == line["verdict"] == "cannot tell"
    assert SEVEN < line["pairs_that_decide"] < 40 and line["seeds_that_decide"] is None, "recordings have no seeds"
    assert f"about {line['pairs_that_decide']} runs" in capsys.readouterr().out
    assert f"about {line['pairs_that_decide']} runs" in (out / "gate.html").read_text()
