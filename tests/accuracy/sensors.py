"""`python -m tests.accuracy sensors`: what the doctor says of mistakes that are planted in sensors.

The path of the images is that of `monocular`, or a simulated motion with the errors of an odometry. Each kind of
mistake is planted in what the sensors of simulations and of KITTI 00 measured, or in their entries in the rig; the
sensors as they are must be silent.
`python -m tests.accuracy.sensors '{...}'` prints what was found on one recording as one line of JSON.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from rich.console import Console

from ispom.child import end_with_parent
from ispom.ensemble import build
from ispom.evaluation.sensors.judged import SensorsJudged, judged
from ispom.evaluation.sensors.scene import SensorScene
from ispom.geometry import Array, Pose, so3_exp
from ispom.methods import Config
from ispom.sensors.kind import Readings
from ispom.sequences import open_sequence
from ispom.sequences.sensor_doubts import readings_of
from ispom.types import Sequence

from .audit import estimated

SEEDS, PLANTED_SEEDS = 5, 1
"""Of each simulation, and of those in which something is planted."""
IMAGES_HZ = 10.0
SIMULATED = {
    "drive": "sim:tiny?motion=drive&duration_s=20&sensor=imu&sensor=gnss&sensor=wheel",
    "flight": "sim:tiny?duration_s=20&sensor=imu&sensor=gnss",
    "walk": "sim:indoor?motion=walk&duration_s=20&sensor=imu",
}
KITTI = "KITTI 00, monocular"
EUROC = "EuRoC V1_01, path of its truth"
KITTI_SENSORS = """
imu:
  file: {folder}/imu.txt
  columns: {{time_s: Time, ax: accelX, ay: accelY, az: accelZ, gx: omegaX, gy: omegaY, gz: omegaZ}}
  clock_offset_s: -46534.998
  rig_from_imu: {pose}
gnss: {{file: {folder}/gps.txt, columns: {{time_s: Time, x: X, y: Y, z: Z}}, sigma_m: 0.07,
  clock_offset_s: -46534.943, rig_from_gnss: {pose}}}
"""
KITTI_POSE = "{translation_m: [-0.3391, 0.7468, -1.0957], rotation_xyzw: [0.506871, -0.495521, 0.500083, 0.497451]}"


def scene_of(name: str, data: Path) -> SensorScene:
    """Returns what is judged. Raises KeyError for a name that is none."""
    if name == KITTI:
        return _kitti(data)
    if name == EUROC:
        return _euroc(data)
    motion, seed = name.removeprefix("sim:").split()
    sequence = open_sequence(f"{SIMULATED[motion]}&seed={seed}")
    return simulated(sequence, int(seed))


def scenes_in(data: Path) -> list[str]:
    """Names of the recordings that are there."""
    found = [f"sim:{motion} {seed}" for motion in SIMULATED for seed in range(SEEDS)]
    found += [KITTI] if (data / "sensors" / "kitti_00").is_dir() else []
    return found + ([EUROC] if (data / "sensors" / "euroc_v1_01_features").is_dir() else [])


def simulated(sequence: Sequence, seed: int, exact: bool = False) -> SensorScene:
    """Returns the readings of a simulation, and its path with the errors of an odometry, or without any."""
    assert sequence.truth is not None
    times = sequence.truth.times_ns
    every = np.rint((times - times[0]) * 1e-9 * IMAGES_HZ)
    first = np.append(True, np.diff(every) > 0)
    path = sequence.truth.select(first)
    return SensorScene.of(sequence.rig, path if exact else estimated(path, seed), readings_of(sequence), True)


def _kitti(data: Path) -> SensorScene:
    with TemporaryDirectory() as folder:
        file = Path(folder) / "sensors.yaml"
        file.write_text(KITTI_SENSORS.format(folder=data / "sensors" / "kitti_00", pose=KITTI_POSE))
        sequence = open_sequence(str(data / "kitti" / "sequences" / "00"), sensors=file)
        readings = readings_of(sequence)
        ensemble = build(Config(), ("monocular",), sequence.rig)
        state = ensemble.start()
        for i, kind in enumerate(sequence.kinds):
            if kind == "video":
                state, _ = ensemble.step(state, sequence[i])
    return SensorScene.of(sequence.rig, ensemble.finish(state)["monocular"], readings, metric=False)


def _euroc(data: Path) -> SensorScene:
    """The body of the truth is the IMU."""
    from ispom.io.poses.recognised import read_trajectory
    from ispom.types import Imu, Rig

    folder = data / "sensors" / "euroc_v1_01_features"
    truth = read_trajectory(folder / "truth.tum").trajectory
    lines = [line.split(",") for line in (folder / "imu_and_features.csv").read_text().splitlines()]
    columns = {column: i for i, column in enumerate(lines[0])}
    rows = [line for line in lines if line[0] == "imu"]
    times = np.array([round(float(row[columns["t_abs"]]) * 1e9) for row in rows], np.int64)
    rates, forces = (
        np.array([[float(row[columns[axis]]) for axis in names] for row in rows])
        for names in (("gx", "gy", "gz"), ("ax", "ay", "az"))
    )
    rig = Rig({"imu": Imu(rig_from_sensor=Pose())})
    inside = (truth.times_ns >= times[0]) & (truth.times_ns <= times[-1])
    readings = Readings("imu", times, {"rates": rates, "forces": forces})
    return SensorScene.of(rig, truth.select(inside), {"imu": readings}, True)


# What is planted.


@dataclass(frozen=True)
class Plant:
    name: str
    key: str
    """Of the claim that is right."""
    applied: Callable[[SensorScene], SensorScene]
    size: float
    """In the unit of the claim: what the claim must say that it would show, where it shows nothing."""

    def hidden_in(self, found: SensorsJudged) -> bool:
        """Whether it cannot be told: it is smaller than what is said to show, or the claim is undecided."""
        claim = found.claims.get(self.key)
        return claim is None or claim.undecided or claim.shows_from >= self.size


def plants(kinds: Collection[str]) -> Iterator[Plant]:
    """Yields the mistakes that can be made in sensors of these kinds."""
    if "imu" in kinds:
        for late in (0.02, 0.1, -0.1):
            yield Plant(f"IMU clock {1e3 * late:+.0f} ms", "imu-clock", _late("imu", late), abs(late))
        for axis, letter in enumerate("xyz"):
            for degrees in (1.0, 5.0, 90.0):
                size = float(np.radians(degrees))
                yield Plant(f"IMU mount {degrees:g} deg, {letter}", "imu-mount", _turned("imu", axis, degrees), size)
        yield Plant("gyroscope in deg/s", "gyroscope-unit", _valued("imu", "rates", 180 / np.pi), 4.0)
        yield Plant(
            "gyroscope bias 5 deg/s", "gyroscope-bias", _added("imu", "rates", np.radians([0, 3.0, 4.0])), 0.087
        )
        yield Plant("accelerometer in g", "accelerometer-unit", _valued("imu", "forces", 1 / 9.81), 2.3)
        yield Plant("accelerometer reversed", "accelerometer-unit", _valued("imu", "forces", -1.0), 1.0)
        yield Plant(
            "accelerometer bias 2 m/s^2", "accelerometer-bias", _added("imu", "forces", np.array([1.2, 0, 1.6])), 2.0
        )
    if "gnss" in kinds:
        for late in (0.1, 0.5):
            yield Plant(f"GNSS clock {1e3 * late:+.0f} ms", "gnss-clock", _late("gnss", late), late)
        yield Plant("GNSS arm 2 m to the right", "gnss-mount", _shifted("gnss", np.array([2.0, 0, 0])), 2.0)
        yield Plant("GNSS east and north exchanged", "gnss-axes", _columns("gnss", "xyz", (1, 0, 2)), 1.0)
        yield Plant("GNSS in feet", "gnss-unit", _valued("gnss", "xyz", 1 / 0.3048), 1.19)
    if "wheel" in kinds:
        for late in (0.1, 0.5):
            yield Plant(f"wheel clock {1e3 * late:+.0f} ms", "wheel-clock", _late("wheel", late), late)
        yield Plant("wheel mount 5 deg", "wheel-mount", _turned("wheel", 1, 5.0), float(np.radians(5.0)))
        yield Plant("wheels 1 m ahead", "wheel-mount", _shifted("wheel", np.array([0, 0, 1.0])), 1.0)
        yield Plant("wheels in km/h", "wheel-unit", _valued("wheel", "distances", 3.6), 1.28)
        yield Plant("wheels 20 % too long", "wheel-unit", _valued("wheel", "distances", 1.2), 0.18)
        yield Plant("wheel turns in degrees", "wheel-unit", _valued("wheel", "turns", 180 / np.pi), 4.0)


def _changed(kind: str, change: Callable[[Readings], Readings]) -> Callable[[SensorScene], SensorScene]:
    return lambda scene: replace(
        scene, readings={name: change(r) if r.kind == kind else r for name, r in scene.readings.items()}
    )


def _late(kind: str, seconds: float) -> Callable[[SensorScene], SensorScene]:
    return _changed(kind, lambda r: replace(r, times_ns=r.times_ns + round(seconds * 1e9)))


def _valued(kind: str, column: str, factor: float) -> Callable[[SensorScene], SensorScene]:
    return _changed(kind, lambda r: replace(r, values={**r.values, column: factor * r.values[column]}))


def _added(kind: str, column: str, bias: Array) -> Callable[[SensorScene], SensorScene]:
    return _changed(kind, lambda r: replace(r, values={**r.values, column: r.values[column] + bias}))


def _columns(kind: str, column: str, order: tuple[int, ...]) -> Callable[[SensorScene], SensorScene]:
    return _changed(kind, lambda r: replace(r, values={**r.values, column: r.values[column][:, list(order)]}))


def _mounted(kind: str, change: Callable[[Pose], Pose]) -> Callable[[SensorScene], SensorScene]:
    def changed(scene: SensorScene) -> SensorScene:
        names = [name for name, r in scene.readings.items() if r.kind == kind]
        sensors = {
            name: replace(s, rig_from_sensor=change(s.rig_from_sensor)) if name in names else s
            for name, s in scene.rig.sensors.items()
        }
        return replace(scene, rig=replace(scene.rig, sensors=sensors))

    return changed


def _turned(kind: str, axis: int, degrees: float) -> Callable[[SensorScene], SensorScene]:
    """About an axis of the rig, in its place."""
    turn = so3_exp(np.radians(degrees) * np.eye(3)[axis])
    return _mounted(kind, lambda pose: Pose(turn @ pose.rotation, pose.translation))


def _shifted(kind: str, metres: Array) -> Callable[[SensorScene], SensorScene]:
    return _mounted(kind, lambda pose: Pose(pose.rotation, pose.translation + metres))


# What is found.


@dataclass(frozen=True)
class Found:
    recording: str
    plant: str
    """Empty for the sensors as they are."""
    key: str
    """Of the claim that is right."""
    named: tuple[str, ...]
    """Keys of what is wrong, the strongest first."""
    cannot_tell: bool = False
    """Whether what was planted is smaller than what is said to show, or the claim is undecided."""
    seconds: float = 0.0
    values: Mapping[str, float] | None = None
    """Figures of the sensors as they are."""

    @property
    def outcome(self) -> str:
        if not self.plant:
            return "silent" if not self.named else "false alarm"
        if self.key in self.named:
            return "named"
        if self.named:
            return "another"
        return "cannot tell" if self.cannot_tell else "missed"


def tried(name: str, scene: SensorScene) -> Iterator[Found]:
    """The sensors as they are, and each mistake in them. What is found in them as they are is no answer to a plant."""
    alone, seconds = _judged(scene)
    known = _named(alone)
    yield Found(name, "", "", known, seconds=seconds, values=_figures(alone))
    if name.startswith("sim:") and int(name.split()[1]) >= PLANTED_SEEDS:
        return
    for plant in plants({readings.kind for readings in scene.readings.values()}):
        found, seconds = _judged(plant.applied(scene))
        named = tuple(key for key in _named(found) if key not in known or key == plant.key)
        yield Found(name, plant.name, plant.key, named, plant.hidden_in(found), seconds)


def _judged(scene: SensorScene) -> tuple[SensorsJudged, float]:
    begin = time.monotonic()
    found = judged(scene)
    return found, time.monotonic() - begin


def _named(found: SensorsJudged) -> tuple[str, ...]:
    wrong = sorted((each for each in found.claims.values() if each.found), key=lambda each: -each.strength)
    return tuple(each.key for each in wrong)


def _figures(found: SensorsJudged) -> dict[str, float]:
    return {f"{key}.{name}": value for key, claim in found.claims.items() for name, value in claim.values.items()}


def print_sensors(console: Console, found: list[Found]) -> None:
    """The summary, and what went wrong."""
    console.print(markdown(found))


BEGIN, END = "<!-- python -m tests.accuracy sensors: begin -->", "<!-- python -m tests.accuracy sensors: end -->"


def write_sensors(page: Path, found: list[Found]) -> None:
    """Replaces what stands between the marks of a page of the documentation."""
    before, _, rest = page.read_text(encoding="utf-8").partition(BEGIN)
    _, mark, after = rest.partition(END)
    if not mark:
        raise ValueError(f"{page} has no lines '{BEGIN}' and '{END}'")
    page.write_text(f"{before}{BEGIN}\n\n{markdown(found)}\n\n{END}{after}", encoding="utf-8")


OUTCOMES = ("named", "cannot tell", "another", "missed")


def markdown(found: list[Found]) -> str:
    """How often each mistake is named, by group of recordings."""
    planted = [f for f in found if f.plant]
    lines = ["| recordings | planted | " + " | ".join(OUTCOMES) + " |", "| --- " * (2 + len(OUTCOMES)) + "|"]
    for group in dict.fromkeys(_group(f) for f in planted):
        for kind in dict.fromkeys(_kind(f) for f in planted if _group(f) == group):
            some = [f.outcome for f in planted if _group(f) == group and _kind(f) == kind]
            lines.append(f"| {group} | {kind} | " + " | ".join(str(some.count(o) or "") for o in OUTCOMES) + " |")
    counts = [sum(f.outcome == o for f in planted) for o in OUTCOMES]
    lines.append(f"| all | {len(planted)} | " + " | ".join(map(str, counts)) + " |")
    right = [f for f in found if not f.plant]
    alarms = [f"{f.recording} ({', '.join(f.named)})" for f in right if f.named]
    lines += [
        "",
        f"Sensors as they are: {len(right)}, with something named in {len(alarms)}: {', '.join(alarms) or 'none'}.",
        "",
    ]
    lines += [
        f"- {f.recording}, {f.plant}: {f.outcome} {', '.join(f.named)}".rstrip()
        for f in planted
        if f.outcome in OUTCOMES[2:]
    ]
    return "\n".join(lines).rstrip()


def _group(found: Found) -> str:
    return found.recording.rsplit(" ", 1)[0] if found.recording.startswith("sim:") else found.recording


def _kind(found: Found) -> str:
    return found.plant.split(",")[0]


def sensors_found(rows: list[dict[str, Any]]) -> list[Found]:
    """What a process printed."""
    return [Found(**{**row, "named": tuple(row["named"])}) for row in rows]


def main(argument: str) -> None:
    task = json.loads(argument)
    rows = tried(task["recording"], scene_of(task["recording"], Path(task["data"])))
    sys.stdout.write(json.dumps([asdict(each) for each in rows]) + "\n")


if __name__ == "__main__":
    end_with_parent()
    main(sys.argv[1])
