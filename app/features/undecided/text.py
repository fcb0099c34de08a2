"""What is undecided, in words and as a table."""

from __future__ import annotations

from typing import Any

from ispom.errors import printable
from ispom.evaluation.undecided.motions import STEP_SHARE, TURN_DEG
from ispom.evaluation.undecided.stretches import Answer
from ispom.evaluation.undecided.weakest import DECIDED_PX, SCALE, Part

WORDS = {
    SCALE: ("scale", "%"),
    "video_focal_percent": ("focal length", "%"),
    "video_centre_x_px": ("principal point across", " px"),
    "video_centre_y_px": ("principal point down", " px"),
    "pair_focal_percent": ("focal length of the pair", "%"),
    "pair_centre_x_px": ("principal point of the pair across", " px"),
    "pair_centre_y_px": ("principal point of the pair down", " px"),
    "turn_x_deg": ("tilt of the video camera on the rig", " deg"),
    "turn_y_deg": ("pan of the video camera on the rig", " deg"),
    "turn_z_deg": ("roll of the video camera on the rig", " deg"),
    "shift_x_m": ("place of the video camera across", " m"),
    "shift_y_m": ("place of the video camera down", " m"),
    "shift_z_m": ("place of the video camera forwards", " m"),
    "clock_ms": ("clock of the video camera", " ms"),
    "k1": ("distortion k1", ""),
    "k2": ("distortion k2", ""),
    "line_delay_us": ("line delay of the shutter", " us"),
    "aspect_percent": ("ratio of the focal lengths", "%"),
    "right_x_deg": ("tilt of the right camera", " deg"),
    "right_y_deg": ("pan of the right camera", " deg"),
    "right_z_deg": ("roll of the right camera", " deg"),
}
"""Name and unit of each number; `across`, `down` and `forwards` are the axes of the camera, or of the rig."""
CURES = {
    "pan": f"pan by {TURN_DEG:g} degrees",
    "tilt": f"tilt by {TURN_DEG:g} degrees",
    "roll": f"roll by {TURN_DEG:g} degrees",
    "sideways": f"move sideways by {STEP_SHARE:.0%} of the distance",
    "up": f"move up by {STEP_SHARE:.0%} of the distance",
    "forwards": f"move forwards by {STEP_SHARE:.0%} of the distance",
}
DIRECTIONS = ("sideways", "up or down", "forwards or back")
AXES = ("tilted", "panned", "rolled")


def lines(name: str, answers: list[Answer]) -> list[str]:
    """Returns a sentence about all, and a paragraph for each stretch."""
    free = [each for each in answers if each.decided is None or each.decided.weakest_px > DECIDED_PX]
    count = len(answers)
    if not free:
        head = f"{printable(name)}: in all stretches the images decide the calibration to within {DECIDED_PX:g} px."
    else:
        head = f"{printable(name)}: in {len(free)} of {count} stretches the images leave a combination free."
    start_ns = answers[0].first_ns
    return [head, *(line for each in answers for line in _of(each, start_ns))]


def _of(answer: Answer, start_ns: int) -> list[str]:
    span = f"{(answer.first_ns - start_ns) * 1e-9:.2f} to {(answer.last_ns - start_ns) * 1e-9:.2f} s"
    found = answer.decided
    if found is None:
        return [f"{span}: nothing is decided: the tracks are too few, or show no parallax; move sideways."]
    parts = " with ".join(_part(part) for part in found.weakest)
    verdict = "decided" if found.weakest_px <= DECIDED_PX else "free"
    text = [f"{span}: {verdict}; the weakest is {parts}: {found.weakest_px:.2g} px at one sigma. {_motion(answer)}"]
    if answer.best_cure is not None:
        left = answer.cures[answer.best_cure]
        if left < 0.9 * found.weakest_px:
            text.append(f"  To decide it, {CURES[answer.best_cure]}: {left:.2g} px would be left.")
        else:
            text.append("  No short motion would decide it.")
    if SCALE in found.names:
        text.append(f"  Scale: {found.sigma(SCALE):.2g} %, with all of this free and the baseline as stated.")
    return text


def _part(part: Part) -> str:
    name, unit = WORDS[part.name]
    return f"{name} {part.value:+.2g}{unit}"


def _motion(answer: Answer) -> str:
    if answer.moved is None:
        return ""
    moved = answer.moved
    axis, way = (abs(each).argmax() for each in (moved.axis, moved.direction))
    turned = f"The camera {AXES[axis]} by {moved.turned_deg:.1f} degrees"
    return f"{turned}, and went {DIRECTIONS[way]} by {moved.distance:.0%} of the distance of the points."


def table(answers: list[Answer]) -> tuple[list[str], list[list[Any]]]:
    """Returns the head and the rows of undecided.csv."""
    names = list(dict.fromkeys(each for a in answers if a.decided is not None for each in a.decided.names))
    head = ["first_ns", "last_ns", "weakest_px", "weakest", "best_cure", "left_px", *(f"{n}.sigma" for n in names)]
    return head, [_row(each, names) for each in answers]


def _row(answer: Answer, names: list[str]) -> list[Any]:
    found = answer.decided
    if found is None:
        return [answer.first_ns, answer.last_ns, *[None] * (4 + len(names))]
    cure = answer.best_cure
    return [
        answer.first_ns, answer.last_ns, found.weakest_px, " ".join(part.name for part in found.weakest),
        cure, None if cure is None else answer.cures[cure], *(found.sigma(each) for each in names),
    ]  # fmt: skip
