"""Suspects that tracks show, on tracks made for it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np

from ispom.evaluation.doctor.examination import Examination
from ispom.evaluation.doctor.suspects.tracks import on_lens
from ispom.types import Camera, Rig

CAMERA = Camera(320, 240, 250.0, 250.0, 159.5, 119.5)


def seen(step_px: float) -> Examination:
    """Corners that move to the right; those that pass one of some places are lost there."""
    rng = np.random.default_rng(0)
    start = np.column_stack([rng.uniform(-800, 300, 600), rng.uniform(10, 230, 600)])
    uv = start[:, None] + np.arange(24)[:, None] * np.array([step_px, 0.0])
    behind = (np.abs(uv[..., 1] % 60 - 30) < 8) & (uv[..., 0] % 80 < step_px) & (uv[..., 0] > 0)
    gone = np.maximum.accumulate(behind, axis=1) | (uv[..., 0] < 0) | (uv[..., 0] > 319)
    tracked = SimpleNamespace(uv=np.where(gone[..., None], np.nan, uv))
    values = SimpleNamespace(
        rig=Rig.single(CAMERA), main="video", tracked=tracked, main_shots=[SimpleNamespace(index=0)]
    )
    return cast(Examination, values)


def test_corners_lost_again_and_again_at_a_place_are_behind_something() -> None:
    finding = on_lens(seen(5.0))
    assert finding is not None and finding.found


def test_where_all_moves_fast_lost_corners_say_nothing_of_the_lens() -> None:
    assert on_lens(seen(25.0)) is None
