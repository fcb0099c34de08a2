"""The contract test of estimators, for built-in methods and plug-ins.

from ispom.testing import check_estimator
check_estimator("orb")
"""

from __future__ import annotations

from contextlib import redirect_stdout
from io import StringIO
from typing import Any

from ispom.estimator import Method
from ispom.methods import method as registered
from ispom.testing.cameras import check_camera_model
from ispom.testing.inputs import (
    check_cameras_alone,
    check_colour,
    check_declared,
    check_no_texture,
    check_other_settings,
)
from ispom.testing.states import check_bounded, check_finish, check_repeats, check_unchanged, check_values
from ispom.testing.steps import check_steps
from ispom.testing.trial import Trial, walked
from ispom.types import Sequence

__all__ = ["check_camera_model", "check_estimator"]


def check_estimator(method: Method | str, *, settings: Any = None, sequence: Sequence | None = None) -> None:
    """Checks that a method keeps the contract (`ispom.estimator`).

    By default, `settings` are the method's defaults and `sequence` (whose ground truth is unused) is a short simulated
    flight of 40 video frames and 14 pairs of 320 x 240 pixels, or for a method that steps on frames of any cameras 14
    frames of three cameras at once. The estimator, and those that the method depends on, are
    built and stepped several hundred times, also on images without texture and with every setting at its limits.
    Raises AssertionError at the first violation: which method, what it does, and at which frame (from 0).
    """
    trial = Trial.of(registered(method) if isinstance(method, str) else method, settings, sequence)
    check_declared(trial)
    with redirect_stdout(StringIO()) as printed:
        walk = walked(trial.build(), trial.frames)
    trial.require(not printed.getvalue(), "prints on standard output")
    check_unchanged(trial, walk)
    check_steps(trial, walk)
    check_values(trial, walk)
    check_finish(trial, walk)
    check_repeats(trial, walk)
    check_bounded(trial, walk)
    check_no_texture(trial, walk)
    check_colour(trial)
    check_cameras_alone(trial)
    check_other_settings(trial, walk)
    check_unchanged(trial, walk)
