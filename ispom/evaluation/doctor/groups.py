"""Sets of numbers of the calibration that are free together, and the numbers that may be wrong instead of each."""

from __future__ import annotations

from collections.abc import Mapping

from ispom.types import Rig

LENS = ("k1", "k2")
OF_MAIN = (*LENS, "aspect_percent", "line_delay_us")
"""Numbers of the main camera, which is the video camera, else the pair."""
CENTRE = ("video_centre_x_px", "video_centre_y_px")
PAIR_CENTRE = ("pair_centre_x_px", "pair_centre_y_px")
TURN = ("turn_x_deg", "turn_y_deg", "turn_z_deg")
RIGHT = ("right_x_deg", "right_y_deg", "right_z_deg")
SHIFT = ("shift_x_m", "shift_y_m", "shift_z_m")
MAIN = ("video_focal_percent", *CENTRE, *LENS)
OTHERS: Mapping[tuple[str, ...], tuple[str, ...]] = {
    ("clock_ms",): ("line_delay_us", *TURN),
    ("video_focal_percent",): (*MAIN, *TURN),
    CENTRE: (*MAIN, *TURN),
    ("aspect_percent",): ("video_focal_percent", "pair_focal_percent", *CENTRE, *PAIR_CENTRE, *LENS),
    ("k1",): (*MAIN, *TURN, "pair_focal_percent", *PAIR_CENTRE, *RIGHT),
    ("line_delay_us",): ("clock_ms", *TURN),
    ("pair_focal_percent",): (*PAIR_CENTRE, *RIGHT, *LENS),
    PAIR_CENTRE: ("pair_focal_percent", *RIGHT, *LENS),
    ("baseline_percent",): (),
    RIGHT: ("pair_focal_percent", *PAIR_CENTRE, *LENS),
    TURN: (*SHIFT, *CENTRE, "clock_ms"),
    SHIFT: (*TURN, *CENTRE, "clock_ms"),
}
"""By the numbers of a suspect: the numbers that may be wrong instead. For a camera these are its lens and its
orientation; for a mount, also the camera's centre and clock. The lenses of all cameras are never free together: if all
have the same error, the path of a car looks right. The baseline and a turned mount are too correlated for a fit of
both."""


def has(rig: Rig, name: str) -> bool:
    """Checks whether a number belongs to a camera of this rig, or to both kinds of them."""
    if name in OF_MAIN:
        return True
    if name.startswith("video"):
        return rig.video is not None
    return rig.has_stereo and (rig.video is not None or name.startswith(("pair", "right")))


def group_of(names: tuple[str, ...], rig: Rig) -> tuple[str, ...]:
    """Returns these numbers and those that may be wrong instead, as far as the rig has them."""

    def is_free(name: str) -> bool:
        if rig.video is not None and name in OF_MAIN and names[0].startswith(("pair", "right")):
            return False  # of another camera
        if rig.video is not None and name.startswith(("pair", "right")) and names == ("k1",):
            return False
        return has(rig, name)

    return tuple(dict.fromkeys((*names, *(name for name in OTHERS[names] if is_free(name)))))


def subsets(rig: Rig) -> dict[tuple[str, ...], tuple[str, ...]]:
    """Returns the sets of numbers that this rig has, and the group of each."""
    return {names: group_of(names, rig) for names in OTHERS if has(rig, names[0])}
