"""A changed calibration or clock, as a few numbers that are estimated from the tracks."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ispom.evaluation.sensitivity.perturbation import Perturbation
from ispom.geometry import Array, Pose
from ispom.types import Camera, Rig


@dataclass(frozen=True)
class Change:
    """A change of the calibration; all numbers are zero for the stated calibration."""

    perturbation: Perturbation = Perturbation()
    k1: float = 0.0
    """Change of k1 of the main camera's lens."""
    k2: float = 0.0
    """The next coefficient of the same lens."""
    line_delay_us: float = 0.0
    """Delay from row to row of all cameras [us], as if their images were 480 rows high."""
    aspect_percent: float = 0.0
    """Change of fy over fx of the main camera's lens (of a pair, of both lenses)."""
    right_x_deg: float = 0.0
    """Rotation of the right camera about its own axes."""
    right_y_deg: float = 0.0
    right_z_deg: float = 0.0

    def value(self, name: str) -> float:
        """Returns one number, by its name in STEPS."""
        return float(getattr(self if name in _OWN else self.perturbation, name))

    def of_rig(self, rig: Rig) -> Rig:
        """Returns the rig with the changes."""
        changed = self.perturbation.of_rig(rig)
        main = "video" if rig.video is not None else "left"
        cameras = dict(changed.cameras)
        for name in ("video",) if main == "video" else ("left", "right"):
            if self.k1 or self.k2:
                cameras[name] = _bent(cameras[name], self.k1, self.k2)
            if self.aspect_percent:
                cameras[name] = replace(cameras[name], fy=cameras[name].fy * (1 + self.aspect_percent / 100))
        if self.line_delay_us:
            for name, camera in cameras.items():
                delay_s = camera.line_delay_s + self.line_delay_us * 1e-6 * 480 / camera.height
                cameras[name] = replace(camera, line_delay_s=delay_s)
        changed = changed.changed(**cameras)
        turn = np.radians([self.right_x_deg, self.right_y_deg, self.right_z_deg])
        if turn.any():
            changed = changed.changed(rig_from_right=changed.rig_from_right @ Pose.from_rotvec(turn, np.zeros(3)))
        return changed


def _bent(camera: Camera, k1: float, k2: float) -> Camera:
    lens = camera.distortion or (0.0, 0.0, 0.0, 0.0)
    return replace(camera, distortion=(lens[0] + k1, lens[1] + k2, *lens[2:]))


STEPS = {
    "video_focal_percent": 0.1,
    "video_centre_x_px": 0.1,
    "video_centre_y_px": 0.1,
    "pair_focal_percent": 0.1,
    "pair_centre_x_px": 0.1,
    "pair_centre_y_px": 0.1,
    "baseline_percent": 0.1,
    "turn_x_deg": 0.01,
    "turn_y_deg": 0.01,
    "turn_z_deg": 0.01,
    "shift_x_m": 0.001,
    "shift_y_m": 0.001,
    "shift_z_m": 0.001,
    "clock_ms": 0.2,
    "k1": 0.001,
    "k2": 0.001,
    "line_delay_us": 0.5,
    "aspect_percent": 0.1,
    "right_x_deg": 0.01,
    "right_y_deg": 0.01,
    "right_z_deg": 0.01,
}
"""Each number that may be changed, and the step by which its effect is measured."""
_OWN = ("k1", "k2", "line_delay_us", "aspect_percent", "right_x_deg", "right_y_deg", "right_z_deg")


def change_of(names: tuple[str, ...], values: Array) -> Change:
    """Returns the change in which these numbers have these values."""
    pairs = {name: float(value) for name, value in zip(names, values, strict=True)}
    own = {name: value for name, value in pairs.items() if name in _OWN}
    return Change(Perturbation(**{n: v for n, v in pairs.items() if n not in _OWN}), **own)
