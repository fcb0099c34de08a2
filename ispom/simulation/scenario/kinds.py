"""The faults by which the doctor and the methods are judged: each of one size, on any recording that has the cameras.

A study of them is `ispom experiment faults`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np

from ispom.caches import cache_folder
from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.trajectories import tum_text
from ispom.io.whole import write_whole
from ispom.simulation.motions import motion_of
from ispom.simulation.scenario.calibrations import WrongBaseline, WrongLens, WrongMount, WrongPair
from ispom.simulation.scenario.fault import Clock, Fault
from ispom.simulation.scenario.scenario import fault_of_words
from ispom.types import Kind, Rig, Sequence, Trajectory
from ispom.types.measurements import STEREO, VIDEO

HEALTHY = "healthy"
WIDTH_PX = 320
"""Sizes in pixels are meant for images of this width, and grow with it."""
SWING_DEG, SWING_HZ = 35.0, 0.9
ROLLING_MS = 25


@dataclass(frozen=True)
class FaultKind:
    """A fault, and what is right to say of it."""

    fault: str
    """As in an address: `defocus:sigma_px=2.5`; empty for none."""
    suspects: tuple[str, ...]
    """Keys of the doctor's suspects that are right; the first one is the plainest. Empty where the doctor knows no such
    cause: then it is right to name none."""
    needs: tuple[Kind, ...] = (VIDEO,)
    """Frames that the recording must have."""
    sizes: tuple[str, ...] = ()
    """Settings of the fault in pixels, of an image `WIDTH_PX` wide."""
    world: str = ""
    """Further words of a simulation's address: such a fault is of simulations only. `{swung}` is a file of poses."""
    figures: Callable[[Any], Mapping[str, float]] | None = None
    """Returns, of the fault, the doctor's figures that are right, by their name in `Finding.values`."""

    before: tuple[FaultKind, ...] = ()
    """Faults that are put on first, such as one that makes up for what is wrong with the recording."""

    def applies_to(self, rig: Rig, simulated: bool) -> bool:
        """Checks that the recording has the cameras, and is a simulation where it must be."""
        suits = all(rig.has(kind) for kind in self.needs) and (simulated or not self.world)
        return suits and all(each.applies_to(rig, False) for each in self.before)

    def made(self, rig: Rig) -> Fault | None:
        """Returns the fault in the size that suits the rig's images; None for none."""
        if not self.fault:
            return None
        fault: Any = fault_of_words(self.fault)
        camera = rig.left if self.needs == (STEREO,) else rig.video or rig.left
        factor = max(1.0, camera.width / WIDTH_PX) if camera is not None else 1.0
        return replace(fault, **{name: factor * getattr(fault, name) for name in self.sizes})

    def address(self, source: str, seed: int) -> str:
        """Returns the address of the simulation that has this kind's world."""
        if not self.world:
            return source
        return f"{source}{'&' if '?' in source else '?'}{self.world.format(swung=_swung(seed))}"


def _focal(fault: WrongLens) -> dict[str, float]:
    return {f"{_name(fault)}_focal_percent": 100 / (1 + fault.focal_percent / 100) - 100}


def _centre(fault: WrongLens) -> dict[str, float]:
    return {f"{_name(fault)}_centre_x_px": -fault.centre_x_px, f"{_name(fault)}_centre_y_px": -fault.centre_y_px}


def _name(fault: WrongLens) -> str:
    return "video" if fault.camera == "video" else "pair"


def _k1(fault: WrongLens) -> dict[str, float]:
    return {"k1": -fault.k1}


def _baseline(fault: WrongBaseline) -> dict[str, float]:
    return {"baseline_percent": 100 / (1 + fault.percent / 100) - 100}


def _mount(fault: WrongMount) -> dict[str, float]:
    return {"turn_x_deg": -fault.pitch_deg, "turn_y_deg": -fault.yaw_deg, "turn_z_deg": -fault.roll_deg}


def _right(fault: WrongPair) -> dict[str, float]:
    return {"right_x_deg": fault.pitch_deg, "right_y_deg": fault.yaw_deg, "right_z_deg": fault.roll_deg}


def _line_delay(_: Fault) -> dict[str, float]:
    return {"line_delay_us": 1000 * ROLLING_MS / 479}  # as the doctor states it, of 480 rows


def _clock(fault: Clock) -> dict[str, float]:
    return {"clock_ms": 1000 * fault.late_s}


BOTH = (VIDEO, STEREO)
TURNED = ("pair-turned", "unlevel-pair")
"""A camera that has turned about its x axis shows its rows higher or lower: both say the same."""
KINDS: Mapping[str, FaultKind] = {
    HEALTHY: FaultKind("", ()),
    "blur": FaultKind("defocus:sigma_px=2.5", ("blur",), sizes=("sigma_px",)),
    "motion-blur": FaultKind("motion-blur:length_px=12", ("blur",), sizes=("length_px",)),
    "darkness": FaultKind("darkness:factor=0.1", ("darkness",)),
    "noise": FaultKind("noise:sigma=20", ()),
    "fog": FaultKind("fog:contrast=0.15", ("haze", "low-texture")),
    "jpeg": FaultKind("jpeg:quality=10", ()),
    "exposure": FaultKind("exposure-jumps:gain=1.6,every_s=0.4", ("exposure-jumps",)),
    "cover": FaultKind("blocked:share=0.5", ("covered-lens",)),
    "smear": FaultKind("smear", ("on-lens", "covered-lens")),
    "rain": FaultKind("rain", ("on-lens",)),
    "object": FaultKind("object", ("moving-objects",)),
    "dropped": FaultKind("dropped", ("dropped-frames",)),
    "repeated": FaultKind("repeated", ("repeated-frames",)),
    "exchanged": FaultKind("exchanged", ("exchanged",), (STEREO,)),
    "clock": FaultKind("clock:late_s=0.02", ("clock",), BOTH, figures=_clock),
    "delayed": FaultKind("clock:late_s=0.06", ("clock",), BOTH, figures=_clock),
    "focal": FaultKind("wrong-lens:focal_percent=3", ("video-focal",), figures=_focal),
    "centre": FaultKind(
        "wrong-lens:focal_percent=0,centre_x_px=6", ("video-centre",), sizes=("centre_x_px",), figures=_centre
    ),
    "distortion": FaultKind("wrong-lens:focal_percent=0,k1=0.1", ("distortion",), figures=_k1),
    "pair-focal": FaultKind("wrong-lens:camera=stereo,focal_percent=3", ("pair-focal",), (STEREO,), figures=_focal),
    "mount": FaultKind("wrong-mount:yaw_deg=1", ("mount-turned",), BOTH, figures=_mount),
    "pair-turned": FaultKind("wrong-pair:pitch_deg=0.3,yaw_deg=0", TURNED, (STEREO,), figures=_right),
    "unlevel": FaultKind("unlevel:rows_px=1.5", TURNED[::-1], (STEREO,), sizes=("rows_px",)),
    "baseline": FaultKind("wrong-baseline:percent=30", ("baseline",), BOTH, figures=_baseline),
    "rolling-shutter": FaultKind(
        "wrong-shutter", ("rolling-shutter",), world=f"rolling_shutter_ms={ROLLING_MS}", figures=_line_delay
    ),
    "turn": FaultKind("", ("no-parallax",), world="motion=rotation"),
    "blank": FaultKind("", ("low-texture",), world="place=blank&motion=sideways"),
    "swung": FaultKind("", ("too-fast",), world="route={swung}"),
    "traffic": FaultKind("", ("moving-objects",), world="vehicles=40&people=200"),
}
"""By name."""


def kind_of_words(text: str) -> FaultKind:
    """Reads a kind, perhaps with other settings of its fault, such as `focal` or `focal:focal_percent=5`, and perhaps
    after others, as in `unlevel:rows_px=-3+focal`.

    Raises InputError where it is invalid.
    """
    if "+" in text:
        *before, last = map(kind_of_words, text.split("+"))
        return replace(last, before=tuple(before))
    name, _, changed = text.partition(":")
    kind = KINDS.get(name)
    if kind is None:
        raise InputError(f"{name[:40]!r} is no fault: choose from {', '.join(KINDS)}")
    if not changed:
        return kind
    if not kind.fault:
        raise InputError(f"{text[:60]!r}: {name} has no settings: give {name}")
    fault, _, settings = kind.fault.partition(":")
    given = [part.partition("=")[0] for part in changed.split(",")]
    own = [part for part in settings.split(",") if part and part.partition("=")[0] not in given]
    words = f"{fault}:{','.join([*own, changed])}"
    fault_of_words(words)
    sizes = tuple(name for name in kind.sizes if name not in given)  # what is given is meant as it is
    return replace(kind, fault=words, sizes=sizes)


def with_fault(sequence: Sequence, kind: FaultKind, seed: int) -> Sequence:
    """Returns the sequence with the fault, without what only another simulation shows (`FaultKind.address`)."""
    for each in (*kind.before, kind):
        fault = each.made(sequence.rig)
        sequence = sequence if fault is None else fault.on(sequence, seed)
    return sequence


def _swung(seed: int) -> Path:
    """Returns a file with the flight of this seed and a camera that is swung to and fro, up to 198 degrees per
    second."""
    path, poses = motion_of("flight", seed), list[tuple[int, Pose]]()
    for time_ns in range(0, 2_000_000_000, 10_000_000):
        turn = np.radians(SWING_DEG) * np.sin(2 * np.pi * SWING_HZ * time_ns * 1e-9)
        poses.append((time_ns, path.pose_at(time_ns) @ Pose.from_rotvec(np.array([0.0, turn, 0.0]), np.zeros(3))))
    route = (cache_folder("routes") or Path(mkdtemp())) / f"swung-{seed}.tum"  # stays: its images are rendered once
    write_whole(route, tum_text(Trajectory.of(poses)))
    return route
