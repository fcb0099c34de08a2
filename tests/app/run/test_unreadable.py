"""One unreadable image in a long run is skipped and reported; several end it."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from ispom_app.engine.playback import Playback
from ispom_app.features.headless.options import Run

from ispom.errors import InputError, UnreadableImage
from ispom.io.trajectories import read_tum
from ispom.types import Measurement, Sequence
from tests import doubles
from tests.alone import METHODS
from tests.app import helpers
from tests.app.helpers import ran


def spoilt(*bad: int) -> Sequence:
    whole = doubles.sequence(150)

    def load(i: int) -> Measurement:
        if i in bad:
            raise UnreadableImage(f"image {i} is not a whole image: restore it")
        return whole.load(i)

    return replace(whole, load=load)


def test_the_run_goes_on_without_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    sequence = spoilt(40)
    monkeypatch.setattr(Run, "open", lambda *_: sequence)
    ran("made", tmp_path / "out", "--recording", builder=helpers.build)
    assert "skipped: image 40" in capsys.readouterr().out
    (skipped,) = json.loads((tmp_path / "out" / "metrics.json").read_text())["skipped"]
    assert skipped.startswith("image 40 ")
    kind = sequence.kinds[40]
    poses = read_tum(tmp_path / "out" / ("monocular.tum" if kind == "video" else "stereo.tum"))
    assert len(poses) == sequence.kinds.count(kind) - 1


def test_a_second_in_less_than_two_hundred_ends_it() -> None:
    run = Playback(spoilt(40, 41), METHODS, builder=helpers.build)
    with pytest.raises(InputError, match=r"image 41 is not a whole image: restore it \(skipped before it: 1\)"):
        while not run.done:
            run.step()
    assert run.position == 41


def test_a_wrong_image_still_ends_it() -> None:
    def load(_: int) -> Measurement:
        raise InputError("image 0 is 20 x 10, not 80 x 60: restore it")

    run = Playback(replace(doubles.sequence(150), load=load), METHODS, builder=helpers.build)
    with pytest.raises(InputError, match="20 x 10"):
        run.step()
