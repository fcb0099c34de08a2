"""Points that contradict the map soon: a wrong first map is taken back, and a map of moving water is warned of."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np
import pytest

from ispom.estimators.modern.monocular import initialise
from ispom.estimators.modern.monocular.estimator import ModernMonocular, ModernMonocularConfig
from ispom.estimators.modern.monocular.initialise import Progress, advance
from ispom.estimators.modern.monocular.map import Map
from ispom.estimators.modern.monocular.setup import LOSS
from ispom.estimators.modern.monocular.state import ModernMonocularState, Start
from ispom.estimators.modern.monocular.verify_map import LASTING_KEYFRAMES, MIN_YOUNG_SHARE, YOUNG_FRAMES, lasting_share
from ispom.estimators.tracked_frame import ScenePoints, TrackedFrame
from ispom.geometry import Array, Pose
from ispom.numerics.robust import Noise
from ispom.solvers.trajectory.alignment import umeyama
from ispom.types import Camera, Decision, Frame, Image, Rig, Status, Step
from tests.estimators.modern.waved_card import FX, SIZE, WALLS, drawn, texture

CAMERA = Camera(SIZE[1], SIZE[0], FX, FX, SIZE[1] / 2, SIZE[0] / 2)
INTERVAL_NS = 50_000_000
STEP_M = 0.03


def build() -> ModernMonocular:
    return ModernMonocularConfig(max_tracks=300).build(Rig.of(video=CAMERA))


def stepped(
    estimator: ModernMonocular, images: list[Image], state: ModernMonocularState | None = None, first: int = 0
) -> tuple[list[ModernMonocularState], list[Step]]:
    """Returns the states before each image, and the one after the last, and the steps."""
    states, steps = [estimator.start() if state is None else state], []
    for i, image in enumerate(images, first):
        state, step = estimator.step(states[-1], Frame.video(i * INTERVAL_NS, image))
        states.append(state)
        steps.append(step)
    return states, steps


def lasting(steps: list[Step]) -> list[Decision]:
    return [d for s in steps for d in s.decisions if d.key == "lasting_points"]


def camera_from_world(i: int) -> Pose:
    """Sideways, before walls."""
    return Pose(np.eye(3), np.array([0.5 - STEP_M * i, 0.0, 0.0]))


def walls(pose: Pose) -> Image:
    """A wall, a slanted floor, and two static cards near the camera."""
    image = drawn(pose @ Pose(np.eye(3), np.array([0.0, 0.0, 7.0])), WALLS[0], 0.02, None)
    slanted = Pose.from_rotvec(np.array([0.8, 0.0, 0.0]), np.array([0.0, 2.0, 4.5]))
    image = drawn(pose @ slanted, WALLS[1], 0.01, image)
    for seed, x, z in ((31, -0.6, 2.5), (32, 1.3, 3.5)):
        image = drawn(pose @ Pose(np.eye(3), np.array([x, -0.4, z])), texture(seed, (100, 100)), 0.01, image)
    return image


def with_wrong_depths(world: Map) -> Map:
    """Scales the distance of each point from the first camera by a factor of its own."""
    centre, rng = world.poses[0].translation, np.random.default_rng(0)
    factors = np.exp(1.5 * rng.standard_normal((len(world.points.ids), 1)))
    return replace(world, points=ScenePoints(world.points.ids, centre + factors * (world.points.xyz - centre)))


@pytest.fixture(scope="module")
def taken_back() -> Iterator[tuple[ModernMonocular, list[Image], list[ModernMonocularState], list[Step]]]:
    """A run whose first map has wrong depths."""
    right, made = initialise.first_map, list[Map]()

    def wrong(*args: object) -> tuple[Map | None, tuple[Decision, ...]]:
        found, decisions = right(*args)  # type: ignore[arg-type]
        if found is not None:
            made.append(found)
        return (with_wrong_depths(found) if found is not None and len(made) == 1 else found), decisions

    images = [walls(camera_from_world(i)) for i in range(30)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(initialise, "first_map", wrong)
        estimator = build()
        states, steps = stepped(estimator, images)
    assert len(made) == 2, "the second one stays"
    yield estimator, images, states, steps


def at_take_back(steps: list[Step]) -> int:
    (index,) = [i for i, s in enumerate(steps) if s.restarted]
    return index


def test_a_wrong_first_map_is_taken_back(taken_back: tuple[ModernMonocular, list[Image], list, list[Step]]) -> None:
    estimator, _, states, steps = taken_back
    at = at_take_back(steps)
    first = next(i for i, s in enumerate(steps) if s.status is Status.TRACKING)
    test = lasting(steps[at : at + 1])[0]
    assert not test.passed and test.value < MIN_YOUNG_SHARE and test.kind == "warning" and test.consequence
    assert first < at <= first + YOUNG_FRAMES and steps[at].status is Status.INITIALISING
    after = states[at + 1]
    assert after.map is None and not after.database.keyframes and after.segments == 2
    times = estimator.finish(after).times_ns // INTERVAL_NS
    assert not set(times) & set(range(first, at)), "frames that the wrong map localised have no poses"


def test_the_map_after_it_is_right(taken_back: tuple[ModernMonocular, list[Image], list, list[Step]]) -> None:
    estimator, _, states, steps = taken_back
    at = at_take_back(steps)
    assert steps[-1].status is Status.TRACKING and all(d.passed for d in lasting(steps[at + 1 :]))
    found = estimator.finish(states[-1])
    found = found.select(found.times_ns >= at * INTERVAL_NS)
    assert len(found) == len(steps) - at
    truth = np.array([camera_from_world(int(t) // INTERVAL_NS).inverse().translation for t in found.times_ns])
    errors = np.linalg.norm(
        umeyama(found.translations, truth, with_scale=True).apply(found.translations) - truth, axis=1
    )
    assert errors.max() < 0.02 * np.linalg.norm(truth[-1] - truth[0])


def test_a_state_before_the_map_was_taken_back_can_be_stepped_on_from(
    taken_back: tuple[ModernMonocular, list[Image], list[ModernMonocularState], list[Step]],
) -> None:
    estimator, images, states, steps = taken_back
    first = at_take_back(steps)
    again, _ = stepped(estimator, images[first:], states[first], first)
    a, b = estimator.finish(again[-1]), estimator.finish(states[-1])
    assert np.array_equal(a.times_ns, b.times_ns) and np.array_equal(a.translations, b.translations)


def water(count: int, drift_px: float, sway_px: float, width_px: int, memory: float) -> list[Image]:
    """Images of a surface that drifts, and sways with a field that is smooth over `width_px`, and that keeps a share
    `memory` of itself in the next image. The camera is static."""
    rng, (height, width) = np.random.default_rng(0), SIZE
    of = texture(50, (700, 1200))
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    shown, images = np.stack([x + 400, y + 230]), list[Image]()

    def field() -> Array:
        coarse = rng.standard_normal((height // (2 * width_px) + 4, width // (2 * width_px) + 4))
        found = cv2.resize(coarse, None, fx=2 * width_px, fy=2 * width_px, interpolation=cv2.INTER_CUBIC)
        found = found[width_px : width_px + height, width_px : width_px + width]
        return np.asarray(found / found.std())

    sway = np.stack([field(), field()])
    for _ in range(count):
        before = np.stack([x - drift_px * (0.5 + y / height) - sway_px * sway[0], y - sway_px * sway[1]])
        before = before.astype(np.float32)
        inside = np.stack([np.clip(before[0], 0, width - 1), np.clip(before[1], 0, height - 1)])
        moved = [cv2.remap(part, inside[0], inside[1], cv2.INTER_LINEAR) for part in shown]
        shown = (np.stack(moved) + before - inside).astype(np.float32)
        images.append(np.asarray(cv2.remap(of, shown[0], shown[1], cv2.INTER_LINEAR), np.uint8))
        sway = memory * sway + np.sqrt(1 - memory**2) * np.stack([field(), field()])
    return images


@pytest.mark.parametrize(("drift_px", "sway_px", "width_px", "memory"), [(0.0, 1.0, 40, 0.975), (3.0, 0.5, 60, 0.935)])
def test_a_map_of_water_is_warned_of(drift_px: float, sway_px: float, width_px: int, memory: float) -> None:
    _, steps = stepped(build(), water(40, drift_px, sway_px, width_px, memory))
    tracked = [i for i, s in enumerate(steps) if s.status is Status.TRACKING]
    assert tracked, "water may be taken for a scene"
    early, late = lasting(steps[: tracked[0] + 5]), lasting(steps[tracked[0] + 15 :])
    assert early[0].passed and late and not any(d.passed for d in late[:3])


def test_a_map_among_moving_cards_is_not_taken_back() -> None:
    """Twenty-four cards before the walls, each with a motion of its own, cover a third of the image."""
    rng, images = np.random.default_rng(0), list[Image]()
    place, speed = rng.uniform((-2.0, -1.3), (2.0, 1.3), (24, 2)), rng.uniform(-0.06, 0.06, (24, 2))
    cards = [texture(900 + i, (44, 44)) for i in range(24)]
    covered = np.zeros(SIZE, bool)
    for i in range(40):
        pose = camera_from_world(i)
        image = before = walls(pose)
        for j, card in enumerate(cards):
            at = Pose.from_rotvec(
                np.array([0.0, 0.0, 0.02 * i * (-1) ** j]), np.array([*(place[j] + i * speed[j]), 3.2])
            )
            image = drawn(pose @ at, card, 0.01, image)
        images.append(image)
        if i == 0:
            covered = image != before
    assert covered.mean() > 0.25
    _, steps = stepped(build(), images)
    assert steps[-1].status is Status.TRACKING and not any(s.restarted for s in steps)
    assert len(lasting(steps)) > 10 and all(d.passed for d in lasting(steps))


@pytest.mark.parametrize(("wrong_before", "expected"), [(False, True), (True, False)])
def test_after_a_wrong_map_the_next_one_requires_the_full_parallax(wrong_before: bool, expected: bool) -> None:
    """A third of the first frame's points are left in the last one, with half of the parallax."""
    rng = np.random.default_rng(0)
    xyz, found = rng.uniform((-2, -1.5, 3), (2, 1.5, 7), (500, 3)), Progress(Start(taken_back=wrong_before), (), None)
    for i in range(8):
        p = xyz - (0.03 * i, 0.0, 0.0)
        ids = np.arange(340 * i // 7, 500)
        x = (p[:, :2] / p[:, 2:])[ids] + rng.normal(0, 4e-5, (len(ids), 2))
        frame = TrackedFrame(i * INTERVAL_NS, ids, x)
        found = advance(found.start, frame, Noise(1e-4 / LOSS, LOSS), np.radians(1.0))
    parallax = next(d for d in found.decisions if d.key == "start_parallax")
    assert 0.3 < parallax.value < 0.8 and bool(parallax.passed) is expected
    assert (found.map is not None) is expected
    if wrong_before:
        assert not found.start.requires_full_parallax, "its points left, so the next reference has the usual limits"


@pytest.mark.parametrize(
    ("every", "expected"), [(1, 0.9**LASTING_KEYFRAMES), (2, 0.9 ** (2 * LASTING_KEYFRAMES + 1)), (50, 0.9**10)]
)
def test_points_should_agree_for_ten_frames_or_three_keyframes(every: int, expected: float) -> None:
    agreeing = tuple((0.9, i % every == 0) for i in range(20))
    assert lasting_share(agreeing) == pytest.approx(expected)
