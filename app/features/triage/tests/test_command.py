"""`ispom triage` on stand-ins for methods: rows, resuming, shards, page and exit codes."""

from __future__ import annotations

import csv
import json
import multiprocessing
import os
import signal
from pathlib import Path

import pytest
from ispom_app.cli.main import main

from tests.app import helpers
from tests.app.written import breaks_schema
from tests.sequences.kitti_folder import make_drive

NAMES = ("a & b", "Übung <i>", "c")
FILES = ("triage.json", "triage.csv", "how_to_film.md")


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without compiled code: the methods are stand-ins."""
    monkeypatch.setattr("ispom_app.features.triage.command.compile_first", lambda *_: None)
    monkeypatch.setattr("ispom_app.features.headless.command.warmup.start", lambda *_: None)


@pytest.fixture
def clips(tmp_path: Path) -> Path:
    for name in NAMES:
        make_drive(tmp_path / "clips" / name, right=False)
    return tmp_path / "clips"


def triage(folder: Path, out: Path, *options: str, builder=helpers.build) -> int:
    return main(
        ["triage", str(folder), "--out", str(out), "--workers", "0", "--methods", "monocular", *options], builder
    )


def never(*_: object):
    raise AssertionError("computed")


def rows(out: Path) -> dict[str, dict]:
    text = (out / "triage.json").read_text()
    assert not breaks_schema("triage", text)
    return {row["clip"]: row for row in json.loads(text)["clips"]}


def files(out: Path) -> dict[str, bytes]:
    return {name: (out / name).read_bytes() for name in FILES}


def test_where_all_clips_are_fine_the_exit_code_is_0(clips: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert triage(clips, out) == 0
    assert {row["group"] for row in rows(out).values()} == {"fine"}
    assert all(row["frame"] is not None and row["located_percent"]["monocular"] == 100 for row in rows(out).values())
    assert all((out / row["run"] / "monocular.tum").exists() for row in rows(out).values())


def test_what_cannot_be_opened_is_a_row_with_its_sentence(clips: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    (clips / "bad.mp4").write_text("no film")
    (clips / "away").symlink_to(make_drive(tmp_path / "outside"))
    assert triage(clips, out) == 1
    bad = rows(out)["bad.mp4"]
    assert bad["group"] == "cannot be opened" and bad["cause"].startswith("bad.mp4 is") and not bad["run"]
    assert rows(out)["away"]["group"] == "cannot be opened"
    with (out / "triage.csv").open(newline="") as file:
        assert {row["clip"]: row["group"] for row in csv.DictReader(file)}["bad.mp4"] == "cannot be opened"


def test_images_that_are_links_out_of_the_folder_are_not_read(clips: Path, tmp_path: Path) -> None:
    image = clips / "c" / "sequences" / "07" / "image_0" / "000003.png"
    image.rename(tmp_path / "private.png")
    image.symlink_to(tmp_path / "private.png")
    assert triage(clips, tmp_path / "out") == 1
    assert rows(tmp_path / "out")["c/sequences/07"]["group"] != "fine"


def test_names_are_escaped_on_the_page_which_loads_nothing(clips: Path, tmp_path: Path) -> None:
    triage(clips, tmp_path / "out")
    page = (tmp_path / "out" / "index.html").read_text()
    assert "Übung &lt;i&gt;/sequences/07" in page and "<i>" not in page and "a &amp; b/" in page
    assert "data:image/jpeg;base64," in page and "http" not in page.replace("http-equiv", "") and "<script" not in page
    assert "--at 3" in page


def test_the_same_command_goes_on_and_a_changed_clip_is_run_again(clips: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    triage(clips, out)
    before = files(out)
    assert triage(clips, out, builder=never) == 0 and files(out) == before
    with (clips / "c" / "sequences" / "07" / "times.txt").open("a") as file:
        file.write("\n")
    assert triage(clips, out, builder=never) == 1
    assert [name for name, row in rows(out).items() if row["group"] != "fine"] == ["c/sequences/07"]
    assert triage(clips, out) == 0 and files(out) == before


def test_another_order_needs_another_folder(clips: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert triage(clips, tmp_path / "out") == 0
    assert triage(clips, tmp_path / "out", "--max-exposures", "3") == 2
    assert "max-exposures" in capsys.readouterr().err


def test_mistakes_are_one_sentence(clips: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for folder, options in ((tmp_path / "none", ()), (clips, ("--shard", "4/3")), (clips, ("--max-exposures", "0"))):
        assert triage(folder, tmp_path / "out", *options) == 2
        assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_two_shards_equal_one(clips: Path, tmp_path: Path) -> None:
    (clips / "bad.mp4").write_text("no film")
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    assert triage(clips, whole) == 1
    for number in (2, 1):
        triage(clips, parts, "--shard", f"{number}/2")
        assert not (parts / "triage.json").exists()
    assert triage(clips, parts, builder=never) == 1
    assert files(parts) == files(whole)


def killed_at_second(*arguments: object):
    """Kills its process when the methods of a second clip are made."""
    killed_at_second.calls += 1  # type: ignore[attr-defined]
    if killed_at_second.calls == 2:  # type: ignore[attr-defined]
        os.kill(os.getpid(), signal.SIGKILL)
    return helpers.build(*arguments)  # type: ignore[arg-type]


killed_at_second.calls = 0  # type: ignore[attr-defined]


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="Windows has no SIGKILL")
def test_after_a_kill_finished_clips_are_kept(clips: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    process = multiprocessing.get_context("fork").Process(
        target=triage, args=(clips, out), kwargs={"builder": killed_at_second}
    )
    process.start()
    process.join()
    assert process.exitcode == -signal.SIGKILL
    (kept,) = (out / "rows").glob("*.json")
    before, built = kept.stat().st_mtime_ns, []

    def counting(*arguments):
        built.append(arguments)
        return helpers.build(*arguments)

    assert triage(clips, out, builder=counting) == 0
    assert len(built) == len(NAMES) - 1 and kept.stat().st_mtime_ns == before
    assert triage(clips, tmp_path / "whole") == 0 and files(out) == files(tmp_path / "whole")
