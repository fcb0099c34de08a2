"""A calibration in words, for the terminal and the report."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np

from ispom.calibration.diagnostics import Parameter
from ispom.calibration.result import Calibration, CameraResult, Clock, LineDelay
from ispom.errors import printable

_UNITS = {"fx": "px", "fy": "px", "cx": "px", "cy": "px", "x": "mm", "y": "mm", "z": "mm"}
_UNITS |= {"roll": "deg", "pitch": "deg", "yaw": "deg"}
_FACTORS = {"mm": 1000.0, "deg": 180 / math.pi}


def printed(found: Calibration) -> str:
    """Lines for the terminal."""
    lines = [f"{found.verdict.level}: {_because(found)}"]
    for each in found.cameras:
        lines += [f"{each.views.name}: {model_words(each)}; {used_words(found, each)}"]
        own = [p for p in found.parameters if p.camera == each.views.name]
        lines += [f"  {parameter_words(p)}" for p in own]
    lines += [f"{fact}" for fact in facts(found)]
    lines += [f"film next: {text}" for text in found.verdict.advice]
    return "".join(f"{printable(line)}\n" for line in lines)


def facts(found: Calibration) -> list[str]:
    """What a pair or rig is judged by first."""
    out = [f"reprojection error: {found.solution.rms_px:.3f} px (root mean square)"]
    if found.baseline_m is not None:
        out.append(f"baseline: {1000 * found.baseline_m:.3f} mm")
    if found.row_error is not None:
        out.append(f"rows of the rectified pair: {found.row_error.rms_px:.3f} px apart (root mean square)")
    if found.clock is not None:
        out.append(clock_words(found.clock))
    if found.line_delay is not None:
        out.append(line_delay_words(found.line_delay))
    if found.halves_pose is not None:
        turn = np.degrees(np.linalg.norm(found.halves_pose.rotvec))
        distance_mm = 1000 * float(np.linalg.norm(found.halves_pose.translation))
        second = found.cameras[1].views.name
        out.append(f"two halves of the views place the {second} camera {distance_mm:.2f} mm and {turn:.3f} deg apart")
    return out


def line_delay_words(delay: LineDelay) -> str:
    """What it means for the result, too."""
    us, error = 1e6 * delay.seconds, 1e6 * delay.standard_error_s
    if not delay.rolls:
        return f"shutter: global, as far as the motion tells (rows {us:.2f} +- {error:.2f} us apart)"
    return (
        f"shutter: rolling, rows {us:.2f} +- {error:.2f} us apart, {1000 * abs(delay.image_s):.1f} ms from the first "
        "row to the last; the corners are corrected for it"
    )


def clock_words(clock: Clock) -> str:
    """Where to write it, too."""
    if not clock.determined:
        return "video's clock: not determined by this motion"
    offset, error = 1000 * clock.offset_s, 1000 * clock.standard_error_s
    return (
        f"video's clock: offset {offset:.3f} +- {error:.3f} ms "
        f"(in sequence.yaml: video: {{..., offset_s: {clock.offset_s:.6f}}})"
    )


def parameter_words(parameter: Parameter) -> str:
    """Such as "fx 458.65 +- 0.12 px"."""
    unit = _UNITS.get(parameter.name, "")
    factor = _FACTORS.get(unit, 1.0)
    value, error = factor * parameter.value, factor * parameter.standard_error
    if not parameter.determined:
        return f"{parameter.name}: not determined by these views"
    digits = max(0, 1 - math.floor(math.log10(error))) if 0 < error < 1e6 else 6
    return f"{parameter.name} {value:.{digits}f} +- {error:.{digits}f} {unit}".rstrip()


def model_words(each: CameraResult) -> str:
    """The chosen model, compared with the others: focal lengths compare within one model only."""
    from ispom.calibration.adjust.lens import model_of

    tried = "; ".join(f"{trial.model} {trial.held_out_px:.3f}, {trial.camera.fx:.1f}" for trial in each.trials)
    return f"model {model_of(each.camera)} (error on views held out, and fx [px]: {tried})"


def used_words(found: Calibration, each: CameraResult) -> str:
    """How many images are used, and why others are not."""
    lost = [r for r in found.rejected if r.camera == each.views.name and r.point is None]
    points = sum(r.camera == each.views.name and r.point is not None for r in found.rejected)
    count = len(each.views.images)
    text = f"{count - len(lost)} of {count} images used"
    reasons = Counter(r.reason for r in lost)
    if reasons:
        text += " (" + ", ".join(f"{n} {reason}" for reason, n in reasons.most_common(4)) + ")"
    return f"{text}, {points} single points rejected" if points else text


def _because(found: Calibration) -> str:
    return "; ".join(found.verdict.reasons) or "nothing to object to"
