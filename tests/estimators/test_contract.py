"""What every estimator must keep: one test for all of them."""

from __future__ import annotations

from dataclasses import FrozenInstanceError, is_dataclass

import numpy as np
import pytest

from ispom.ensemble import build
from ispom.errors import InputError
from ispom.methods import Config, possible_methods
from ispom.settings import settings
from ispom.types import Camera, Exposure, Rig, Sequence, Status, Step, StereoPair, TrackStatus, Trajectory, VideoFrame
from tests.alone import ALL, METHODS, PAPER, alone, run


def same(a: Trajectory, b: Trajectory) -> bool:
    return all(np.array_equal(getattr(a, n), getattr(b, n)) for n in ("times_ns", "rotations", "translations"))


@pytest.fixture(scope="module", params=ALL)
def method(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(scope="module")
def estimator(method: str, flight: Sequence):
    return alone(method, flight.rig)


@pytest.fixture(scope="module")
def walked(estimator, exposures: list[Exposure]):
    """Every state and step of a whole run."""
    states, steps = [estimator.start()], []
    for exposure in exposures:
        if estimator.uses(exposure):
            state, step = estimator.step(states[-1], exposure)
            states.append(state)
            steps.append(step)
    return states, steps


def test_steps_say_what_happened(estimator, walked, flight: Sequence) -> None:
    _, steps = walked
    assert [s.time_ns for s in steps] == sorted({s.time_ns for s in steps})
    assert {s.method for s in steps} == {estimator.name}
    assert any(s.status is Status.TRACKING for s in steps)
    for step in steps:
        check_step(step, flight)
        for part in step.parts:
            check_step(part, flight)


def check_step(step: Step, flight: Sequence) -> None:
    assert step.seconds and all(v >= 0 for v in step.seconds.values())
    assert (step.residuals_px >= 0).all()
    if step.world_from_frame is not None:
        rotation = step.world_from_frame.rotation
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
    assert all(str(d).endswith((": yes", ": no", ")")) for d in step.decisions)
    assert (step.revised.times_ns <= step.time_ns).all()
    assert len(step.landmarks.rgb) == len(step.landmarks) == len(step.landmarks.xyz_in_world)
    for name, tracks in step.tracks.items():
        camera = flight.rig.camera(name)  # type: ignore[arg-type]
        assert len(np.unique(tracks.ids)) == len(tracks.ids)
        assert np.isin(tracks.status, [int(s) for s in TrackStatus]).all()
        assert ((tracks.uv > -1) & (tracks.uv < (camera.width, camera.height))).all()
        assert np.isnan(tracks.uv_prev[tracks.status == TrackStatus.NEW]).all()


def test_a_run_repeats_bit_for_bit(estimator, walked, exposures: list[Exposure]) -> None:
    states, steps = walked
    again = list(run(estimator, exposures))
    assert all(
        (a.world_from_frame is None) == (b.world_from_frame is None) and same(a.revised, b.revised)
        for a, b in zip(steps, again, strict=True)
    )
    for a, b in zip(steps, again, strict=True):
        if a.world_from_frame is not None and b.world_from_frame is not None:
            assert np.array_equal(a.world_from_frame.matrix, b.world_from_frame.matrix)
    assert len(estimator.finish(states[-1])) > 0


def test_an_earlier_state_can_be_stepped_on_from(estimator, walked, exposures: list[Exposure]) -> None:
    """State is a value: going on from the middle, after the whole run, gives the same end."""
    states, _ = walked
    used = [e for e in exposures if estimator.uses(e)]
    middle = len(used) // 2
    estimator.finish(states[middle])
    state = states[middle]
    for exposure in used[middle:]:
        state, _ = estimator.step(state, exposure)
    assert same(estimator.finish(state), estimator.finish(states[-1]))


def test_states_are_frozen_and_the_exposures_untouched(estimator, walked, exposures: list[Exposure]) -> None:
    states, _ = walked
    assert all(is_dataclass(state) for state in states[-1].values())
    with pytest.raises(FrozenInstanceError):
        next(iter(states[-1].values())).poses = None
    image = next(e for e in exposures if estimator.uses(e))
    arrays = (image.image,) if isinstance(image, VideoFrame) else (image.left, image.right)
    before = [a.copy() for a in arrays]
    estimator.step(estimator.start(), image)
    assert all(np.array_equal(a, b) for a, b in zip(arrays, before, strict=True))


def test_images_without_texture_give_no_pose_and_no_error(estimator, exposures: list[Exposure]) -> None:
    flat = [
        VideoFrame(e.time_ns, np.full_like(e.image, 128))
        if isinstance(e, VideoFrame)
        else StereoPair(e.time_ns, np.full_like(e.left, 128), np.full_like(e.right, 128))
        for e in exposures[:12]
    ]
    steps = list(run(estimator, flat))
    assert not any(s.status is Status.TRACKING for s in steps)


def test_every_setting_explains_itself_and_is_checked(method: str, flight: Sequence) -> None:
    config = Config().of(method)
    for setting in settings(type(config)):
        assert setting.help, setting.name
        assert setting.type in (bool, str) or setting.range or "Literal" in str(setting.type), setting.name
    bounded = next(s for s in settings(type(config)) if s.range)
    assert bounded.range is not None
    broken = Config().with_settings(method, type(config)(**{bounded.name: bounded.range.high + 1}))
    with pytest.raises(InputError, match=bounded.name.replace("_", "-")):
        build(broken, (method,), flight.rig)


def test_methods_without_their_cameras_are_refused() -> None:
    camera = Camera(64, 48, 50, 50, 31.5, 23.5)
    assert possible_methods(Rig.single(camera)) == ("monocular", "monocular.paper")
    assert possible_methods(Rig.stereo(camera, 0.3)) == ("stereo", "stereo.paper")
    with pytest.raises(InputError, match="left and a right camera"):
        build(Config(), ("integrated",), Rig.single(camera))
    with pytest.raises(InputError, match="video camera"):
        build(Config(), ("monocular",), Rig.stereo(camera, 0.3))


@pytest.mark.parametrize("names", [METHODS, PAPER], ids=["modern", "paper"])
def test_an_ensemble_gives_what_each_method_alone_gives(
    names: tuple[str, ...], flight: Sequence, exposures: list[Exposure]
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
