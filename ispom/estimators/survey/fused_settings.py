"""Settings of `fused` and the schemes of Table 2."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from ispom.settings import Range
from ispom.types import Kind

SCHEMES: dict[str, frozenset[Kind]] = {
    "1": frozenset({"gnss", "imu"}),
    "2": frozenset({"gnss", "imu"}),
    "3": frozenset({"gnss", "imu", "wheel"}),
    "4": frozenset({"gnss"}),
    "5": frozenset({"imu", "wheel"}),
    "6": frozenset({"imu"}),
    "7": frozenset({"wheel", "laser"}),
    "8": frozenset({"wheel"}),
}
"""The sensors of the paper's Table 2 besides the images. Scheme 9, images alone, is the visual method itself."""
Scheme = Literal["auto", "1", "2", "3", "4", "5", "6", "7", "8"]


@dataclass(frozen=True)
class FusedSettings:
    """The settings of `fused`."""

    scheme: Scheme = "auto"
    """Which sensors take part, by the scheme of Table 2: 1, 2 GNSS and IMU; 3 these and wheels; 4 GNSS; 5 IMU and
    wheels; 6 IMU; 7 wheels and laser; 8 wheels; auto: all that the recording has."""
    node_s: Annotated[float, Range(0.05, 2)] = 0.25
    """Time from one node of the graph to the next [s]."""
    window: Annotated[int, Range(3, 60)] = 16
    """Nodes that are estimated together."""
    start_m: Annotated[float, Range(1, 200)] = 8.0
    """Way of the fixes from which on they give scale and heading [m]."""
    tilt_deg: Annotated[float, Range(0.1, 30)] = 3.0
    """How far from level the rig may stand at the start, where no IMU takes part (1 sigma) [deg]."""
    turn_deg: Annotated[float, Range(0.001, 10)] = 0.03
    """Error of a rotation by the images within a second (1 sigma), growing with the root of the time [deg], as long as
    they do not state it."""
    translation_percent: Annotated[float, Range(0.01, 50)] = 0.5
    """Error of a translation by the images (1 sigma), in percent of its length, as long as they do not state it. Along
    the motion, a single camera never does."""
    scale_percent: Annotated[float, Range(0.001, 20)] = 0.3
    """Change of the images' scale within a second (1 sigma), in percent, growing with the root of the time, as long
    as they do not state it."""
    slip_percent: Annotated[float, Range(0.5, 100)] = 5.0
    """Wheels slip where their way differs by more from that of the images, in percent."""
