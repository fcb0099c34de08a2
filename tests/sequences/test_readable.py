"""What can be opened can be run: the first images are read when a source is opened."""

from __future__ import annotations

from pathlib import Path

import pytest
from ispom_app.cli.main import main

from ispom.errors import InputError
from ispom.sequences import open_sequence
from tests.sequences.bag_folders import make_bag
from tests.sequences.folders import make_euroc, make_tum
from tests.sequences.own_folders import make_images


def test_sources_refuses_what_run_refuses(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = make_bag(tmp_path, "ros1", ("camera",), encode=lambda image: ("nv24", image))
    assert main(["sources", str(path)]) == 2
    message = capsys.readouterr().err
    assert main(["run", str(path), "--out", str(tmp_path / "run")]) == 2
    assert capsys.readouterr().err == message and "encoding nv24" in message


def test_a_first_image_that_is_damaged_ends_the_opening_where_it_ends_a_run(tmp_path: Path) -> None:
    for name, count, opens in (("short", 6, False), ("long", 120, True)):
        folder = make_images(tmp_path / name, frames=count)
        (folder / "0.png").write_bytes((folder / "0.png").read_bytes()[:200])
        if opens:
            assert len(open_sequence(str(folder))) == count
            continue
        with pytest.raises(InputError, match=r"0\.png is not"):
            open_sequence(str(folder))


def test_an_image_of_either_camera_may_be_the_first(tmp_path: Path) -> None:
    root = make_euroc(tmp_path)
    first = sorted((root / "mav0" / "cam1" / "data").iterdir())[0]
    first.write_bytes(b"\x89PNG")
    with pytest.raises(InputError, match=r"cam1/data/.*"):
        open_sequence(str(root))
    assert len(open_sequence(str(make_tum(tmp_path / "tum")))) == 6
