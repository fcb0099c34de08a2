"""Filming with a camera, here a double of one: what is kept, and what it says is missing."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from ispom_app.cli.main import main
from ispom_app.features.calibration import command

from ispom.calibration.detection.detect import detect
from ispom.calibration.filmed.live import covered, filmed, is_camera, words
from ispom.calibration.filmed.simulated import simulated
from ispom.calibration.targets.layouts import parse_target
from ispom.errors import InputError
from ispom.types import Image

SPEC = "chessboard:7x5:0.03"
TARGET = parse_target(SPEC)


def frames(settings: str, repeat: int = 1) -> list[Image]:
    """Of somebody who holds the board still for `repeat` frames each time."""
    source = simulated("video", Path(f"sim:calibration?{settings}"), TARGET).sources[0]
    return [source.read(i) for i in range(len(source)) for _ in range(repeat)]


def reader(images: list[Image | None]) -> Callable[[], Image | None]:
    left = iter([*images, None])
    return lambda: next(left)


def test_views_of_a_still_board_are_stored_once() -> None:
    messages: list[str] = []
    source = filmed(TARGET, "camera:0", reader([*frames("views=4&seed=2", repeat=3)]), messages.append, 100)
    shown = [image for image in frames("views=4&seed=2") if not detect(TARGET, image).reason]
    assert len(source) == len(shown) >= 3 and source.camera == "video"
    assert sum(text.startswith("seen already") for text in messages) == 2 * len(shown)
    assert source.read(0).shape == (480, 640)


def test_what_is_missing_is_reported_while_filming_and_an_empty_image_gives_its_reason() -> None:
    messages: list[str] = []
    wall = np.full((480, 640), 90, np.uint8)
    filmed(
        TARGET,
        "camera:0",
        reader([wall, *frames("views=6&alike&seed=1"), *frames("views=5&seed=3")]),
        messages.append,
        100,
    )
    assert messages[0] == f"show the target {SPEC} to the camera"
    assert messages[1].endswith(messages[0]) and messages[1] != messages[0], "why the wall is no view"
    assert "views kept" in messages[-1] and "next: " in messages[-1]


def test_similar_views_lack_tilt_and_corners() -> None:
    seen = [detect(TARGET, image) for image in frames("views=4&alike&seed=5")]
    now = covered(TARGET, seen, (640, 480))
    assert now is not None and now.covered < 0.6
    assert any("tilt the board" in text for text in now.advice)
    assert "tilt the board" in words(4, now)
    assert covered(TARGET, seen[:2], (640, 480)) is None


def test_ctrl_c_ends_filming_with_what_was_kept() -> None:
    images = [image for image in frames("views=4&seed=2") if not detect(TARGET, image).reason]
    count = len(images)

    def read() -> Image | None:
        if not images:
            raise KeyboardInterrupt
        return images.pop()

    assert len(filmed(TARGET, "camera:0", read, lambda _: None, 100)) == count


def test_a_target_that_is_never_seen_is_reported() -> None:
    with pytest.raises(InputError, match="never seen"):
        filmed(TARGET, "camera:0", reader([np.zeros((480, 640), np.uint8)]), lambda _: None, 100)


def test_the_command_films_and_solves(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    @contextmanager
    def double(name: str):
        assert name == "camera:0"
        yield reader([*frames("views=12&seed=6", repeat=2)])

    monkeypatch.setattr(command, "camera_frames", double)
    code = main(["calibrate", "video", "camera:0", "--target", SPEC, "--model", "radtan"])
    assert code == 0
    assert "11 of 11 images used" in capsys.readouterr().out


def test_a_pair_is_not_filmed_with_one_camera(capsys: pytest.CaptureFixture[str]) -> None:
    assert is_camera((Path("camera:0"),)) and not is_camera((Path("camera"),))
    assert main(["calibrate", "stereo", "camera:0", "--target", SPEC]) == 2
    assert "one camera" in capsys.readouterr().err
