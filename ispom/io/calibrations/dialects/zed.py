"""Stereolabs' factory calibration of a ZED: sections LEFT_CAM_HD, RIGHT_CAM_HD ... and STEREO, for each size of
images.

Pixel (0, 0) is the centre of the top-left pixel. Coefficients: k1 k2 p1 p2 k3, by name. Baseline, TY and TZ are in
millimetres; the right camera has x_right = R x_left - (Baseline, TY, TZ), and R has the rotation vector (RX, CV, RZ).
The section is chosen by the size of the images: 2K is 2208 x 1242, FHD 1920 x 1080, HD 1280 x 720, VGA 672 x 376 for
each eye. Source: zed-open-capture, examples/include/calibration.hpp.
"""

from __future__ import annotations

import re

import numpy as np

from ispom.errors import InputError
from ispom.geometry import Pose, so3_exp
from ispom.io.calibrations.camera_info import ImageSize
from ispom.io.calibrations.content import Content
from ispom.io.calibrations.dialect import CalibrationFile, Dialect, lens_camera, one_number, pair, several_numbers

SIZES = {
    "2K": (2208, 1242), "FHD": (1920, 1080), "HD": (1280, 720), "VGA": (672, 376), "FHD1200": (1920, 1200),
    "SVGA": (960, 600), "QHDPLUS": (3200, 1800), "4K": (3840, 2160),
}  # fmt: skip
_SECTION = re.compile(r"\[(LEFT|RIGHT)_CAM_(\w+)\]", re.IGNORECASE)
_MAX_LINES = 2000
"""Largest number of lines of a file."""
METRES_PER_MILLIMETRE = 1e-3
MAX_OFF_CENTRE = 0.06
"""Largest distance of the principal point from the image's centre, relative to the longer side: twice the 0.03 to which
lenses are mounted. A larger one means another image size."""


def _recognises(content: Content) -> bool:
    return "[STEREO]" in content.words.upper() and _SECTION.search(content.words) is not None


def _sections(content: Content) -> dict[str, dict[str, float]]:
    """Returns the numbers of each section, by names in capitals."""
    sections: dict[str, dict[str, float]] = {}
    current = sections.setdefault("", {})
    lines = content.words.splitlines()
    if len(lines) > _MAX_LINES:
        raise InputError(f"{content.path} has {len(lines)} lines, more than such a file: give the right file")
    for line in lines:
        text = re.split("[;#]", line)[0].strip()
        if text.startswith("[") and text.endswith("]"):
            current = sections.setdefault(text[1:-1].strip().upper(), {})
        elif "=" in text:
            key, _, word = text.partition("=")
            try:
                current[key.strip().upper()] = float(word)
            except ValueError:
                continue
    return sections


def _read(content: Content, size: ImageSize | None) -> CalibrationFile:
    path, sections = content.path, _sections(content)
    named = [name.removeprefix("LEFT_CAM_") for name in sections if name.startswith("LEFT_CAM_")]
    named = [name for name in named if f"RIGHT_CAM_{name}" in sections]
    which, sides, notes = _chosen(content, named, sections, size)
    left, right = (
        lens_camera(
            content,
            side,
            sides,
            several_numbers(path, f"{section}.", sections[section], ("FX", "FY", "CX", "CY")),
            several_numbers(path, f"{section}.", sections[section], ("K1", "K2", "P1", "P2", "K3"), 0.0),
            "opencv",
            None,
            notes if side == "left" else (),
            section,
        )
        for side, section in (("left", f"LEFT_CAM_{which}"), ("right", f"RIGHT_CAM_{which}"))
    )
    stereo = sections["STEREO"]

    def value(key: str) -> float:
        """Returns the value for this size, or the one for all sizes."""
        return one_number(path, "STEREO.", stereo, f"{key}_{which}" if f"{key}_{which}" in stereo else key, 0.0)

    baseline = one_number(path, "STEREO.", stereo, "BASELINE")
    rotvec = np.array([value("RX"), value("CV"), value("RZ")])
    if np.abs(rotvec).max() > 1:
        raise InputError(f"{path}: RX, CV and RZ turn the right camera by more than 57 degrees: correct them")
    right_from_left = Pose(so3_exp(rotvec), -METRES_PER_MILLIMETRE * np.array([baseline, value("TY"), value("TZ")]))
    return pair(content, left, right, right_from_left.inverse())


def _chosen(
    content: Content, named: list[str], sections: dict[str, dict[str, float]], size: ImageSize | None
) -> tuple[str, tuple[int, int], tuple[str, ...]]:
    """Returns the section of the images' size, that size, and notes."""
    path = content.path
    known = [name for name in named if name in SIZES]
    sizes = ", ".join(f"{name} {SIZES[name][0]}x{SIZES[name][1]}" for name in known)
    if not known:
        raise InputError(f"{path}: a ZED's file with sections for {', '.join(named) or 'no size'}: none is known here")
    if size is None:
        if len(known) > 1:
            raise InputError(f"{path} is for images of several sizes ({sizes}): say which with --image-size")
        return known[0], SIZES[known[0]], _off_centre_note(content, known[0], sections)
    width, height = size()
    for name in known:
        if SIZES[name] == (width, height):
            return name, (width, height), ()
    if len(known) == 1:
        centre = np.array([sections[f"LEFT_CAM_{known[0]}"].get(key, 0.0) for key in ("CX", "CY")])
        usual, own = (np.abs(centre - (np.array(sides) - 1) / 2).max() for sides in (SIZES[known[0]], (width, height)))
        if own < usual:
            note = f"{path}: {sizes} is usual, but its principal point is that of the images, {width} x {height}"
            return known[0], (width, height), (note,)
        return known[0], SIZES[known[0]], ()
    alike = [name for name in known if SIZES[name][0] * height == SIZES[name][1] * width]
    if not alike:
        raise InputError(f"{path} is for images of {sizes}, not of {width} x {height}: give the images as recorded")
    return alike[0], SIZES[alike[0]], ()


def _off_centre_note(content: Content, name: str, sections: dict[str, dict[str, float]]) -> tuple[str, ...]:
    """Returns a note where the principal point shows that the images do not have the section's size."""
    width, height = SIZES[name]
    section = sections[f"LEFT_CAM_{name}"]
    off = max(abs(section.get("CX", 0.0) - (width - 1) / 2), abs(section.get("CY", 0.0) - (height - 1) / 2))
    if off <= MAX_OFF_CENTRE * width:
        return ()
    return (
        f"{content.path}: its principal point is {off:.0f} px from the middle of {name}, {width} x {height}: where the "
        "images have another size, give it with --image-size",
    )


DIALECT = Dialect("zed", "Stereolabs ZED", "`SN12345.conf`", "text", "[LEFT_CAM_HD] and [STEREO]", _recognises, _read)
