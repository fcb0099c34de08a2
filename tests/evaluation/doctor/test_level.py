"""A pair that is not level, on images that are moved up or down, and on real ones."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from ispom.evaluation.doctor.counterfactual import Figure
from ispom.evaluation.doctor.examination import Examination, examination
from ispom.evaluation.doctor.stretch import Shot
from ispom.evaluation.doctor.suspects.calibration import recorded
from ispom.evaluation.doctor.suspects.level import unlevel
from ispom.sequences import open_sequence
from ispom.types import Frame, Measurement

LAST = 49
DATA = Path(__file__).parents[4] / "shared/data"


@cache
def seen(words: str = "") -> Examination:
    return examination(open_sequence(f"sim:tiny{words}", seed=0), 0, LAST)


def moved(found: Examination, down_px: int) -> Examination:
    """Returns it with right images that are so much lower."""

    def lower(shot: Shot) -> Shot:
        right = np.roll(shot.images["right"], down_px, axis=0)
        return replace(shot, images={**shot.images, "right": right})

    return replace(found, shots=tuple(lower(shot) if shot.is_pair else shot for shot in found.shots))


def test_a_level_pair_has_no_offset() -> None:
    finding = unlevel(seen())
    assert finding is not None and not finding.found
    assert abs(finding.values["shift_px"]) < 0.1


@pytest.mark.parametrize("down_px", [2, -3])
def test_a_right_image_that_is_too_low_or_too_high_is_found_by_its_pixels(down_px: int) -> None:
    finding = unlevel(moved(seen(), down_px))
    assert finding is not None and finding.found
    assert finding.values["shift_px"] == pytest.approx(down_px, abs=0.1)
    assert 0 < finding.values["shift_px_sigma"] < 0.1


def test_figures_are_in_pixels_of_the_recording_s_images() -> None:
    recording, times = open_sequence("sim:tiny", seed=0), 2  # a pair 1280 px wide: examined at half of that

    def load(i: int) -> Measurement:
        frame = recording.load(i)
        assert isinstance(frame, Frame)
        images = {name: image.repeat(times, axis=0).repeat(times, axis=1) for name, image in frame.images.items()}
        if "right" in images:
            images["right"] = np.roll(images["right"], 8, axis=0)
        return replace(frame, images=images)

    rig = recording.rig.changed(**{name: camera.scaled(times) for name, camera in recording.rig.cameras.items()})
    large = examination(replace(recording, rig=rig, load=load), 0, LAST)
    finding = unlevel(large)
    assert large.reduced == {"left": 2, "right": 2} and large.rig.camera("right").width == 640
    assert finding is not None and finding.values["shift_px"] == pytest.approx(8, abs=0.3)
    offset = recorded("pair_centre_x_px", Figure(2.0, 0.5), large), recorded("k1", Figure(2.0, 0.5), large)
    assert [(figure.value, figure.sigma) for figure in offset] == [(4.0, 1.0), (2.0, 0.5)]


def test_a_camera_that_is_turned_is_left_to_the_tracks_and_told_by_its_angle() -> None:
    finding = unlevel(seen("?fault=wrong-pair:pitch_deg=0.3,yaw_deg=0"))
    assert finding is not None and not finding.found
    assert finding.values["pitch_deg"] == pytest.approx(0.3, abs=0.03)


def test_without_texture_nothing_is_said() -> None:
    assert unlevel(seen("?place=blank&motion=sideways")) is None


@pytest.mark.skipif(not (DATA / "hard/rover_unlevel").exists(), reason="no ../shared/data/hard")
def test_a_rover_s_pair_is_not_level() -> None:
    finding = unlevel(examination(open_sequence(str(DATA / "hard/rover_unlevel/sequences/32")), 0, 30))
    assert finding is not None and finding.found
    assert finding.values["shift_px"] == pytest.approx(3.1, abs=3 * finding.values["shift_px_sigma"] + 0.05)
