"""Formats of packages: recognised after layouts that are named, before images; what fails in them is one sentence."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest

from ispom import registry
from ispom.errors import InputError
from ispom.sequences import open_sequence, recognised
from ispom.sequences.format import FORMATS, Format
from ispom.sequences.recording import Recording
from ispom.types import Camera, Sequence
from tests import doubles
from tests.sequences.kitti_folder import make_drive
from tests.sequences.own_folders import make_images

CAMERA = Camera(64, 48, 50.0, 50.0, 31.5, 23.5)


def has_mark(path: Path) -> bool:
    return (path / "mark").exists()


def as_sequence(path: Path) -> Sequence:
    return doubles.sequence(20)


def as_recording(path: Path) -> Recording:
    times_ns = np.arange(5) * 100_000_000
    return Recording("marked", CAMERA, 0.4, times_ns, lambda side, i: np.full((48, 64), 10 * i, np.uint8))


def failing(path: Path) -> Sequence:
    raise IndexError("no row")


MARKED = Format("marked", has_mark, as_sequence)
PAIRS = Format("pairs", has_mark, as_recording)
BROKEN = Format("broken", has_mark, failing)
ILL = Format("ill", failing, as_sequence)  # type: ignore[arg-type]
LOGS = Format("logs", lambda path: path.read_text() == "a log", as_sequence, frozenset({".log"}))


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Iterator[None]:
    points = [EntryPoint(name.lower(), f"{__name__}:{name}", FORMATS.group) for name in request.param]
    monkeypatch.setattr(registry, "entry_points", lambda group: points if group == FORMATS.group else [])
    FORMATS.refresh()
    yield
    FORMATS.refresh()


def marked(tmp_path: Path, make: Callable[[Path], Path]) -> Path:
    folder = make(tmp_path)
    (folder / "mark").write_text("")
    return folder


@pytest.mark.parametrize("installed", [["MARKED"]], indirect=True)
def test_a_format_comes_before_folders_of_images_and_after_named_layouts(installed: None, tmp_path: Path) -> None:
    images = marked(tmp_path / "images", make_images)
    assert recognised(images) and open_sequence(str(images)).name == "double"
    drive = marked(tmp_path / "kitti", make_drive)
    assert open_sequence(str(drive)).name != "double"
    (images / "mark").unlink()
    assert open_sequence(str(images)).name != "double"


@pytest.mark.parametrize("installed", [["PAIRS"]], indirect=True)
def test_a_recording_is_shaped_by_the_options(installed: None, tmp_path: Path) -> None:
    (tmp_path / "mark").write_text("")
    found = open_sequence(str(tmp_path), stereo_every=2)
    assert (found.kinds.count("video"), found.kinds.count("stereo")) == (5, 3)
    with pytest.raises(InputError, match="own calibration"):
        open_sequence(str(tmp_path), camera=tmp_path / "camera.yaml")


@pytest.mark.parametrize("installed", [["LOGS"]], indirect=True)
def test_files_are_recognised_by_suffix_and_content(installed: None, tmp_path: Path) -> None:
    (tmp_path / "a.log").write_text("a log")
    (tmp_path / "b.log").write_text("another")
    assert recognised(tmp_path / "a.log") and not recognised(tmp_path / "b.log")
    assert open_sequence(str(tmp_path / "a.log")).name == "double"
    with pytest.raises(InputError, match=r"b\.log is a file"):
        open_sequence(str(tmp_path / "b.log"))


@pytest.mark.parametrize(
    ("installed", "reason"), [(["BROKEN"], "broken fails with IndexError"), (["ILL"], "ill fails with IndexError")],
    indirect=["installed"],
)  # fmt: skip
def test_what_fails_in_a_package_is_one_sentence(installed: None, reason: str, tmp_path: Path) -> None:
    (tmp_path / "mark").write_text("")
    with pytest.raises(InputError, match=f"format {reason}"):
        open_sequence(str(tmp_path))
