"""The town: a closed route through streets that are free, and a scene that is seen from all of it."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.simulation.motions import motion_of
from ispom.simulation.places.town import LAP_M, SPEED_M_S, build_town, on_route
from ispom.simulation.source import Source


def test_the_route_is_as_long_as_it_says_and_comes_back() -> None:
    poses = [on_route(s) for s in np.linspace(0, LAP_M, 3001)]
    places = np.array([p.translation for p in poses])
    steps = np.diff(places, axis=0)
    assert np.linalg.norm(steps, axis=1).sum() == pytest.approx(LAP_M, rel=1e-4)
    np.testing.assert_allclose(poses[0].matrix, poses[-1].matrix, atol=1e-9)
    ahead = np.array([p.rotation[:, 2] for p in poses])[:-1]
    assert (np.einsum("ij,ij->i", ahead, steps) > 0.999 * np.linalg.norm(steps, axis=1)).all()


def test_nothing_stands_in_the_way() -> None:
    """Rays along the route, at three heights and offsets, reach half a metre from everywhere."""
    scene, hit = build_town(0), []
    for along in np.arange(0, LAP_M, 2.0):
        pose = on_route(along)
        for x, y in ((-2.5, -1.0), (0.0, -1.75), (2.5, -2.5)):
            directions = (pose.rotation @ np.array([[0.0], [0.0], [2.5]])).T.astype(np.float32)
            start = pose.apply(np.array([x, y, 0.0]))
            triangle = int(scene.caster.hits(start, directions)[0])
            if triangle >= 0:
                face = triangle >> 1
                normal = scene.axes[face, 2]
                distance = float(normal @ (scene.corner[face] - start) / (normal @ directions[0])) * 2.5
                hit += [(along, x, distance)] if 0 < distance < 3.0 else []
    assert not hit


def test_the_drive_follows_the_route_with_the_flights_sway() -> None:
    motion = motion_of("loop", 2)
    for time_s in np.arange(0, 84, 3.1):
        off = on_route(SPEED_M_S * time_s).inverse() @ motion.pose_at(round(time_s * 1e9))
        assert abs(off.translation[0]) < 2.2 and abs(off.translation[1] + 1.75) < 0.8 and abs(off.translation[2]) < 0.5


@pytest.mark.parametrize("along_m", [0, 60, 119, 300])
def test_every_place_shows_texture(along_m: int) -> None:
    time_ns = round(along_m / SPEED_M_S * 1e9)
    image = Source(0, False, 0.2, "town", "loop").render(time_ns, "video", 1).astype(float)
    blocks = image[:96, :128].reshape(6, 16, 8, 16, 3).std(axis=(1, 3)).max(axis=2)
    assert (blocks > 5).mean() > 0.6


def test_the_same_bytes_for_any_number_of_threads() -> None:
    one, two = (Source(1, False, 0.2, "town", "loop").render(7_000_000_000, "stereo", n) for n in (1, 2))
    assert np.array_equal(one, two)
