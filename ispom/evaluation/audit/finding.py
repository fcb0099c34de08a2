"""A finding of an audit: the claim, its values with their uncertainty, and the errors with and without it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ispom.evaluation.audit.correction import Correction

Measures = Mapping[str, float | None]
"""poses, ate_m, ate_deg, rpe_m, rpe_deg; None where it cannot be computed."""


@dataclass(frozen=True, eq=False)
class Finding:
    key: str
    """offset, time_unit, drift, inverse, rotations-inverse, w-first, w-last, mirrored, axes, lever_arm, scale, frozen,
    repeated, spikes, jumps, no_motion or nothing_in_common."""
    whose: str = "estimate"
    """"estimate" or "reference": which file is wrong, if that is known."""
    values: Mapping[str, float] = field(default_factory=dict)
    """Values by name. Names end in their unit; a value without one has the unit of the trajectory, or none."""
    sigmas: Mapping[str, float] = field(default_factory=dict)
    """Standard deviations, between stretches of the recording."""
    before: Measures = field(default_factory=dict)
    """Errors of the requested comparison, with the corrections of earlier findings."""
    after: Measures = field(default_factory=dict)
    """Errors with the correction as well."""
    stretch_s: float | None = None
    """Length of the stretches that show it best."""
    fall: float | None = None
    """Error of these stretches after over before, where the correction was fitted to the others; of positions times
    that of rotations."""
    own: Correction = field(default_factory=Correction)
    """The correction of this finding."""
    correction: Correction = field(default_factory=Correction)
    """The correction of this finding together with the earlier ones."""
    rivals: tuple[str, ...] = ()
    """Keys of other findings that explain as much: the data do not decide between them."""
    spans_s: tuple[tuple[float, float], ...] = ()
    """First and last times of stretches, on the clock of the reference [s]."""
    rows: tuple[tuple[int, int], ...] = ()
    """First and last poses of these stretches in the file, from 1."""
    parts_m: tuple[float, ...] = ()
    """ATE of each part between jumps, aligned by itself."""
