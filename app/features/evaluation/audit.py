"""The audit of an evaluation: what is asked of it, and its findings as sentences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ispom.evaluation.audit.correction import Correction
from ispom.evaluation.audit.finding import Finding
from ispom.evaluation.audit.unit import unit_name
from ispom.evaluation.trajectory_error import Alignment
from ispom.geometry import Array, rotation_angle_rad, so3_log

from ...presentation.texts import angle, digits, length

LISTED = 3
"""Largest number of stretches that a sentence lists."""
CUBE_DEG = 6.0
"""Largest angle from a turn of a cube onto itself that is called by its name."""
KNOWN_AXES: tuple[tuple[str, Array], ...] = (
    ("x right, y up, z backwards (OpenGL) instead of x right, y down, z ahead, or the reverse", np.diag([1.0, -1, -1])),
    (
        "x ahead, y left, z up in the estimate, and x right, y down, z ahead in the reference",
        np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]),
    ),
    (
        "x right, y down, z ahead in the estimate, and x ahead, y left, z up in the reference",
        np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]),
    ),
)
"""Rotations (3, 3) estimate_body_from_reference_body between axes that programs use, in words."""
CLAIMS: Mapping[str, str] = {
    "inverse": "the inverse poses of the {whose} fit: it holds body_from_world",
    "rotations-inverse": "the inverse rotations of the {whose} fit: its rotations are body_from_world",
    "w-first": "the quaternions of the {whose} fit with w first: they were read with w last",
    "w-last": "the quaternions of the {whose} fit with w last: they were read with w first",
    "mirrored": "the mirrored path fits: one of both files has left-handed axes, or mirrored images were used",
    "frozen": "the {whose} repeats one pose while the other one moves",
    "repeated": "the {whose} has a stretch that is a copy of an earlier one",
    "spikes": "single poses of the {whose} are far off",
    "jumps": "the {whose} jumps, and goes on from another place",
    "no_motion": "the {whose} does not move, and the other one does: no alignment, scale or offset can be fitted",
    "nothing_in_common": "the positions of both have nothing in common, and the audit cannot tell why",
}
"""What each finding says."""


@dataclass(frozen=True, eq=False)
class Audit:
    """The findings about one estimate, with the options that were given."""

    name: str
    findings: tuple[Finding, ...]
    given: Correction
    alignment: Alignment
    timed: bool

    @property
    def sentences(self) -> list[str]:
        if not self.findings:
            return [f"audit of {self.name}: no wrong question found"]
        return [f"audit of {self.name}: {self.sentence(finding)}" for finding in self.findings]

    def sentence(self, finding: Finding) -> str:
        parts = [_claim(finding, self.timed)]
        if finding.spans_s:
            parts[0] += f" at {_places(finding, self.timed)}"
        if change := _change(finding):
            parts.append(change)
        if finding.rivals:
            parts.append(f"cannot tell it from {' or '.join(finding.rivals)}, which fits as well")
        if words := self.option(finding):
            parts.append(f"corrected by {words}")
        return "; ".join(parts)

    def option(self, finding: Finding) -> str:
        """Returns the options that correct a finding, with those that were given before; "" where none does."""
        known = self.given if finding.own.offset_s or finding.own.clock_rate != 1 else Correction()
        return option_words(known.then(finding.own), self.alignment)


def option_words(correction: Correction, alignment: Alignment) -> str:
    """Returns a correction as options of `ispom evaluate`."""
    words = []
    if correction.offset_s:
        words.append(f"--offset {_rounded(correction.offset_s, 4)}")
    if correction.clock_rate != 1.0:
        words.append(f"--clock-rate {correction.clock_rate:.9g}")
    if correction.max_difference_s is not None:
        words.append(f"--max-difference-s {correction.max_difference_s:g}")
    if correction.conventions:
        words.append(f"--conventions {' '.join(correction.conventions)}")
    if correction.reference_conventions:
        words.append(f"--reference-conventions {' '.join(correction.reference_conventions)}")
    if correction.body is not None:
        words.append("--body auto")
    if correction.with_scale:
        words.append(f"--alignment {'scale' if alignment in ('none', 'first') else 'sim3'}")
    if correction.excluded_s:
        words.append("--exclude " + " ".join(f"{_rounded(a, 6)}:{_rounded(b, 6)}" for a, b in correction.excluded_s))
    return " ".join(words)


def _rounded(value: float, places: int) -> str:
    return f"{value:.{places}f}".rstrip("0").rstrip(".")


def _claim(finding: Finding, timed: bool) -> str:
    values, sigmas = finding.values, finding.sigmas
    match finding.key:
        case "offset" if timed:
            late = "late" if values["offset_s"] < 0 else "early"
            return f"its clock is {abs(values['offset_s']):.3f} s {late} (1 sigma {sigmas['offset_s']:.3f} s)"
        case "offset":
            return f"its rows are shifted by {-values['offset_s']:+.0f} against those of the reference"
        case "time_unit":
            return f"its times are in another unit: a second of it is {values['clock_rate']:g} s of the reference"
        case "drift":
            ppm, sigma = 1e6 * (values["clock_rate"] - 1), 1e6 * sigmas["clock_rate"]
            return f"its clock is {'slow' if ppm > 0 else 'fast'} by {abs(ppm):.0f} ppm (1 sigma {sigma:.0f} ppm)"
        case "axes":
            assert finding.own.body is not None
            return _axes(finding.own.body.rotation, sigmas["turn_deg"])
        case "lever_arm":
            arm = ", ".join(f"{values[f'lever_{axis}']:.3f}" for axis in "xyz")
            spread = ", ".join(f"{sigmas[f'lever_{axis}']:.3f}" for axis in "xyz")
            return (
                f"both are of different points of one rig: {values['lever']:.3f} apart, at ({arm}) in the estimate's "
                f"body (1 sigma {spread})"
            )
        case "scale":
            unit = unit_name(values["scale"])
            named = f" (it is in {unit})" if unit else ""
            return (
                f"only the scale differs: one unit of it is {digits(values['scale'])} of the reference{named} "
                f"(1 sigma {digits(100 * sigmas['scale'] / values['scale'])} %)"
            )
    return CLAIMS[finding.key].format(whose=finding.whose)


def _axes(turn: Array, sigma_deg: float) -> str:
    angle = float(np.degrees(rotation_angle_rad(turn)))
    vector = so3_log(turn)
    direction = ", ".join(f"{x:.2f}" for x in vector / max(float(np.linalg.norm(vector)), 1e-12))
    words = (
        f"its body has other axes: a constant turn of {angle:.1f} deg about ({direction}) (1 sigma {sigma_deg:.1f} deg)"
    )
    for name, known in KNOWN_AXES:
        if np.degrees(rotation_angle_rad(known.T @ turn)) <= CUBE_DEG:
            return f"{words}, as between {name}"
    whole = np.rint(turn)
    cube = abs(np.linalg.det(whole) - 1) < 1e-9 and np.allclose(whole @ whole.T, np.eye(3))
    return (
        f"{words}, a turn by right angles"
        if cube and np.degrees(rotation_angle_rad(whole.T @ turn)) <= CUBE_DEG
        else words
    )


def _places(finding: Finding, timed: bool) -> str:
    """Times of the reference's clock, and the poses of the file."""
    words = []
    for i, (first, last) in enumerate(finding.spans_s[:LISTED]):
        unit = " s" if timed else ""
        time = _rounded(first, 3) if first == last else f"{_rounded(first, 3)} to {_rounded(last, 3)}"
        place = f"{time}{unit}" if timed else f"row {time}"
        if i < len(finding.rows):
            a, b = finding.rows[i]
            place += f" ({f'pose {a}' if a == b else f'poses {a} to {b}'} of the file)"
        words.append(place)
    more = len(finding.spans_s) - LISTED
    return ", ".join(words) + (f" and {more} more" if more > 0 else "")


CHANGED = 0.95
"""Largest ratio of an error after to before that is worth a word."""
SHOWN: tuple[tuple[str, str, bool], ...] = (
    ("ate_m", "ATE", True),
    ("ate_deg", "rotation of ATE", False),
    ("rpe_m", "RPE", True),
    ("rpe_deg", "rotation of RPE", False),
)


def _change(finding: Finding) -> str:
    """Which errors become smaller, and from what to what."""
    before, after = finding.before, finding.after
    if finding.key == "jumps":
        parts = ", ".join(length(part) for part in finding.parts_m)
        return f"ATE is {length(before['ate_m'] or 0.0)}, and {parts} in the parts, each aligned by itself"
    if finding.key in ("no_motion", "nothing_in_common"):
        return ""
    changes = []
    for key, name, metres in SHOWN:
        a, b = before.get(key), after.get(key)
        if b is None or (a is not None and b > CHANGED * a):
            continue
        shown = [x if x is None else length(x) if metres else angle(x) for x in (a, b)]
        changes.append(f"{name} {shown[1]} instead of {shown[0]}" if a is not None else f"{name} {shown[1]}")
    if not changes and finding.fall is not None:
        stretch = f"stretches of {digits(finding.stretch_s)} s" if finding.stretch_s else "short stretches"
        if finding.key == "lever_arm":
            stretch = "turns"
        changes.append(f"the errors in {stretch} fall to {100 * finding.fall:.0f} %, those of the whole path do not")
    return ", ".join(changes)


def odd_one(names: Sequence[str], found: Mapping[tuple[int, int], Sequence[Finding]]) -> str:
    """Returns a sentence about the trajectory that disagrees with all others, which agree; "" where none does.

    `found` has the findings of each pair of at least three trajectories.
    """
    wrong = {pair for pair, findings in found.items() if findings}
    for i, name in enumerate(names):
        with_it = {pair for pair in found if i in pair}
        if wrong and wrong == with_it:
            keys = sorted({findings[0].key for pair, findings in found.items() if pair in with_it})
            return (
                f"audit of all: {name} is the odd one out of {len(names)}: all pairs with it have a finding "
                f"({', '.join(keys)}), and no pair without it has one"
            )
    if len(wrong) == len(found):
        return f"audit of all: cannot tell which of the {len(names)} trajectories is wrong: all pairs have findings"
    return ""
