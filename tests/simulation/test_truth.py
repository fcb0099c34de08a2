"""Depth, flow and visibility against the images themselves."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

from ispom.sensors.laser import Profiler
from ispom.simulation.motions import Flight
from ispom.simulation.places.city import build_city
from ispom.simulation.rendering.renderer import Renderer, View
from ispom.simulation.rendering.scene import Scene
from ispom.simulation.source import Source
from ispom.simulation.truth import Truth
from ispom.types import TimedPoints

SOURCE = Source(2, False, 0.4, vehicles=12, people=12)
T_NS, LATER_NS = 3_000_000_000, 3_100_000_000


def test_depth_is_that_of_the_renderer() -> None:
    source = replace(SOURCE, vehicles=0, people=0)
    truth = Truth(source)
    rendered = Renderer(source.scene).depth(truth.camera("left"), truth.pose("left", T_NS))  # type: ignore[arg-type]
    found = truth.depth("left", T_NS)
    seen = np.isfinite(rendered) & np.isfinite(found)
    assert seen.mean() > 0.5 and (np.abs(found[seen] - rendered[seen]) < 1e-3).mean() > 0.995


@pytest.mark.parametrize(("other", "other_ns"), [("video", LATER_NS), ("left", T_NS)])
def test_what_is_in_view_looks_the_same_where_the_flow_leads(other, other_ns: int) -> None:
    truth = Truth(SOURCE)
    flow, visible = truth.flow("video", T_NS, other, other_ns)
    now, then = SOURCE.light("video", T_NS, 1), SOURCE.light(other, other_ns, 1)
    y, x = np.indices(visible.shape).astype(np.float32)
    places = (
        (x + np.nan_to_num(flow[..., 0], nan=-9).astype(np.float32)),
        y + np.nan_to_num(flow[..., 1]).astype(np.float32),
    )
    led = cv2.remap(then, *places, cv2.INTER_LINEAR)
    difference = np.abs(led - now).mean(axis=2)
    assert 0.3 < visible.mean() < 1 and np.median(difference[visible]) < 4
    hidden = ~visible & (led.sum(axis=2) > 0) & np.isfinite(flow).all(axis=2)
    assert np.median(difference[hidden]) > 3 * np.median(difference[visible])


def test_moving_things_carry_their_pixels_with_them() -> None:
    moving, still = Truth(SOURCE), Truth(replace(SOURCE, vehicles=0, people=0))
    assert SOURCE.traffic is not None
    static = len(still.source.scene.triangles) // 2
    view = View.of(moving.camera("video"))
    shown = Renderer(SOURCE.traffic.at(T_NS)).faces(view, moving.pose("video", T_NS)) >= static
    flow = moving.flow("video", T_NS, "video", LATER_NS)[0] - still.flow("video", T_NS, "video", LATER_NS)[0]
    assert np.nanmax(np.abs(flow[~cv2.dilate(shown.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)])) < 1e-6
    assert np.nanmedian(np.abs(flow[shown]).max(axis=1)) > 0.5


def test_a_rolling_shutter_has_no_single_pose() -> None:
    with pytest.raises(ValueError, match="rolling shutter"):
        Truth(replace(SOURCE, rolling_ns=1))


# The simulated profiler: each point is on a surface of the place, seen from where the rig was at the point's time.


MOTION = Flight.seeded(3)
EXACT = replace(Profiler(), noise_m=0.0)
START_NS, END_NS = 2_000_000_000, 2_200_000_000


@cache
def scene() -> Scene:
    return build_city(3)


def in_world(points: TimedPoints, profiler: Profiler) -> np.ndarray:
    poses = [MOTION.pose_at(t) @ profiler.rig_from_laser for t in points.times_ns.tolist()]
    return np.array([pose.apply(xyz) for pose, xyz in zip(poses, points.xyz_in_laser, strict=True)])


def nearest_face_m(xyz: np.ndarray) -> np.ndarray:
    """(N,) distance from the nearest face, as rectangles have it."""
    place = scene()
    size = np.stack(place.surfaces.size, axis=1)
    out = []
    for point in xyz:
        u, v, height = np.einsum("fij,fj->if", place.axes, point - place.corner)
        beside = np.maximum(np.maximum(-u, u - size[:, 0]), np.maximum(-v, v - size[:, 1])).clip(0)
        out.append(np.hypot(beside, height).min())
    return np.array(out)


def test_points_are_on_the_surfaces_at_their_own_times() -> None:
    points = EXACT.scan(scene(), MOTION.pose_at, START_NS, END_NS, 3)
    some = points.select(np.arange(0, len(points), 13))
    assert nearest_face_m(in_world(some, EXACT)).max() < 1e-4
    shifted = TimedPoints(some.times_ns + 50_000_000, some.xyz_in_laser)
    assert np.median(nearest_face_m(in_world(shifted, EXACT))) > 1e-3, "their times count"


def test_rate_line_and_reach() -> None:
    points = EXACT.scan(scene(), MOTION.pose_at, START_NS, END_NS, 3)
    assert 0.4 * 6000 < len(points) < 6000  # the sky gives none
    assert (np.diff(points.times_ns) > 33_000).all() and points.times_ns[0] >= START_NS
    assert points.times_ns[-1] < END_NS
    assert (points.xyz_in_laser[:, 2] == 0).all(), "a line across the path"
    assert np.linalg.norm(points.xyz_in_laser, axis=1).max() < EXACT.reach_m


def test_noise_is_of_the_size_stated_and_along_the_beam() -> None:
    exact, noisy = (p.scan(scene(), MOTION.pose_at, START_NS, END_NS, 3) for p in (EXACT, Profiler()))
    assert np.array_equal(exact.times_ns, noisy.times_ns)
    ranges = [np.linalg.norm(p.xyz_in_laser, axis=1) for p in (exact, noisy)]
    assert (ranges[1] - ranges[0]).std() == pytest.approx(Profiler().noise_m, rel=0.1)
    np.testing.assert_allclose(noisy.xyz_in_laser / ranges[1][:, None], exact.xyz_in_laser / ranges[0][:, None])
