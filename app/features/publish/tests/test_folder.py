"""What `ispom publish` writes, where it refuses to write, and what it keeps to itself."""

from __future__ import annotations

import shutil
from base64 import b64decode
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from ispom_app.engine.outputs import signature
from ispom_app.engine.run_folder.run_folder import MARKER, RECORDING
from ispom_app.features.publish.images import CHOICES
from ispom_app.features.publish.site import OPENED_AS_FILE, WAITING, published_page
from ispom_app.features.publish.stage import StageWriter
from ispom_app.features.runs.frame_picture import WIDTH_PX
from ispom_app.views.web.files import STATIC

from .read import content, data

Publish = Callable[..., int]


def test_each_frame_has_what_the_page_shows_of_it(site: Path) -> None:
    found = data(site, "run")
    total = found["message"]["total"]
    assert [frame["index"] for frame in found["frames"]] == list(range(total))
    assert len(found["axis"]["times_ms"]) == found["axis"]["computed"] == total
    panels = data(site, "panels-0")
    first = found["panels"]["first"]["explain"]
    assert len(panels) == total and all((first | frame["explain"])["cards"] for frame in panels)
    assert {panel["script"] for panel in found["panels"]["listed"]} <= {
        path.name for path in (site / "panels").iterdir()
    }
    assert {name for row in found["plots"]["rows"].values() for name in (c["id"] for c in row["curves"])} >= set(
        found["plots"]["values"]
    )
    assert found["stage"]["frames"][-1] == total - 1


def test_nothing_says_where_or_by_whom_it_was_computed(pair: Path, runs: tuple[Path, Path]) -> None:
    secret = [str(runs[0].parent), runs[0].parent.name, "drive of somebody", str(Path.home()), str(pair.parent)]
    for path in pair.rglob("*"):
        if path.is_file():
            text = content(path)
            assert not [each for each in secret if len(each) > 5 and each.encode() in text], path.name


def test_a_folder_that_holds_something_else_is_refused(
    runs: tuple[Path, Path], publish: Publish, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    assert publish(runs[0], "--out", tmp_path) == 2
    assert "mine.txt" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_nothing_is_written_through_a_link(
    runs: tuple[Path, Path], publish: Publish, site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own, elsewhere = tmp_path / "site", tmp_path / "elsewhere"
    shutil.copytree(site, own)
    shutil.rmtree(own / "data")
    elsewhere.mkdir()
    (own / "data").symlink_to(elsewhere)
    assert publish(runs[0], "--out", own) == 2 and "link" in capsys.readouterr().err
    assert not list(elsewhere.iterdir())
    (own / "data").unlink()
    target = tmp_path / "target.html"
    target.write_text("mine")
    (own / "index.html").unlink()
    (own / "index.html").symlink_to(target)
    assert publish(runs[0], "--out", own) == 0
    assert target.read_text() == "mine" and not (own / "index.html").is_symlink()


def test_an_earlier_output_is_replaced(runs: tuple[Path, Path], publish: Publish, pair: Path, tmp_path: Path) -> None:
    own = tmp_path / "site"
    shutil.copytree(pair, own)
    assert (own / "data" / "comparisons.bin").exists()
    assert publish(runs[1], "--out", own) == 0
    assert not (own / "data" / "comparisons.bin").exists() and data(own, "run")["runs"] == ["second"]


@pytest.mark.parametrize("missing", ["run.yaml", RECORDING])
def test_what_is_no_whole_run_is_refused(
    missing: str, runs: tuple[Path, Path], publish: Publish, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(runs[0], copy)
    (copy / missing).unlink()
    assert publish(copy, "--out", tmp_path / "site") == 2
    assert str(copy) in capsys.readouterr().err and not (tmp_path / "site").exists()


def test_an_incomplete_run_is_refused(runs: tuple[Path, Path], publish: Publish, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(runs[0], copy)
    (copy / MARKER).write_text("stopped\n")
    assert publish(copy, "--out", tmp_path / "site") == 2


@pytest.mark.parametrize(
    "said", ["Repaired: 5 of 9 frames. It was killed.", "Stopped by a signal after 5 of 9 frames."]
)
def test_a_run_that_ended_early_says_so(said: str, runs: tuple[Path, Path], publish: Publish, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(runs[0], copy)
    (copy / MARKER).write_text(f"{said}\n{signature('run')}\n")
    assert publish(copy, "--out", tmp_path / "site") == 0
    assert said in data(tmp_path / "site", "run")["message"]["notes"]


@pytest.mark.parametrize("limit", ["0.01", "-1", "nan"])
def test_a_limit_that_cannot_be_kept_is_refused(
    limit: str, runs: tuple[Path, Path], publish: Publish, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert publish(runs[0], "--out", tmp_path / "site", "--max-mb", limit) == 2
    assert "--max-mb" in capsys.readouterr().err


def test_the_folder_is_as_small_as_asked(runs: tuple[Path, Path], publish: Publish, site: Path, tmp_path: Path) -> None:
    def size(folder: Path) -> int:
        return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())

    whole = size(site)
    limit = whole - (site / "data" / "stage.bin").stat().st_size // 8
    assert publish(runs[0], "--out", tmp_path / "site", "--max-mb", str(limit / 1e6)) == 0
    assert size(tmp_path / "site") <= limit < whole


def test_runs_of_one_source_are_compared(pair: Path) -> None:
    found = data(pair, "comparisons")
    assert [each["numbers"] for each in found] == [[0, 1]] and found[0]["finished"]
    run = data(pair, "run")
    assert run["runs"] == ["first", "second"] and run["message"]["compared"][:2] == [0, 1]
    assert any("world/branches/1" in text for text in [content(pair / "data" / "stage.bin").decode("latin-1")])


def test_the_page_is_that_of_the_app_but_for_its_head() -> None:
    own = (STATIC / "index.html").read_text()
    found = published_page(own, 1)
    assert found.partition("<body>")[2] == own.partition("<body>")[2].replace(WAITING, OPENED_AS_FILE)
    assert own.count(WAITING) == 1
    assert 'data-published="data"' in found and "default-src 'self'" in found


def test_where_paths_part_both_images_are_kept(parted: Path, pair: Path) -> None:
    (found,) = data(parted, "comparisons")
    assert found["view"]["parting"]["method"] == "stereo" and len(found["pictures"]) == 2
    for address in found["pictures"]:
        kind, _, jpeg = address.partition(",")
        image = cv2.imdecode(np.frombuffer(b64decode(jpeg), np.uint8), cv2.IMREAD_COLOR)
        assert kind == "data:image/jpeg;base64" and image is not None and image.shape[1] == WIDTH_PX
    (alike,) = data(pair, "comparisons")
    assert alike["view"]["parting"] is None and alike["pictures"] is None


def test_a_stage_without_images_has_none_where_paths_part(
    parted: Path, publish: Publish, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(StageWriter, "fitting", lambda writer, most_bytes, beside: writer.stage(CHOICES[-1]))
    folders = [parted.parent / name for name in ("straight", "aside")]
    assert publish(*folders, "--out", tmp_path / "site") == 0
    assert data(tmp_path / "site", "comparisons")[0]["pictures"] is None
