"""The kinds of faults of a study: right suspects and figures have the doctor's own names, and sizes suit the images."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.errors import InputError
from ispom.evaluation.doctor.hypothesis import STEPS
from ispom.evaluation.doctor.suspects import SUSPECTS
from ispom.sequences import open_sequence
from ispom.simulation.scenario.calibrations import WrongLens
from ispom.simulation.scenario.images import Defocus
from ispom.simulation.scenario.kinds import HEALTHY, KINDS, kind_of_words, with_fault
from ispom.types import Camera, Rig

PHONE = Rig.single(Camera(1920, 1080, 1000, 1000, 960, 540))


@pytest.mark.parametrize("name", KINDS)
def test_a_kind_is_on_a_simulation_and_the_doctor_knows_its_names(name: str) -> None:
    kind = KINDS[name]
    sequence = open_sequence(kind.address("sim:tiny", 0), seed=0)
    assert kind.applies_to(sequence.rig, True)
    assert len(with_fault(sequence, kind, 0)) > 0
    fault = kind.made(sequence.rig)
    figures = kind.figures(fault) if kind.figures is not None else {}
    assert set(figures) <= set(STEPS)
    assert set(kind.suspects) <= {each.key for each in SUSPECTS}
    assert name != HEALTHY or not (kind.suspects or kind.fault or kind.world)


def test_sizes_in_pixels_grow_with_the_images_unless_they_are_given() -> None:
    assert KINDS["blur"].made(PHONE) == Defocus(sigma_px=15.0)
    assert kind_of_words("blur:sigma_px=4").made(PHONE) == Defocus(sigma_px=4.0)


def test_other_settings_keep_the_rest_of_a_kind() -> None:
    kind = kind_of_words("centre:centre_y_px=2")
    assert kind.made(PHONE) == WrongLens(focal_percent=0.0, centre_x_px=36.0, centre_y_px=2.0)
    assert kind.figures is not None and kind.figures(kind.made(PHONE))["video_centre_y_px"] == -2.0


def test_a_fault_may_come_after_another() -> None:
    kind = kind_of_words("unlevel:rows_px=-3+focal:focal_percent=5")
    assert kind.suspects == ("video-focal",) and not kind.applies_to(PHONE, False)
    plain = open_sequence("sim:tiny", seed=0).part(0, 1)
    found = with_fault(plain, kind, 0)
    was, now = plain[plain.kinds.index("stereo")], found[plain.kinds.index("stereo")]
    assert np.array_equal(now.right[:-3], was.right[3:])  # type: ignore[union-attr]
    assert found.rig.camera("video").fx == pytest.approx(1.05 * plain.rig.camera("video").fx)


def test_a_fault_needs_its_cameras() -> None:
    suits = {name for name, kind in KINDS.items() if kind.applies_to(PHONE, False)}
    assert {"blur", "focal", HEALTHY} <= suits
    assert not suits & {"exchanged", "baseline", "clock", "mount", "unlevel", "traffic", "rolling-shutter"}


@pytest.mark.parametrize(
    "words", ["nothing", "blur+nothing", "healthy:a=1", "blur:colour=1", "blur:sigma_px=red", "traffic:people=1"]
)
def test_what_is_no_kind_is_said(words: str) -> None:
    with pytest.raises(InputError):
        kind_of_words(words)


def test_a_part_of_a_sequence_counts_from_0() -> None:
    whole = open_sequence("sim:tiny", seed=0)
    part = whole.part(10, 19)
    assert len(part) == 10 and part.kinds == whole.kinds[10:20]
    assert part[3].time_ns == whole.times_ns[13] == part.times_ns[3]
