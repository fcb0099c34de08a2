"""A judgement in words."""

from __future__ import annotations

from dataclasses import dataclass
from math import degrees, exp, isfinite

import numpy as np
from numpy.typing import NDArray

from ispom.errors import printable
from ispom.evaluation.judge.hypotheses import Tested
from ispom.evaluation.judge.judgement import Judgement
from ispom.evaluation.judge.local import Denied
from ispom.evaluation.judge.shake import Smoothing

NAMES = {
    "clock": "clock offset",
    "mount": "turn of the camera against the frame of the poses",
    "lever": "distance of the camera from the origin of that frame",
    "axes": "exchanged axes",
    "inverse": "camera_from_world instead of world_from_camera",
    "turning": "drift of the turn",
    "growing": "drift of the scale",
}
HEAD = "stretch [s]      pairs  epipolar [px] (best)  turn [deg] (sigma)  direction [deg] (sigma)  scale (sigma)"


@dataclass(frozen=True, eq=False)
class Judged:
    """A judgement with the names of what was judged."""

    of: Judgement
    times_ns: NDArray[np.int64]
    """(F,) of the frames of the main camera."""
    poses: str
    recording: str

    def second(self, frame: int) -> float:
        """Returns the time of a frame [s] since the first one."""
        return float(self.times_ns[frame] - self.times_ns[0]) * 1e-9


def lines(found: Judged) -> list[str]:
    """Returns the verdict, the findings, and a row for each stretch."""
    text = [verdict(found)]
    text += [f"  {each}" for each in of_all_poses(found)]
    text += [f"  {denied_text(found, each)}" for each in found.of.denied]
    hidden = [NAMES[each.kind] for each in found.of.tested if not each.detectable]
    if hidden:
        text.append(f"  The motion does not show: {'; '.join(hidden)}.")
    if found.of.stretches:
        text.append(HEAD)
    for each in found.of.stretches:
        span = f"{found.second(each.first):.2f} to {found.second(each.last):.2f}"
        text.append(
            f"{span:16s} {each.pairs:5d}  {each.epipolar_px:8.2f} ({each.fitted_px:.2f})       "
            f"{each.turn_deg:7.2f} ({each.turn_sigma_deg:.2f})      "
            f"{_number(each.direction_deg):>7s} ({_number(each.direction_sigma_deg)})           "
            f"{_number(each.scale)} ({_number(each.scale_sigma)})"
        )
    return text


def of_all_poses(found: Judged) -> list[str]:
    """Returns what is wrong with all poses, a line each."""
    smoothed = [_smoothing(found.of.smoothing)] if _is_smoothed(found.of) else []
    return [*(_tested(each) for each in found.of.tested if each.accepted), *smoothed]


def verdict(found: Judged) -> str:
    """Returns the verdict in one line."""
    judgement, count = found.of, len(found.times_ns)
    seen = f"{judgement.pairs} pairs of frames, {judgement.frames} of {count} frames with a pose"
    poses = printable(found.poses)
    if judgement.verdict == "agrees":
        return f"agrees: the images do not contradict {poses} ({seen})"
    if judgement.verdict == "cannot tell":
        return f"cannot tell: the images show too little of the motion to judge {poses} ({seen})"
    accepted = [NAMES[each.kind] for each in judgement.tested if each.accepted]
    accepted += ["smoothing"] if _is_smoothed(judgement) else []
    times = len(judgement.denied)
    places = f"{times} {'place' if times == 1 else 'places'} in time"
    what = ", ".join(accepted + ([places] if times else []))
    return f"contradicted: the images contradict {poses}: {what} ({seen})"


def _tested(each: Tested) -> str:
    return f"All poses: {NAMES[each.kind]}{_size(each)}."


def _size(each: Tested) -> str:
    if each.kind == "clock":
        return f" of {each.size * 1e3:.1f} ms (sigma {each.sigma * 1e3:.1f}); a frame has the pose of that much later"
    if each.kind == "mount":
        return f" of {degrees(each.size):.2f} deg (sigma {degrees(each.sigma):.2f})"
    if each.kind == "lever":
        return f" of {each.size:.3g} (sigma {each.sigma:.2g}) in the unit of the poses"
    if each.kind == "axes":
        return f", which turn the camera by {degrees(each.size):.0f} deg"
    if each.kind == "turning":
        return f" of {degrees(each.size):.2f} deg/s (sigma {degrees(each.sigma):.2f})"
    if each.kind == "growing":  # what is found is the correction
        return f" by {-100 * each.size:+.1f} % in a second (sigma {100 * each.sigma:.1f})"
    return ""


def _is_smoothed(judgement: Judgement) -> bool:
    return judgement.smoothing is not None and judgement.smoothing.found


def _smoothing(found: Smoothing | None) -> str:
    if found is None:
        return ""
    return (
        f"All poses: smoothing. They lack {100 * found.missing:.0f} % (sigma {100 * found.sigma:.0f}) of the shake's "
        f"energy within {2 * found.step} frames: {found.missing_px:.1f} px in the images."
    )


def denied_text(found: Judged, each: Denied) -> str:
    """Returns what is wrong at some time, in one line."""
    span = f"{found.second(each.first):.2f} to {found.second(each.last):.2f} s (frames {each.first} to {each.last})"
    if each.kind == "motion":
        turn, direction = degrees(each.turn_rad), degrees(each.direction_rad)
        return (
            f"{span}: the images deny the motion by up to {each.size:.0f} sigma; there its turn is off by "
            f"{turn:.2f} deg and its direction by {direction:.2f} deg.{_within(each)}"
        )
    if each.kind == "scale":
        factor = exp(each.size)
        return f"{span}: the scale changes by the factor {factor:.2f} (sigma {each.sigma:.2f} of its logarithm)."
    who, other = ("poses", "images") if each.poses_rest else ("images", "poses")
    return f"{span}: the {who} rest while the {other} move."


def _within(each: Denied) -> str:
    return "" if each.within is None else f" All denied pairs contain frames {each.within[0]} to {each.within[1]}."


def _number(value: float) -> str:
    return f"{value:.2f}" if isfinite(value) else "-"
