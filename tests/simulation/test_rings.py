"""Rings of cameras in the simulated places."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ispom.errors import InputError
from ispom.sequences.formats.simulated import open_simulated, open_words
from ispom.simulation.cameras import RING_RADIUS_M, ring_rig
from ispom.types import Frame


@pytest.mark.parametrize("count", [1, 5, 6, 8])
def test_cameras_look_outwards(count: int) -> None:
    rig = ring_rig(count)
    assert list(rig.cameras) == [f"camera{k}" for k in range(count)] and rig.has("cameras")
    for k, name in enumerate(rig.cameras):
        pose, angle = rig.rig_from(name), 2 * np.pi * k / count
        forward = np.array([np.sin(angle), 0, np.cos(angle)])
        np.testing.assert_allclose(pose.rotation[:, 2], forward, atol=1e-12)
        np.testing.assert_allclose(pose.rotation[:, 1], [0, 1, 0], atol=1e-12)
        np.testing.assert_allclose(pose.translation, RING_RADIUS_M * forward, atol=1e-12)


def test_a_ring_is_rendered(tmp_path: Path) -> None:
    sequence = open_simulated("ring5", cache_dir=tmp_path, duration_s=0.1)
    assert set(sequence.kinds) == {"cameras"} and np.diff(sequence.times_ns).tolist() == [100_000_000]
    frame = sequence[0]
    assert isinstance(frame, Frame) and frame.kind == "cameras"
    assert [image.shape for image in frame.images.values()] == [(240, 320, 3)] * 5
    assert all(image.std() > 10 for image in frame.images.values())
    assert sequence.truth is not None and len(sequence.truth) == 2


def test_a_ring_can_be_in_any_place() -> None:
    sequence = open_words("indoor?cameras=3&duration_s=0.2", 0)
    assert list(sequence.rig.cameras) == ["camera0", "camera1", "camera2"] and len(sequence) == 3
    with pytest.raises(InputError, match="cameras"):
        open_words("city?cameras=40", 0)
