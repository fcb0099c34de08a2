"""Depth, flow and visibility against the images themselves."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from ispom.simulation.rendering.renderer import Renderer, View
from ispom.simulation.source import Source
from ispom.simulation.truth import Truth

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
def test_what_is_in_sight_looks_the_same_where_the_flow_leads(other, other_ns: int) -> None:
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
