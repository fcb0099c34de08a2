"""What judge.json holds. Numbers are null where the images show nothing."""

from __future__ import annotations

from math import degrees, isfinite

import msgspec

from ispom.evaluation.judge.hypotheses import Tested
from ispom.evaluation.judge.judgement import StretchMisfit, Verdict
from ispom.evaluation.judge.local import Denied
from ispom.evaluation.judge.shake import Smoothing

from .text import Judged, verdict

UNITS = {"clock": "s", "mount": "rad", "lever": "unit of the poses", "turning": "rad/s", "growing": "1/s"}


class AllPoses(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A hypothesis about all poses, and its test."""

    kind: str
    found: bool
    detectable: bool
    """Whether the motion would show it."""
    size: float | None
    """In `unit`; null for what has no size."""
    sigma: float | None
    unit: str | None
    gains: tuple[float, float]
    """Robust cost that the fit to one half of the pairs saves on the other half."""


class Smoothed(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the poses lack of the images' shake."""

    step: int
    """Frames from the middle one to its neighbours."""
    missing: float
    """Share of the shake's energy."""
    sigma: float
    missing_px: float
    found: bool


class Place(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Frames whose poses the images deny."""

    kind: str
    """motion, scale or rest."""
    first_frame: int
    last_frame: int
    first_s: float
    last_s: float
    size: float
    """motion: largest misfit [standard deviations]; scale: logarithm of the step; rest: displacement [px]."""
    sigma: float
    turn_deg: float
    direction_deg: float
    poses_rest: bool
    within: tuple[int, int] | None
    """Frames that all denied pairs contain."""


class Stretch(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Medians over the pairs that begin in a stretch."""

    first_frame: int
    last_frame: int
    first_s: float
    last_s: float
    pairs: int
    epipolar_px: float | None
    """Distance of tracks from the epipolar lines of the poses, RMS."""
    fitted_px: float | None
    """The same with the relative poses that fit the tracks best."""
    turn_deg: float | None
    turn_sigma_deg: float | None
    direction_deg: float | None
    direction_sigma_deg: float | None
    scale: float | None
    """Factor by which the scale of the poses changes in the stretch."""
    scale_sigma: float | None


class JudgeFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What judge.json holds. Frames are numbers among those of the main camera, times are since its first one."""

    verdict: Verdict
    sentence: str
    poses: str
    recording: str
    frames: int
    frames_with_pose: int
    pairs: int
    all_poses: list[AllPoses]
    smoothing: Smoothed | None
    places: list[Place]
    stretches: list[Stretch]


def written(found: Judged) -> JudgeFile:
    """Returns what judge.json holds."""
    of = found.of
    return JudgeFile(
        of.verdict,
        verdict(found),
        found.poses,
        found.recording,
        len(found.times_ns),
        of.frames,
        of.pairs,
        [_tested(each) for each in of.tested],
        None if of.smoothing is None else _smoothed(of.smoothing),
        [_place(found, each) for each in of.denied],
        [_stretch(found, each) for each in of.stretches],
    )


def _tested(each: Tested) -> AllPoses:
    exact = each.kind in ("axes", "inverse")
    size, sigma = (None, None) if exact else (_finite(each.size), _finite(each.sigma))
    return AllPoses(
        each.kind, bool(each.accepted), bool(each.detectable), size, sigma, UNITS.get(each.kind), each.gains
    )


def _smoothed(found: Smoothing) -> Smoothed:
    return Smoothed(found.step, found.missing, found.sigma, found.missing_px, bool(found.found))


def _place(found: Judged, each: Denied) -> Place:
    turn_deg, direction_deg = degrees(each.turn_rad), degrees(each.direction_rad)
    return Place(
        each.kind, *_span(found, each.first, each.last), each.size, each.sigma, turn_deg, direction_deg,
        each.poses_rest, each.within,
    )  # fmt: skip


def _stretch(found: Judged, each: StretchMisfit) -> Stretch:
    values = (
        each.epipolar_px, each.fitted_px, each.turn_deg, each.turn_sigma_deg, each.direction_deg,
        each.direction_sigma_deg, each.scale, each.scale_sigma,
    )  # fmt: skip
    return Stretch(*_span(found, each.first, each.last), each.pairs, *map(_finite, values))


def _span(found: Judged, first: int, last: int) -> tuple[int, int, float, float]:
    return first, last, found.second(first), found.second(last)


def _finite(value: float) -> float | None:
    return value if isfinite(value) else None
