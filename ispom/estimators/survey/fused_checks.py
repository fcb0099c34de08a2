"""The checks of `fused`: its pose, the agreement of each sensor with the others, and the contribution of each
sensor."""

from __future__ import annotations

from collections.abc import Iterable

from ispom.sensors.kind import SensorKind
from ispom.types import Check, by_key

MAX_FIT = 2.5
"""RMS residual [standard deviations] from which on a sensor contradicts the others: of three values, 0.01 % of
consistent ones lie beyond it."""
MIN_GAIN = 1.05
"""A sensor contributes where the position would be less certain by this factor without it."""
LOCATED = Check(
    "motion_sources",
    "sensors that measured the motion since the last node",
    "requirement",
    "Located?",
    passes="Tracking: motion since the last node measured by {value} of the sensors (minimum {threshold}).",
    fails="Lost: no sensor measured the motion since the last node ({value}, {threshold} needed).",
    topic="pose",
)
STARTED = Check(
    "start_nodes",
    "nodes until scale and heading are known",
    "finding",
    passes="Started: scale and directions are known after {value} nodes.",
    fails="Waiting: scale and directions are unknown after {value} nodes.",
)
START_WAY = Check(
    "start_way",
    "extent of the fixes before the start",
    "requirement",
    unit="m",
    topic="map",
    passes="The fixes lie {value:.1f} m apart ({threshold:.1f} needed).",
    fails="Waiting: the fixes lie {value:.1f} m apart ({threshold:.1f} needed for scale and heading).",
)
START_FIXES = Check(
    "start_fixes",
    "fixes before the start",
    "requirement",
    topic="map",
    passes="{value} fixes are there ({threshold} needed).",
    fails="Waiting: {value} fixes are there ({threshold} needed for scale and heading).",
)
ALIGNED = Check(
    "gnss_aligned",
    "extent of the fixes by which a pair is aligned with GNSS",
    "finding",
    unit="m",
    topic="map",
    passes="Aligned with GNSS: the fixes lie {value:.1f} m apart ({threshold:.1f} needed).",
    fails="Not aligned with GNSS yet: the fixes lie {value:.1f} m apart ({threshold:.1f} needed); poses are in the "
    "world of the pair.",
)
START_SIGMA = Check(
    "start_sigma",
    "relative standard deviation of the first estimate",
    "requirement",
    relation="<=",
    topic="map",
    passes="The first estimate is known to {value:.0%} (limit {threshold:.0%}).",
    fails="Waiting: the first estimate is uncertain by {value:.0%} (limit {threshold:.0%}).",
)


def misfit_check(sensor: str, label: str) -> Check:
    """Returns the check whether a sensor agrees with the others."""
    return Check(
        f"{sensor}_misfit",
        f"RMS residual of {label}",
        "warning",
        relation="<=",
        unit="sigma",
        passes=f"{label}: residuals of {{value:.2f}} standard deviations agree with the others (limit {{threshold}}).",
        fails=f"Contradiction of {label}: residuals of {{value:.1f}} standard deviations (limit {{threshold}}): check "
        "its pose in the rig, its clock, and its stated noise.",
    )


def gain_check(sensor: str, label: str) -> Check:
    """Returns the check whether a sensor contributes."""
    return Check(
        f"{sensor}_gain",
        f"factor of the position's standard deviation without {label}",
        "finding",
        passes=f"{label}: without them the position would be {{value:.2f}} times less certain.",
        fails=f"{label}: without them the position would be as certain ({{value:.2f}} times less).",
    )


def checks_of(kinds: Iterable[SensorKind]) -> dict[str, Check]:
    """Returns all checks, by key, of a method that uses images and these kinds of sensors."""
    kinds = tuple(kinds)
    own = [check for kind in kinds for check in kind.checks]
    labels = {"visual": "Images", **{kind.name: kind.label for kind in kinds}}
    misfits = [misfit_check(sensor, label) for sensor, label in labels.items()]
    gains = [gain_check(kind.name, kind.label) for kind in kinds]
    return by_key(LOCATED, STARTED, START_FIXES, START_WAY, ALIGNED, START_SIGMA, *own, *misfits, *gains)
