"""The contract test of estimators, for this package's methods and everybody else's.

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
from ispom.testing.configs import check_declared, check_other_settings
from ispom.testing.images import check_cameras_alone, check_colour, check_no_texture
from ispom.testing.states import check_bounded, check_finish, check_repeats, check_unchanged, check_values
from ispom.testing.steps import check_steps
from ispom.testing.trial import Trial, walked
from ispom.types import Sequence

__all__ = ["check_camera_model", "check_estimator"]


def check_estimator(method: Method | str, *, settings: Any = None, sequence: Sequence | None = None) -> None:
    """Runs a method as the contract says (`ispom.estimator`), and stops at the first thing that it does not keep.

    `settings` are the method's defaults and `sequence` (its truth unused) a short simulated flight of 40 video frames
    and 14 pairs of 320 x 240 pixels unless given. The tested estimator, and those that the method asks, are built and
    stepped several hundred times, among them on images that show nothing, and with every setting at its limits.
    AssertionError, one sentence: which method, what it does, and at which measurement (of the sequence, from 0).
    """
    trial = Trial.of(registered(method) if isinstance(method, str) else method, settings, sequence)
    check_declared(trial)
    with redirect_stdout(StringIO()) as printed:
        walk = walked(trial.build(), trial.measurements)
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
