"""Egomotion from flow: exact motions of exact flow, and what it says of a camera that turns on the spot."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from ispom.estimators.survey.flow import FlowConfig, by_rotation, by_velocity, egomotion
from ispom.geometry import Pose, so3_exp
from ispom.types import Frame, Sequence
from tests.alone import run

RNG = np.random.default_rng(2)
X = RNG.uniform([-0.6, -0.4], [0.6, 0.4], (200, 2))
DEPTHS = RNG.uniform(3, 30, 200)


def flow_of(velocity: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    return by_velocity(X) @ velocity / DEPTHS[:, None] + by_rotation(X) @ rotation


@settings(max_examples=25, deadline=None)
@given(st.tuples(*[st.floats(-1, 1)] * 3), st.tuples(*[st.floats(-0.05, 0.05)] * 3))
def test_exact_flow_gives_the_exact_motion(velocity: tuple, rotation: tuple) -> None:
    direction = np.array(velocity)
    if np.linalg.norm(direction) < 0.2:
        return
    direction = direction / np.linalg.norm(direction)
    found = egomotion(X, flow_of(direction, np.array(rotation)), 1e-3)
    assert_allclose(found.rotation_rad, rotation, atol=1e-4)
    assert np.degrees(np.arccos(np.clip(found.direction @ direction, -1, 1))) < 0.1


def test_a_third_of_wrong_vectors_changes_little() -> None:
    direction, rotation = np.array([0.1, 0.0, 0.995]), np.array([0.0, 0.02, 0.0])
    flow = flow_of(direction, rotation)
    flow[::3] += RNG.normal(0, 0.05, flow[::3].shape)
    found = egomotion(X, flow, 1e-3)
    assert_allclose(found.rotation_rad, rotation, atol=1e-3)
    assert np.degrees(np.arccos(found.direction @ direction / np.linalg.norm(direction))) < 2


def true_motion(sequence: Sequence, before: Frame, now: Frame) -> tuple[np.ndarray, np.ndarray]:
    """Direction in the camera, and rotation vector [rad]."""
    assert sequence.truth is not None
    cameras = [(sequence.truth.at(f.time_ns) or Pose()) @ sequence.rig.rig_from("video") for f in (before, now)]
    between = cameras[0].inverse() @ cameras[1]
    return between.translation / np.linalg.norm(between.translation), between.rotvec


def test_rendered_images_give_the_direction_within_five_degrees(flight: Sequence, exposures: list) -> None:
    frames = [e for e in exposures if e.kind == "video"][:16]
    steps = list(run(FlowConfig().build(flight.rig), frames))
    directions, rates = [], []
    for before, now, first, second in zip(frames[1:], frames[2:], steps[1:], steps[2:], strict=False):
        between = first.world_from_frame.inverse() @ second.world_from_frame
        direction, rotation = true_motion(flight, before, now)
        found = between.translation / np.linalg.norm(between.translation)
        directions.append(np.degrees(np.arccos(np.clip(found @ direction, -1, 1))))
        rates.append(np.degrees(np.linalg.norm(between.rotvec - rotation)) / ((now.time_ns - before.time_ns) * 1e-9))
    assert np.median(directions) < 5 and np.median(rates) < 1.0


def test_a_camera_that_turns_on_the_spot_holds_its_direction(flight: Sequence, exposures: list) -> None:
    frame = next(e for e in exposures if e.kind == "video")
    camera = flight.rig.camera("video")
    k = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])
    turned = k @ so3_exp(np.array([0.01, -0.015, 0.005])) @ np.linalg.inv(k)
    size = frame.image.shape[1::-1]
    image = cv2.warpPerspective(frame.image, turned, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    flow: Any = FlowConfig().build(flight.rig)
    state, _ = flow.step(flow.start(), frame)
    state, step = flow.step(state, Frame.video(frame.time_ns + 33_000_000, np.asarray(image, np.uint8)))
    assert step.world_from_frame is not None
    assert_allclose(step.world_from_frame.translation, 0, atol=1e-12)
    assert_allclose(step.world_from_frame.rotvec, [-0.01, 0.015, -0.005], atol=3e-3)  # the lens bends the images
    assert not next(d for d in step.decisions if d.key == "translation_flow").passed
