"""Suspects of the calibration and the clock: each frees a few numbers, and held-out tracks judge them.

A number is a cause if held-out tracks fit better with it, its interval excludes zero, and it is plausible. The interval
includes the uncertainty by the normal equations (each track as one measurement), the difference of two halves of the
tracks, and the change of the number if the others of its group are free, too. For example, many numbers can explain a
lens that fits badly in a corner; then none of them is determined.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

from ..counterfactual import Crossed, Figure, crossed, figures_of
from ..examination import Examination
from ..finding import Finding, Suspect
from ..groups import group_of, has

GAIN = 0.05
"""Least share of the cost of the held-out tracks that a cause explains. Healthy recordings reach three quarters of it,
with changes too small to matter."""
BASELINE_GAIN = 0.025
"""The same for the baseline, which shows only in a few near tracks, by the video camera's distance from the pair."""
SURE = 2.5
"""Least mean improvement of a held-out track, in standard errors, and least change of a number, in standard
deviations."""
PROMISE = 0.015
"""A change that promises less by the linearisation is not tested."""
BASELINE_PROMISE = 0.004
"""The same for the baseline: it changes all depths, which one linearised step hardly does. Healthy recordings promise
half of it."""
PARSIMONY = 0.01
"""Share of the cost that each further number must explain: of causes that explain the same, one with fewer numbers is
preferred."""
MAJORITY = 4.0
"""Least number of tracks that fit better minus those that fit worse, in standard errors: 8 and more for simulated
faults, 1 by chance."""
LEAST_TRACKS = 50
"""Least number of held-out tracks for a finding."""
WEAK = 0.9
"""Most that the strength is where something speaks against the cause."""


@dataclass(frozen=True)
class Number:
    """The words and the unit of a number of the calibration, and how much it can change."""

    words: str
    unit: str
    most: float
    """A larger change is no change of this kind."""


NUMBERS: Mapping[str, Number] = {
    # Stabilisation and crops keep three quarters of an image; an image of another size is refused when it is opened.
    "video_focal_percent": Number("focal length of the video camera", "%", 25),
    "pair_focal_percent": Number("focal length of the pair", "%", 25),
    # A crop to one side by an eighth of 640 px.
    "video_centre_x_px": Number("principal point of the video camera, x", "px", 80),
    "video_centre_y_px": Number("principal point of the video camera, y", "px", 80),
    "pair_centre_x_px": Number("principal point of the pair, x", "px", 80),
    "pair_centre_y_px": Number("principal point of the pair, y", "px", 80),
    # Wide lenses have -0.3 to -0.4, and the distortion may be missing.
    "k1": Number("distortion k1", "", 0.5),
    "k2": Number("distortion k2", "", 0.5),
    # 4:3 images squeezed into 16:9, and pixels of anamorphic films, twice as wide as high.
    "aspect_percent": Number("fy over fx", "%", 100),
    # 100 us over 480 rows are 48 ms, longer than a frame lasts.
    "line_delay_us": Number("line delay, for 480 rows,", "us", 100),
    # Measured between other edges of the cameras; a unit that is mixed up is another cause.
    "baseline_percent": Number("baseline", "%", 50),
    # Where the cameras look elsewhere, no corner is found in both.
    "right_x_deg": Number("turn of the right camera about x", "deg", 5),
    "right_y_deg": Number("turn of the right camera about y", "deg", 5),
    "right_z_deg": Number("turn of the right camera about z", "deg", 5),
    "turn_x_deg": Number("turn of the mount about x", "deg", 10),
    "turn_y_deg": Number("turn of the mount about y", "deg", 10),
    "turn_z_deg": Number("turn of the mount about z", "deg", 10),
    # Farther than a rig is wide, most often.
    "shift_x_m": Number("shift of the mount along x", "m", 0.5),
    "shift_y_m": Number("shift of the mount along y", "m", 0.5),
    "shift_z_m": Number("shift of the mount along z", "m", 0.5),
    # Several frames: a later start is another cause.
    "clock_ms": Number("clock of the video camera", "ms", 300),
}


@dataclass(frozen=True)
class Limits:
    """Sizes from which on a change counts."""

    gain: float = GAIN
    promise: float = PROMISE


def freed(key: str, least: Mapping[str, float], limits: Limits, seen: Examination) -> Finding | None:
    """Frees these numbers. A change smaller than `least` in all of them explains nothing that matters. Where the tracks
    determine none of them within its `least`, and nothing is explained, there is no finding."""
    names = tuple(least)
    if not has(seen.rig, names[0]) or seen.baseline is None:
        return None
    promise = seen.promises[names]
    unknown = all(SURE * sigma >= limit for sigma, limit in zip(promise.sigmas, least.values(), strict=True))
    if promise.gain < limits.promise:
        if unknown:
            return None
        text = f"Freeing it promises to explain {100 * max(promise.gain, 0):.1f} % of the error, too little for a test."
        return Finding(max(0.0, min(WEAK, promise.gain / limits.gain)), text, {"promise": promise.gain})
    outcome = seen.outcomes[key] = crossed(seen.halves, names)
    if outcome.tracks < LEAST_TRACKS:
        return None
    explains = (1 - PARSIMONY * (len(names) - 1)) * outcome.gain / limits.gain
    if explains < 1 and unknown:
        return None
    figures, against, undecided = outcome.figures, "", ""
    if not any(abs(figures[name].value) >= limit for name, limit in least.items()):
        against = "a change too small to matter"
    elif outcome.z < SURE or outcome.majority < MAJORITY:
        against = "a few tracks only say so"
    elif explains >= 1:
        others = group_of(names, seen.rig)
        group = figures if others == names else figures_of(seen.halves, others, outcome)
        figures = {name: _honest(figure, group[name], least[name]) for name, figure in figures.items()}
        against, undecided = _doubts(figures, group, least)
    strength = max(0.0, min(explains, WEAK) if against else explains)
    figures = {name: recorded(name, figure, seen) for name, figure in figures.items()}
    text = sentence(outcome, figures) + (f" This is no cause: {against}." if against and explains >= 1 else "")
    return Finding(
        strength,
        text,
        {
            "gain": outcome.gain, "z": outcome.z, "before_px": outcome.before_px, "after_px": outcome.residual_px,
            **{name: figure.value for name, figure in figures.items()},
            **{f"{name}_sigma": figure.sigma for name, figure in figures.items()},
        },
        undecided=undecided,
    )  # fmt: skip


def _honest(alone: Figure, with_others: Figure, least: float) -> Figure:
    """Returns the number alone, as uncertain as it is with the others free, and as far as it moves then. Half of the
    least change that matters is added: the scene, such as its motion between two poses, is no better than that."""
    sigma = max(alone.sigma, with_others.sigma, abs(alone.value - with_others.value))
    return Figure(alone.value, math.hypot(sigma, least / 2))


def _doubts(figures: Mapping[str, Figure], group: Mapping[str, Figure], least: Mapping[str, float]) -> tuple[str, str]:
    """Returns the evidence against the numbers as a cause. If there is none, but they are not determined, the second
    text says what would decide it. Both are empty if the numbers are a cause."""
    if any(abs(figure.value) > NUMBERS[name].most for name, figure in figures.items()):
        return "so large a change is not plausible", ""
    large = {name: figures[name] for name, limit in least.items() if abs(figures[name].value) >= limit}
    if any(abs(figure.value) > SURE * figure.sigma for figure in large.values()):
        return "", ""
    if all(abs(figure.value - group[name].value) > SURE * group[name].sigma for name, figure in large.items()):
        return "with the other numbers of the calibration free, too, this one does not stay", ""
    return "", "More motion, and turns, near and far points, would decide it, or a calibration with a target."


def recorded(name: str, figure: Figure, seen: Examination) -> Figure:
    """Returns a number in pixels of the recording, of one in pixels of the examined images; others as they are."""
    if not name.endswith("_px"):
        return figure
    camera = "left" if name.startswith("pair") else "video"
    return Figure(seen.recorded_px(camera, figure.value), seen.recorded_px(camera, figure.sigma))


def with_uncertainty(name: str, figure: Figure) -> str:
    """Returns a number with its uncertainty, such as "focal length of the video camera -2.9 % (+-0.4)"."""
    number = NUMBERS[name]
    unit = f" {number.unit}" if number.unit else ""
    return f"{number.words} {figure.value:+.3g}{unit} (+-{figure.sigma:.2g})"


def sentence(outcome: Crossed, figures: Mapping[str, Figure]) -> str:
    """Returns a sentence about the held-out tracks with and without the changes."""
    changes = ", ".join(with_uncertainty(name, figure) for name, figure in figures.items())
    return (
        f"With {changes}, {outcome.tracks} tracks that had no part in the fit cost {100 * outcome.gain:.0f} % less "
        f"({outcome.z:.0f} standard errors); their median error goes from {outcome.before_px:.2f} to "
        f"{outcome.residual_px:.2f} px."
    )


def _suspect(
    key: str,
    name: str,
    remedy: str,
    limits: Limits = Limits(),
    **least: float,
) -> Suspect:
    examine = partial(freed, key, least, limits)
    return Suspect(key, name, "counterfactual", remedy, examine)


RECALIBRATE = "Calibrate again with a target (`ispom calibrate`), with the lens as it is when filming."
MOUNT = "Find it again: `ispom calibrate rig RECORDING --from-motion`, or with a target."
CALIBRATION = (
    _suspect(
        "clock",
        "the clocks of the video camera and the pair differ",
        "Correct the time stamps by the stated delay, or run with `--integrated.estimate-clock`.",
        clock_ms=2.0,
    ),
    _suspect(
        "video-focal",
        "the focal length of the video camera is wrong",
        f"{RECALIBRATE} A zoom, a crop or a resized video changes it, too.",
        video_focal_percent=0.3,
    ),
    _suspect(
        "video-centre",
        "the principal point of the video camera is wrong",
        f"{RECALIBRATE} A cropped or stabilised video changes it, too.",
        video_centre_x_px=0.8,
        video_centre_y_px=0.8,
    ),
    _suspect(
        "aspect",
        "fx and fy do not fit each other, as of squeezed images",
        "Give the images in the shape that the camera took, or correct fy by the stated share, or calibrate again.",
        aspect_percent=1.0,
    ),
    _suspect("distortion", "the distortion of the lens is wrong", RECALIBRATE, k1=0.01),
    _suspect(
        "rolling-shutter",
        "the line delay of the rolling shutter is wrong",
        "State the line delay in the calibration, or use a camera with a global shutter; turn the camera more slowly.",
        line_delay_us=4.0,
    ),
    _suspect("pair-focal", "the focal length of the pair is wrong", RECALIBRATE, pair_focal_percent=0.3),
    _suspect(
        "pair-centre",
        "the principal point of the pair is wrong",
        RECALIBRATE,
        pair_centre_x_px=0.8,
        pair_centre_y_px=0.8,
    ),
    _suspect(
        "baseline",
        "the baseline of the pair is wrong",
        "Measure the distance of the two cameras again, or calibrate the pair with a target of known size.",
        Limits(BASELINE_GAIN, BASELINE_PROMISE),
        baseline_percent=10.0,
    ),
    _suspect(
        "pair-turned",
        "the right camera has turned since the pair was calibrated",
        "Fasten the cameras to each other, and calibrate the pair again.",
        right_x_deg=0.02,
        right_y_deg=0.02,
        right_z_deg=0.05,
    ),
    _suspect(
        "mount-turned",
        "the orientation of the video camera on the rig is wrong",
        MOUNT,
        turn_x_deg=0.1,
        turn_y_deg=0.1,
        turn_z_deg=0.1,
    ),
    _suspect(
        "mount-shifted",
        "the position of the video camera on the rig is wrong",
        MOUNT,
        shift_x_m=0.02,
        shift_y_m=0.02,
        shift_z_m=0.02,
    ),
)
