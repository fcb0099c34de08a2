"""What every estimator must keep: one test for all of them, and what the registry and the ensemble add."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.ensemble import build
from ispom.errors import InputError
from ispom.methods import Config, possible_methods
from ispom.methods import method as registered
from ispom.settings import settings
from ispom.testing import check_estimator
from ispom.testing.flight import flight_rig
from ispom.types import Camera, Frame, Measurement, Rig, Sequence, Trajectory
from tests.alone import ALL, METHODS, OF_CAMERAS, OWN_SEQUENCES, PAPER

LONG = {"direct.monocular", "lines.monocular", "multicamera", "flow", "trifocal"}
"""Methods whose contract takes more than 20 s."""


@pytest.mark.parametrize("method", [pytest.param(m, marks=[pytest.mark.slow] * (m in LONG)) for m in ALL])
def test_every_method_keeps_the_contract(method: str) -> None:
    check_estimator(method, sequence=OWN_SEQUENCES[method]() if method in OWN_SEQUENCES else None)


def same(a: Trajectory, b: Trajectory) -> bool:
    return all(np.array_equal(getattr(a, n), getattr(b, n)) for n in ("times_ns", "rotations", "translations"))


@pytest.mark.parametrize("method", ALL)
def test_a_setting_out_of_its_range_is_refused(method: str, flight: Sequence) -> None:
    config = Config().of(method)
    bounded = next(s for s in settings(type(config)) if s.range)
    assert bounded.range is not None
    broken = Config().with_settings(method, type(config)(**{bounded.name: bounded.range.high + 1}))
    rig = flight_rig(all_at_once=True) if method in OF_CAMERAS else flight.rig
    with pytest.raises(InputError, match=bounded.name.replace("_", "-")):
        build(broken, (method,), rig)
    with pytest.raises(InputError, match=bounded.name):  # in Python, without an ensemble
        broken.of(method).build(rig)


@pytest.mark.parametrize("method", ALL)
def test_an_image_of_another_size_than_the_rigs_is_refused(method: str, flight: Sequence) -> None:
    """The rig of the flight, and images that are cut off: their calibration would be another one."""
    sequence = OWN_SEQUENCES[method]() if method in OWN_SEQUENCES else flight
    several = method in OF_CAMERAS
    rig = flight_rig(all_at_once=True) if several else sequence.rig
    if several:
        first: Measurement = Frame(
            0, {name: np.zeros((c.height, c.width), np.uint8) for name, c in rig.cameras.items()}
        )
    else:
        first = next(m for m in sequence if registered(method).uses(m))
    assert isinstance(first, Frame)
    cut = first.with_images(**{name: image[:-8] for name, image in first.images.items()})
    ensemble = build(Config(), (method,), rig)
    with pytest.raises(InputError, match="pixels"):
        ensemble.step(ensemble.start(), cut)
    ensemble.step(ensemble.start(), first)


def test_methods_without_their_cameras_are_refused() -> None:
    camera = Camera(64, 48, 50, 50, 31.5, 23.5)
    possible = set(possible_methods(Rig.single(camera)))
    assert possible & {*METHODS, *PAPER} == {"monocular", "monocular.paper"}
    possible = set(possible_methods(Rig.stereo(camera, 0.3)))
    assert possible & {*METHODS, *PAPER} == {"stereo", "stereo.paper"}
    with pytest.raises(InputError, match="right camera"):
        build(Config(), ("integrated",), Rig.single(camera))
    with pytest.raises(InputError, match="video camera"):
        build(Config(), ("monocular",), Rig.stereo(camera, 0.3))


@pytest.mark.parametrize("names", [METHODS, PAPER], ids=["modern", "paper"])
def test_an_ensemble_gives_what_each_method_alone_gives(
    names: tuple[str, ...], flight: Sequence, exposures: list[Measurement]
) -> None:
    together = build(Config(), names, flight.rig)
    assert sorted(together.members) == sorted(names)
    state = together.start()
    for exposure in exposures[:45]:
        state, steps = together.step(state, exposure)
        assert len(steps) == 2
    found = together.finish(state)
    for name in names:
        ensemble = build(Config(), (name,), flight.rig)
        state = ensemble.start()
        for exposure in exposures[:45]:
            state, _ = ensemble.step(state, exposure)
        assert same(ensemble.finish(state)[name], found[name])
