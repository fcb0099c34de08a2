"""Parts of an experiment: together they give the files of the whole one."""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path

import pytest
import yaml
from ispom_app.cli.main import main
from ispom_app.features.experiments.results import TIMES
from ispom_app.features.experiments.shards import Shard, retried, shard_of

from ispom.errors import InputError
from tests.app import helpers
from tests.sequences.kitti_folder import make_drive


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without figures and compiled code, which take most of the time: the methods are stand-ins."""
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    monkeypatch.setattr("ispom_app.features.experiments.command.warmup.start", lambda *_: None)
    monkeypatch.setattr("ispom_app.features.experiments.command.wait_for_compiler", lambda: None)


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    drives = [str(make_drive(tmp_path / name).rename(tmp_path / name / "sequences" / name)) for name in ("a", "b")]
    lines = {"B": {"method": "monocular"}, "C": {"method": "stereo"}}
    file = tmp_path / "own.yaml"
    file.write_text(yaml.safe_dump({"title": "Own", "sources": drives, "lines": lines}))
    return file


def run(plan: Path, out: Path, *options: str, builder=helpers.build) -> int:
    return main(["experiment", str(plan), "--out", str(out), *options], builder)


def never(*_: object):
    raise AssertionError("computed")


def failures(out: Path) -> list[str]:
    with (out / "results.csv").open() as file:
        return [row["failure"] for row in csv.DictReader(file)]


def files(out: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() for p in out.iterdir() if p.is_file() and p.name != TIMES}


def test_every_run_is_in_one_part() -> None:
    for count in (1, 3, 7, 40):
        parts = [Shard(number, count).of(list(range(17))) for number in range(1, count + 1)]  # type: ignore[arg-type]
        assert sorted(run for part in parts for run in part) == list(range(17))
        assert max(map(len, parts)) - min(map(len, parts)) <= 1


def test_parts_are_merged_to_the_files_of_the_whole(
    plan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    assert run(plan, whole, "--workers", "0") == 0
    for number in (2, 3, 1):
        assert run(plan, parts, "--shard", f"{number}/3") == 0
        assert not (parts / "results.csv").exists()
    assert "shard 1 of 3: 2 runs, 0 failed" in capsys.readouterr().out
    assert run(plan, parts, "--merge", builder=never) == 0
    assert files(parts) == files(whole)


def test_what_a_part_did_not_compute_is_a_failed_row_or_is_computed(plan: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert run(plan, out, "--shard", "1/2") == 0
    assert run(plan, out, "--merge", builder=never) == 0
    assert [bool(failure) for failure in failures(out)] == [False, True, False, True]
    assert failures(out)[1].startswith("not computed")
    assert run(plan, out, "--workers", "0") == 0 and failures(out) == [""] * 4


def test_why_a_run_failed_is_merged_too(plan: Path, tmp_path: Path) -> None:
    def build(config, methods, rig):
        raise RuntimeError("no such disparity")

    out = tmp_path / "out"
    assert run(plan, out, "--shard", "2/2", builder=build) == 0
    assert len(json.loads((out / "shards" / "2-of-2.json").read_text())["failures"]) == 2
    assert run(plan, out, "--merge") == 0
    assert failures(out)[1] == "RuntimeError: no such disparity" and failures(out)[0].startswith("not computed")
    assert run(plan, out, "--shard", "2/2") == 0 and run(plan, out, "--merge") == 0
    assert failures(out)[1] == ""


@pytest.mark.parametrize("text", ["0/3", "4/3", "3", "1/0", "a/b", "-1/3", "1/3/5", ""])
def test_no_part(text: str) -> None:
    with pytest.raises(InputError, match=r"--shard is .*: give K/N"):
        shard_of(text)


def test_a_part_is_not_merged(plan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(plan, tmp_path / "out", "--shard", "1/2", "--merge") == 2
    assert "one of them" in capsys.readouterr().err


def test_a_damaged_file_of_a_part_is_named(plan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert run(plan, out, "--shard", "1/2") == 0
    (out / "shards" / "1-of-2.json").write_text("{")
    assert run(plan, out, "--merge") == 2
    assert "1-of-2.json" in capsys.readouterr().err


def test_a_part_that_meets_a_half_made_folder_tries_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ispom_app.features.experiments.shards.PAUSE_S", 0.0)
    calls = []

    def make() -> None:
        calls.append(1)
        if len(calls) < 3:
            raise InputError("is not empty")

    retried(make)
    assert len(calls) == 3
    with pytest.raises(InputError, match="never"):
        retried(lambda: (_ for _ in ()).throw(InputError("never")))
