"""A candidate as loops.json has it, and what else that file holds."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Literal

import msgspec
import numpy as np

from ispom.estimators.modern.trials import RULES, RelativePoseFound, Trial, TrialKind
from ispom.geometry import rotation_angle_rad
from ispom.methods import method as registered
from ispom.types import Check, Decision, Sequence

from ...presentation.decisions import sentence

Verdict = Literal["accepted", "refused", "undecided"]
METHODS = {"left": "stereo", "video": "monocular"}
"""The method that compares the images of a camera, by camera."""
KINDS = {"left": "stereo", "video": "video"}
"""The kind of the measurements of a camera, by camera."""
ASKED, PENDING = "loop_asked", ("loop_views", "join_views", "join_scale")
"""The check of what was asked for; and those that a later image may still pass."""


class Rule(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One rule, in the order in which they were applied."""

    key: str
    name: str
    value: float | None
    """Null where it is not finite."""
    relation: str
    threshold: float | None
    """Null where the rule has no limit here."""
    unit: str
    passed: bool
    sentence: str


class RelativePose(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """first_from_then: the later camera in the earlier one, in the unit of the earlier keyframe."""

    translation: tuple[float, float, float]
    rotation_xyzw: tuple[float, float, float, float]
    turn_deg: float
    scale: float
    """The unit of the earlier keyframe per unit of the later one."""
    depth: float | None
    """Median depth of the common points, in that unit."""
    translation_sigma: tuple[float, float, float] | None
    """Standard deviations, along the axes of the later camera; null where no covariance is estimated."""
    turn_sigma_deg: float | None
    """The largest of the three axes."""
    ln_scale_sigma: float | None


class Truth(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the relative pose compares with the ground truth."""

    position_error_m: float
    turn_error_deg: float
    right: bool
    """Within what two loops may differ that agree, and five standard deviations."""
    true_distance_m: float
    """Between both cameras."""


class Candidate(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One image that was, or might have been, recognised as the place of an earlier keyframe: `first` is of the
    keyframe, `then` of the image. A lost frame is tried again later, so that its keyframe may be a later one."""

    kind: TrialKind
    method: str
    camera: str
    first_frame: int
    then_frame: int
    first_ns: int
    then_ns: int
    verdict: Verdict
    as_asked: bool
    """Whether a setting decided, whatever the rules say."""
    decided_by: str
    """Key of the rule that decided."""
    rules: tuple[Rule, ...]
    matches: int
    inliers: int
    pose: RelativePose | None = None
    truth: Truth | None = None
    """Null without ground truth, or without a relative pose."""

    @property
    def pair(self) -> str:
        return f"{self.first_frame}-{self.then_frame}"

    @property
    def decision(self) -> str:
        """The sentence of the rule that decided."""
        return next((rule.sentence for rule in self.rules if rule.key == self.decided_by), "The run ended before.")


class Side(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A run to its end."""

    ate_m: float | None
    """Null without ground truth."""
    closing_distance: float | None
    """How far the final path contradicts the relative pose of the first candidate asked about: distance, in the unit of
    the method's world; null where it has none."""
    closing_turn_deg: float | None
    poses: int
    closed: tuple[str, ...]
    """Loops, joins and relocalisations accepted from there on: FIRST-THEN in frames."""


class WhatIf(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A run as it was, and a fork of it from the frame before, with the opposite decision."""

    pairs: tuple[str, ...]
    method: str
    asked: Literal["refuse", "accept"]
    carried_out: bool
    """False where an accepted candidate has no relative pose: then nothing was closed."""
    from_frame: int
    first_different_frame: int | None
    """Null where all Steps are the same."""
    largest_shift: float
    """Of the final poses, in the unit of the method's world."""
    shift_at_frame: int
    as_it_was: Side
    otherwise: Side
    setting: str
    """The setting of the fork."""


class Court(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What loops.json holds."""

    source: str
    methods: tuple[str, ...]
    frames: int
    counts: dict[str, int]
    """Of candidates, by kind and verdict, as loop.accepted."""
    decided_by: dict[str, int]
    """Number of candidates that each rule decided."""
    what_if: tuple[WhatIf, ...]
    candidates: tuple[Candidate, ...]


def candidate_of(one: Trial, sequence: Sequence) -> Candidate:
    """Returns a trial as it stands."""
    decided = deciding(one)
    checks = checks_of(METHODS[one.camera])
    matches = one.matches
    return Candidate(
        one.kind,
        METHODS[one.camera],
        one.camera,
        frame_of(sequence, one.camera, one.first_ns),
        frame_of(sequence, one.camera, one.then_ns),
        one.first_ns,
        one.then_ns,
        verdict_of(one),
        ASKED in one.rules,
        decided.key if decided is not None else "",
        tuple(_rule(decision, checks.get(decision.key)) for decision in one.rules.values()),
        0 if matches is None else len(matches.inlier),
        0 if matches is None else int(matches.inlier.sum()),
        None if one.pose is None else _pose(one.pose),
    )


def verdict_of(one: Trial) -> Verdict:
    """Accepted, refused by a rule, or waiting for other images."""
    if ASKED in one.rules:
        return "accepted" if one.rules[ASKED].passed else "refused"
    failed = [decision for decision in one.rules.values() if not decision.passed]
    if one.accepted and not failed:
        return "accepted"
    return "undecided" if is_open(one) else "refused"


def is_open(one: Trial) -> bool:
    """Whether other images may still decide."""
    failed = {decision.key for decision in one.rules.values() if not decision.passed}
    return not one.accepted and ASKED not in one.rules and failed <= set(PENDING)


def deciding(one: Trial) -> Decision | None:
    """The rule that decided: what was asked, the first that failed, or the last of all that passed."""
    if ASKED in one.rules:
        return one.rules[ASKED]
    failed = [decision for decision in one.rules.values() if not decision.passed]
    if failed:
        return failed[0]
    return next(reversed(one.rules.values()), None) if one.accepted else None


def frame_of(sequence: Sequence, camera: str, time_ns: int) -> int:
    """The frame of this camera at a time."""
    index = int(np.searchsorted(sequence.times_ns, time_ns))
    while (
        index + 1 < len(sequence)
        and sequence.kinds[index] != KINDS[camera]
        and int(sequence.times_ns[index + 1]) == time_ns
    ):
        index += 1
    return index


def checks_of(name: str) -> Mapping[str, Check]:
    """The checks of a method's Steps, and those of candidates."""
    return {**registered(name).checks, **{rule.key: rule for rule in RULES}}


def _rule(decision: Decision, check: Check | None) -> Rule:
    return Rule(
        decision.key,
        decision.name,
        finite(decision.value),
        decision.relation,
        finite(decision.threshold),
        decision.unit,
        decision.passed,
        sentence(decision, check),
    )


def _pose(found: RelativePoseFound) -> RelativePose:
    moved, covariance = found.first_from_then.pose, found.covariance
    x, y, z = map(float, moved.translation)
    qx, qy, qz, qw = map(float, moved.xyzw)
    sigma = turn = scale = None
    if covariance is not None:
        deviations = np.sqrt(np.diag(covariance))
        # rho is in the unit of the later keyframe.
        a, b, c = map(float, found.first_from_then.scale * deviations[:3])
        sigma, turn, scale = (a, b, c), float(np.degrees(deviations[3:6].max())), float(deviations[6])
    return RelativePose(
        (x, y, z),
        (qx, qy, qz, qw),
        float(np.degrees(rotation_angle_rad(moved.rotation))),
        float(found.first_from_then.scale),
        finite(found.depth),
        sigma,
        turn,
        scale,
    )


def finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
