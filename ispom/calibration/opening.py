"""A source as it is run: with notes about images that do not fit its cameras, and with a camera where it has none."""

from __future__ import annotations

from typing import Any

from ispom.features.pair_look import with_look
from ispom.sequences import open_sequence
from ispom.types import Sequence


def open_guessed(source: str, **options: Any) -> Sequence:
    """Returns the sequence of a source, whose camera is a guess where it has no calibration.

    `options` and what is raised as of `open_sequence`.
    """
    sequence = open_sequence(source, **options)
    return sequence if source.startswith("sim:") else with_look(sequence)  # those of a simulation are right


def open_calibrated(source: str, **options: Any) -> Sequence:
    """The same, with that camera estimated from the first images: it takes a while."""
    return with_estimated_camera(open_guessed(source, **options))


def with_estimated_camera(sequence: Sequence) -> Sequence:
    """Returns the sequence with its camera estimated where it is a guess."""
    if sequence.guess is None:
        return sequence
    from ispom.calibration.tracked.self_calibration import self_calibrated

    return self_calibrated(sequence)
