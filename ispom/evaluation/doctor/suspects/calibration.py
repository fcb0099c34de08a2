"""Suspects of the calibration and the clock: each frees a few numbers, and held-out tracks say what that explains."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from ispom.types import Rig

from ..counterfactual import Outcome, tested
from ..examination import Examination
from ..finding import Finding, Suspect
from ..hypothesis import Change

GAIN = 0.05
"""Share of the cost of the held-out tracks that a cause explains at least; healthy recordings reach three quarters of
it, with changes too small to matter."""
BASELINE_GAIN = 0.025
"""The same for the baseline: it shows only by the video camera's distance from the pair, in a few near tracks."""
SURE = 2.5
"""Mean improvement of a held-out track over its standard error, at least."""
PROMISE = 0.015
"""A change that promises less by the linearisation is not tested."""
BASELINE_PROMISE = 0.004
"""The same for the baseline: with it all depths change, which one linearised step hardly does. Healthy recordings
promise half of it."""
PARSIMONY = 0.01
"""Of causes that explain the same, one with fewer numbers is preferred: each further number costs this share."""
UNMODELLED = 3.0
"""Errors of tracks are alike from frame to frame, and the motion between two poses is not quite even: numbers are known
worse by this factor than by independent errors."""
LEAST_TRACKS = 25
"""Fewer held-out tracks say nothing."""


def freed(
    names: tuple[str, ...],
    least: tuple[float, ...],
    possible: Callable[[Rig], bool],
    limits: tuple[float, float],
    seen: Examination,
) -> Finding | None:
    """Frees these numbers. A change smaller than `least` in all of them explains nothing that matters; the limits are
    those of gain and promise. Where the tracks know all of them worse than `least`, they say nothing."""
    least_gain, least_promise = limits
    if not possible(seen.rig) or (base := seen.baseline) is None:
        return None
    promise = seen.promises[names]
    if promise.gain < least_promise:
        if all(UNMODELLED * sigma > limit for sigma, limit in zip(promise.sigmas, least, strict=True)):
            return None
        text = f"Freeing it promises to explain {100 * max(promise.gain, 0):.1f} % of the error, too little for a test."
        return Finding(max(0.0, min(0.9, promise.gain / least_gain)), text, {"promise": promise.gain})
    outcome = tested(base, names)
    if outcome.tracks < LEAST_TRACKS:
        return None
    values = {name: value(outcome.change, name) for name in names}
    matters = any(abs(v) >= limit for v, limit in zip(values.values(), least, strict=True))
    strength = (1 - PARSIMONY * (len(names) - 1)) * outcome.gain / least_gain
    if not matters or outcome.z < SURE:
        strength = min(strength, 0.9)
    return Finding(max(strength, 0.0), sentence(base.residual_px, outcome, values), {
        "gain": outcome.gain, "z": outcome.z, "before_px": base.residual_px, "after_px": outcome.residual_px, **values,
    })  # fmt: skip


def value(change: Change, name: str) -> float:
    """Returns one number of a change."""
    return float(getattr(change, name) if hasattr(change, name) else getattr(change.perturbation, name))


def sentence(before_px: float, outcome: Outcome, values: dict[str, float]) -> str:
    """Returns what the held-out tracks say."""
    changes = ", ".join(f"{name.replace('_', ' ')} {v:+.3g}" for name, v in values.items())
    return (
        f"With {changes}, {outcome.tracks} tracks that had no part in the fit cost {100 * outcome.gain:.0f} % less "
        f"({outcome.z:.0f} standard errors); their median error goes from {before_px:.2f} to "
        f"{outcome.residual_px:.2f} px."
    )


def _video(rig: Rig) -> bool:
    return rig.video is not None


def _pair(rig: Rig) -> bool:
    return rig.has_stereo


def _both(rig: Rig) -> bool:
    return _video(rig) and _pair(rig)


def _any(rig: Rig) -> bool:
    return True


_FREED: list[tuple[tuple[str, ...], Callable[[Rig], bool]]] = []


def _suspect(
    key: str,
    name: str,
    remedy: str,
    possible: Callable[[Rig], bool],
    limits: tuple[float, float] = (GAIN, PROMISE),
    **least: float,
) -> Suspect:
    _FREED.append((tuple(least), possible))
    examine = partial(freed, tuple(least), tuple(least.values()), possible, limits)
    return Suspect(key, name, "counterfactual", remedy, examine)


RECALIBRATE = "Calibrate again with a target (`ispom calibrate`), with the lens as it is when filming."
MOUNT = "Find it again: `ispom calibrate rig RECORDING --from-motion`, or with a target."
CALIBRATION = (
    _suspect(
        "clock",
        "the clocks of the video camera and the pair differ",
        "Correct the time stamps by the stated delay, or run with `--integrated.estimate-clock`.",
        _both,
        clock_ms=2.0,
    ),
    _suspect(
        "video-focal",
        "the focal length of the video camera is wrong",
        f"{RECALIBRATE} A zoom, a crop or a resized video changes it, too.",
        _video,
        video_focal_percent=0.3,
    ),
    _suspect(
        "video-centre",
        "the principal point of the video camera is wrong",
        f"{RECALIBRATE} A cropped or stabilised video changes it, too.",
        _video,
        video_centre_x_px=0.8,
        video_centre_y_px=0.8,
    ),
    _suspect("distortion", "the distortion of the lens is wrong", RECALIBRATE, _any, k1=0.01),
    _suspect(
        "rolling-shutter",
        "the line delay of the rolling shutter is wrong",
        "State the line delay in the calibration, or use a camera with a global shutter; turn the camera more slowly.",
        _any,
        line_delay_us=4.0,
    ),
    _suspect("pair-focal", "the focal length of the pair is wrong", RECALIBRATE, _pair, pair_focal_percent=0.3),
    _suspect(
        "pair-centre",
        "the principal point of the pair is wrong",
        RECALIBRATE,
        _pair,
        pair_centre_x_px=0.8,
        pair_centre_y_px=0.8,
    ),
    _suspect(
        "baseline",
        "the baseline of the pair is wrong",
        "Measure the distance of the two cameras again, or calibrate the pair with a target of known size.",
        _both,
        (BASELINE_GAIN, BASELINE_PROMISE),
        baseline_percent=10.0,
    ),
    _suspect(
        "pair-turned",
        "the right camera has turned since the pair was calibrated",
        "Fasten the cameras to each other, and calibrate the pair again.",
        _pair,
        right_x_deg=0.02,
        right_y_deg=0.02,
        right_z_deg=0.05,
    ),
    _suspect(
        "mount-turned",
        "the orientation of the video camera on the rig is wrong",
        MOUNT,
        _both,
        turn_x_deg=0.1,
        turn_y_deg=0.1,
        turn_z_deg=0.1,
    ),
    _suspect(
        "mount-shifted",
        "the position of the video camera on the rig is wrong",
        MOUNT,
        _both,
        shift_x_m=0.02,
        shift_y_m=0.02,
        shift_z_m=0.02,
    ),
)


def subsets(rig: Rig) -> tuple[tuple[str, ...], ...]:
    """Returns the sets of numbers that this rig has."""
    return tuple(names for names, possible in _FREED if possible(rig))
