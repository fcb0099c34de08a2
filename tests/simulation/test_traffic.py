"""Vehicles and people: they move as fast as stated, and change nothing but the pixels that show them."""

from __future__ import annotations

import cv2
import numpy as np

from ispom.simulation.cameras import simulated_rig
from ispom.simulation.motions import motion_of
from ispom.simulation.places.city import build_city
from ispom.simulation.places.traffic import DRIVING_M_S, WALKING_M_S, city_with_traffic
from ispom.simulation.rendering.renderer import Renderer, View
from ispom.simulation.source import Source

T_NS, SECOND_NS = 3_000_000_000, 1_000_000_000


def test_they_move_along_the_street_as_fast_as_stated() -> None:
    traffic = city_with_traffic(2, 5, 7)
    now, then = traffic.at(T_NS), traffic.at(T_NS + SECOND_NS // 100)
    for n, mover in enumerate(traffic.movers):
        moved = (then.corner - now.corner)[mover.faces] * 100
        np.testing.assert_allclose(moved, [[0, 0, mover.speed_m_s]] * len(moved), atol=1e-6)
        low, high = DRIVING_M_S if n < 5 else WALKING_M_S
        assert low <= abs(mover.speed_m_s) <= high
    speeds = [m.speed_m_s for m in traffic.movers[:5]]
    assert min(speeds) < 0 < max(speeds), "both directions"


def test_the_city_around_them_is_the_same() -> None:
    alone, around = build_city(2), city_with_traffic(2, 3, 3).scene
    count = len(alone.corner)
    assert np.array_equal(around.corner[:count], alone.corner)
    assert np.array_equal(around.surfaces.seed[:count], alone.surfaces.seed)
    assert len(around.corner) > count + 6 * 5


def test_only_the_pixels_that_show_them_change() -> None:
    source, alone = Source(2, False, 0.4, vehicles=12, people=12), Source(2, False, 0.4)
    rig = simulated_rig(0.4)
    pose = motion_of("flight", 2).pose_at(T_NS) @ rig.rig_from_video
    assert source.traffic is not None
    static = len(alone.scene.triangles) // 2
    shown = Renderer(source.traffic.at(T_NS)).faces(View.of(rig.camera("video")), pose) >= static
    near = cv2.dilate(shown.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    differs = (source.render(T_NS, "video", 1) != alone.render(T_NS, "video", 1)).any(axis=2)
    assert shown.sum() > 100 and differs[shown].mean() > 0.9
    assert not (differs & ~near).any()


def test_the_number_of_threads_changes_nothing() -> None:
    source = Source(2, False, 0.2, vehicles=4, people=4)
    assert np.array_equal(source.render(T_NS, "stereo", 1), source.render(T_NS, "stereo", 3))
