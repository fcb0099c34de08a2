"""The eye of the 3-D view: what it is to show is in sight, and it moves no more often than needed."""

from __future__ import annotations

import numpy as np
import pytest
from ispom_app.views.rerun.eye import FOV_RAD, Eye, eye_above, eye_behind, eye_from_side, eye_of, eye_on, is_framed

from ispom.geometry import Pose

LEAST = 2.0
RANDOM = np.random.default_rng(7)
PATHS = {
    "nothing": np.zeros((0, 3)),
    "one pose": np.ones((1, 3)),
    "straight": np.linspace([0, 0, 0], [0, 0.5, 200], 900),
    "sideways": np.linspace([5, 0, 5], [-40, 1, 5], 50),
    "upwards": np.linspace([0, 0, 0], [0, -30, 0], 50),
    "any": RANDOM.normal(size=(300, 3)) * [30, 3, 20] + [100, 5, -40],
}


def in_sight(eye: Eye, path: np.ndarray) -> bool:
    forward = (eye.target - eye.position) / np.linalg.norm(eye.target - eye.position)
    right = np.cross(forward, eye.up)
    right /= np.linalg.norm(right)
    away = path - eye.position
    depth = away @ forward
    sides = np.abs(np.stack([away @ right, away @ np.cross(right, forward)]))
    return bool((depth > 0).all() and (sides <= np.tan(FOV_RAD / 2) * depth).all())


@pytest.mark.parametrize("place", [eye_on, eye_above, eye_from_side])
@pytest.mark.parametrize("path", PATHS.values(), ids=PATHS)
def test_the_whole_path_is_visible_and_large(place, path):
    eye = place(path, LEAST)
    assert in_sight(eye, path) and np.isfinite(eye.position).all()
    nearer = Eye(eye.target + 0.5 * (eye.position - eye.target), eye.target, eye.up)
    assert len(path) < 2 or not in_sight(nearer, path)


def test_up_on_the_screen_is_up_in_the_world():
    for place in (eye_on, eye_from_side):
        assert place(PATHS["any"], LEAST).up @ [0, -1, 0] > 0.5
    assert np.allclose(eye_above(PATHS["any"], LEAST).up, [0, 0, 1]), "forward, as on a map"
    assert eye_on(PATHS["any"], LEAST).position[1] < PATHS["any"][:, 1].min(), "seen from above"


def test_the_eyes_of_a_camera_look_where_it_looks():
    pose = Pose.from_rotvec(np.array([0.0, np.pi / 2, 0.0]), np.array([3.0, 1.0, 2.0]))  # z of the camera is x
    own, behind = eye_of(pose, 4.0), eye_behind(pose, 4.0)
    assert np.allclose(own.position, [3, 1, 2]) and np.allclose(own.target, [7, 1, 2])
    assert behind.position[0] < 3 < behind.target[0] and behind.position[1] < 1


def test_a_path_is_framed_until_it_leaves_or_is_much_smaller():
    path = PATHS["straight"]
    assert is_framed(path, path, LEAST) and is_framed(path[:600], path, LEAST)
    assert not is_framed(path[:100], path, LEAST)
    assert not is_framed(path * 1.5, path, LEAST)
    assert is_framed(np.full((1, 3), 0.2), PATHS["nothing"], LEAST)
