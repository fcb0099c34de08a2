"""A sequence without a calibration: the camera that its images tell, and what is said about it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ispom.calibration.tracked import self_calibration
from ispom.calibration.tracked.solve import TrackedLens
from ispom.features.pair_look import MIXED_UP
from ispom.sequences import open_sequence
from ispom.types import Camera, Guess, Rig, Sequence

GUESS = Guess(224.0, 0.3, "a guess: 0.7 of the longer side")
CAMERA = Camera(320, 240, 230.0, 230.0, 160.0, 118.0, (-0.21, 0.05, 0.0, 0.0))


def uncalibrated(name: str = "sim:tiny") -> Sequence:
    sequence = open_sequence(name)
    video = sequence.rig.camera("video")
    rig = Rig.single(GUESS.camera((video.width, video.height)))
    return replace(sequence, rig=rig, guess=GUESS, notes=(GUESS.note, "another"))


def found(sigma: float) -> TrackedLens:
    errors = np.array([sigma, 2.0, 2.0, 0.01, 0.01])
    return TrackedLens(CAMERA, np.diag(errors**2), np.array([0.3, 5, 5, 0.25, 0.12]), 0.3, 20, 500)


def test_the_camera_of_a_simulation_is_found_in_its_images() -> None:
    truth = open_sequence("sim:tiny").rig.camera("video")
    sequence = self_calibration.self_calibrated(uncalibrated())
    camera, guess = sequence.rig.camera("video"), sequence.guess
    assert camera.fx == camera.fy == pytest.approx(truth.fx, rel=0.01)
    assert camera.distortion[0] == pytest.approx(truth.distortion[0], abs=0.01)
    assert guess is not None and guess.sigma < 0.01 and "the motion in" in guess.origin
    assert abs(np.log(camera.fx / truth.fx)) < 3 * guess.sigma
    assert sequence.notes[0].startswith("The camera has no calibration")
    assert sequence.notes[1:] == ("another",)


@pytest.mark.parametrize(
    ("lens", "said", "focal"),
    [
        (None, "too little motion or texture", 224.0),
        (found(0.28), "does not tell it", 224.0),
        (found(0.12), "+- 12.0 %, distortion k1 -0.210 +- 0.010: for a first look only", 230.0),
        (found(0.008), "+- 0.8 %, distortion k1 -0.210 +- 0.010. Better", 230.0),
    ],
)
def test_the_notes_have_the_uncertainty(
    lens: TrackedLens | None, said: str, focal: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(self_calibration, "estimate_lens", lambda *_: lens)
    sequence = self_calibration.self_calibrated(uncalibrated())
    assert said in sequence.notes[0]
    assert sequence.rig.camera("video").fx == focal
    assert sequence.guess is not None and sequence.guess.focal_px == focal


def test_a_calibrated_sequence_is_unchanged(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(self_calibration, "estimate_lens", lambda *_: pytest.fail("its images are not looked at"))
    sequence = open_sequence("sim:tiny")
    assert self_calibration.self_calibrated(sequence) is sequence


def test_where_the_images_are_mixed_up_nothing_is_looked_for_in_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(self_calibration, "estimate_lens", lambda *_: pytest.fail("looked for"))
    sequence = replace(uncalibrated(), notes=(GUESS.note, MIXED_UP[0]))
    assert self_calibration.self_calibrated(sequence) is sequence
