"""Wrong files of sensors and cameras each give a note with its key; healthy ones give none."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from ispom.errors import InputError
from ispom.features.pair_look import FILM_IMAGES, with_look
from ispom.geometry import Array, so3_exp
from ispom.plausibility import DOUBTS, Doubt
from ispom.plausibility.doubt import keys_of
from ispom.sensors.gnss import local_of
from ispom.sequences import open_sequence
from ispom.sequences.sensor_doubts import frames_ns_of, mount_doubts, readings_of, sensor_doubts
from ispom.sequences.sensors_yaml import with_sensors
from ispom.types import FRAME_KINDS, Frame, GnssFix, Rig, Sequence
from tests import doubles

IDENTITY = {"translation_m": [0.0, -0.5, 0.2], "rotation_xyzw": [0.0, 0.0, 0.0, 1.0]}
SECONDS = 12.0
PLACE = np.array([49.0, 8.4, 116.0])
RIG_FROM_VEHICLE = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])


def plain(seconds: float = SECONDS) -> Sequence:
    """Twelve seconds of video."""
    return doubles.sequence(int(30 * seconds) + 1)


@dataclass
class Drive:
    """What sensors measure on a car that drives curves: IMU at 200 Hz, with x to the right, y down and z ahead."""

    speed: float = 10.0
    turn: float = 0.4
    """Amplitude of the yaw rate [rad/s]."""
    tilt: float = 0.05
    """Amplitude of the roll rate [rad/s]."""
    gravity: float = 9.81
    hz: float = 200.0
    place: Array = field(default_factory=lambda: PLACE)
    shake: float = 0.5
    """Standard deviation of vibrations [m/s^2]."""

    def __post_init__(self) -> None:
        rng = np.random.default_rng(5)
        self.t = np.arange(0, SECONDS + 0.05, 1 / self.hz)
        n = len(self.t)
        yaw_rate = self.turn * np.sin(0.8 * self.t)
        roll_rate = self.tilt * np.cos(1.1 * self.t)
        turned, up = np.eye(3), []
        rates = np.stack([0 * self.t, -yaw_rate, roll_rate], axis=1)  # to the left is about -y
        for rate in rates:
            up.append(turned.T @ [0, -self.gravity, 0])
            turned = turned @ so3_exp(rate / self.hz)
        side = np.stack([-self.speed * yaw_rate, 0 * self.t, 0 * self.t], axis=1)
        self.rates = rates + rng.normal(scale=0.003, size=(n, 3)) + [0.002, -0.001, 0.003]
        self.forces = np.array(up) + side + rng.normal(scale=self.shake, size=(n, 3))
        self.fix_t = np.arange(0, SECONDS + 0.05, 0.5)
        heading = np.interp(self.fix_t, self.t, np.cumsum(yaw_rate) / self.hz)
        step = 0.5 * self.speed * np.stack([np.cos(heading), np.sin(heading), 0 * heading], axis=1)
        self.xyz = np.cumsum(step, axis=0) - step[0] + rng.normal(scale=0.02, size=step.shape)
        self.wheel_t = np.arange(0, SECONDS + 0.02, 0.05)
        self.way = self.speed * 0.05 * (1 + rng.normal(scale=0.01, size=len(self.wheel_t)))
        self.turns = np.interp(self.wheel_t, self.t, yaw_rate) * 0.05

    @property
    def geodetic(self) -> Array:
        """(N, 3) degrees, degrees and metres."""
        import pymap3d

        return np.stack(pymap3d.enu2geodetic(*self.xyz.T, *self.place), axis=1)


def imu(t: Array, rates: Array, forces: Array, time: str = "time_s", unit: float = 1.0) -> str:
    rows = np.column_stack([rates, forces])
    times = t * unit if time == "time_s" else np.rint(t * unit).astype(np.int64)
    lines = [f"{s},{','.join(f'{v:.9g}' for v in row)}" for s, row in zip(times.tolist(), rows.tolist(), strict=True)]
    return "\n".join([f"{time},gx,gy,gz,ax,ay,az", *lines])


def table(header: str, t: Array, rows: Array) -> str:
    return "\n".join([header, *(f"{s},{','.join(f'{v:.12g}' for v in r)}" for s, r in zip(t, rows, strict=True))])


def geodetic(rows: Array, t: Array, sigma: float = 1.0) -> tuple[str, dict]:
    return table("time_s,lat,lon,height", t, rows), {"sensor": "gnss", "sigma_m": sigma}


def local(rows: Array, t: Array, sigma: float = 0.5) -> tuple[str, dict]:
    return table("time_s,x,y,z", t, rows), {"sensor": "gnss", "sigma_m": sigma}


def wheel(t: Array, way: Array, turns: Array) -> tuple[str, dict]:
    return table("time_s,distance,turn", t, np.column_stack([way, turns])), {"sensor": "wheel"}


def opened(folder: Path, sensors: dict[str, tuple[str, dict]], sequence: Sequence | None = None) -> Sequence:
    """The sequence with tables of sensors."""
    described = {}
    for name, (text, entry) in sensors.items():
        (folder / f"{name}.csv").write_text(text)
        described[name] = {"sensor": "imu", f"rig_from_{name}": IDENTITY, "file": f"{name}.csv", **entry}
    path = folder / "sensors.yaml"
    path.write_text(yaml.safe_dump(described))
    return with_sensors(plain() if sequence is None else sequence, path)


def with_hole(d: Drive) -> str:
    keep = (d.t < 4) | (d.t > 5.2)
    return imu(d.t[keep], d.rates[keep], d.forces[keep])


def minutes(rows: Array) -> Array:
    whole = np.floor(rows[:, :2])
    return np.column_stack([100 * whole + 60 * (rows[:, :2] - whole), rows[:, 2]])


def radians(rows: Array) -> Array:
    return np.column_stack([np.radians(rows[:, :2]), rows[:, 2]])


def without_fix(rows: Array) -> Array:
    rows = rows.copy()
    rows[[3, 7]] = 0
    return rows


def jumping(xyz: Array) -> Array:
    xyz = xyz.copy()
    xyz[10] += [10_000, 0, 0]
    return xyz


Wrong = Callable[[Drive], "dict[str, tuple[str, dict]]"]
QUATERNION = {"rotation_xyzw": [1.0, 0.0, 0.0, 0.0], "translation_m": [0.0, 0.0, 0.0]}


def mounted(pose: dict) -> Wrong:
    return lambda d: {"imu": (imu(d.t, d.rates, d.forces), {"rig_from_imu": pose})}


WRONG: dict[str, tuple[str, Wrong]] = {
    "gyroscope in deg/s": ("gyroscope_in_degrees", lambda d: {"imu": (imu(d.t, np.degrees(d.rates), d.forces), {})}),
    "accelerometer in g": ("accelerometer_in_g", lambda d: {"imu": (imu(d.t, d.rates, d.forces / 9.81), {})}),
    "accelerometer in mm": ("accelerometer_too_large", lambda d: {"imu": (imu(d.t, d.rates, d.forces * 1000), {})}),
    "accelerometer in cm": ("accelerometer_too_large", lambda d: {"imu": (imu(d.t, d.rates, d.forces * 100), {})}),
    "without gravity": (
        "accelerometer_without_gravity",
        lambda d: {"imu": (imu(d.t, d.rates, d.forces + np.array([0, 9.81, 0])), {})},
    ),
    "columns exchanged": ("imu_swapped", lambda d: {"imu": (imu(d.t, d.forces, d.rates), {})}),
    "milliseconds in time_s": ("time_unit", lambda d: {"imu": (imu(d.t, d.rates, d.forces, unit=1e3), {})}),
    "microseconds in time_ns": ("time_unit", lambda d: {"imu": (imu(d.t, d.rates, d.forces, "time_ns", 1e6), {})}),
    "milliseconds of fixes": ("time_unit", lambda d: {"gnss": local(d.xyz, 1e3 * d.fix_t)}),
    "milliseconds of wheels": ("time_unit", lambda d: {"wheel": wheel(1e3 * d.wheel_t, d.way, d.turns)}),
    "another clock": ("outside_images", lambda d: {"imu": (imu(d.t + 6, d.rates, d.forces), {})}),
    "all zero": ("imu_all_zero", lambda d: {"imu": (imu(d.t, 0 * d.rates, 0 * d.forces), {})}),
    "gyroscope zero": ("imu_all_zero", lambda d: {"imu": (imu(d.t, 0 * d.rates, d.forces), {})}),
    "a hole": ("imu_hole", lambda d: {"imu": (with_hole(d), {})}),
    "5 Hz": ("imu_slow", lambda d: {"imu": (imu(d.t[::40], d.rates[::40], d.forces[::40]), {})}),
    "lat and lon exchanged": ("gnss_mirrored", lambda d: {"imu": (imu(d.t, d.rates, d.forces), {}),
                                                         "gnss": geodetic(d.geodetic[:, [1, 0, 2]], d.fix_t)}),
    "x and y exchanged": ("gnss_mirrored", lambda d: {"imu": (imu(d.t, d.rates, d.forces), {}),
                                                     "gnss": local(d.xyz[:, [1, 0, 2]], d.fix_t)}),
    "in radians": ("latitude_in_radians", lambda d: {"gnss": geodetic(radians(d.geodetic), d.fix_t)}),
    "at 0, 0": ("gnss_null_fix", lambda d: {"gnss": geodetic(without_fix(d.geodetic), d.fix_t)}),
    "all at 0, 0": ("gnss_all_zero", lambda d: {"gnss": geodetic(0 * d.geodetic, d.fix_t)}),
    "all local ones zero": ("gnss_all_zero", lambda d: {"gnss": local(0 * d.xyz, d.fix_t)}),
    "a jump": ("gnss_jump", lambda d: {"gnss": local(jumping(d.xyz), d.fix_t)}),
    "UTM": ("gnss_utm", lambda d: {"gnss": local(d.xyz + np.array([458_000, 5_428_000, 116]), d.fix_t)}),
    "from the Earth's centre": (
        "gnss_earth_centred", lambda d: {"gnss": local(d.xyz + np.array([4_146_000, 612_000, 4_791_000]), d.fix_t)}),
    "far origin": ("gnss_far", lambda d: {"gnss": (geodetic(d.geodetic, d.fix_t)[0],
                                                  {"sensor": "gnss", "sigma_m": 1, "origin": [8.4, 49, 116]})}),
    "height in mm": ("height_impossible", lambda d: {"gnss": geodetic(d.geodetic * [1, 1, 1e3], d.fix_t)}),
    "sigma 500 m": ("sigma_large", lambda d: {"gnss": local(d.xyz, d.fix_t, 500)}),
    "sigma 1e-9 m": ("sigma_small", lambda d: {"gnss": local(d.xyz, d.fix_t, 1e-9)}),
    "wheels in mm": ("wheel_unit", lambda d: {"wheel": wheel(d.wheel_t, 1000 * d.way, d.turns)}),
    "wheels cumulative": ("wheel_cumulative", lambda d: {"wheel": wheel(d.wheel_t, np.cumsum(d.way), d.turns)}),
    "turn in degrees": ("wheel_turn_in_degrees", lambda d: {"wheel": wheel(d.wheel_t, d.way, np.degrees(d.turns))}),
    "wheels zero": ("wheel_all_zero", lambda d: {"wheel": wheel(d.wheel_t, 0 * d.way, 0 * d.turns),
                                                "gnss": local(d.xyz, d.fix_t)}),
    "mount in mm": ("mount_far", mounted({**IDENTITY, "translation_m": [0.0, -500.0, 200.0]})),
    "mount of 1e9 m": ("mount_far", mounted({**IDENTITY, "translation_m": [1e9, 0.0, 0.0]})),
    "mount's quaternion": ("mount_quaternion", mounted(QUATERNION)),
}  # fmt: skip
"""What is wrong: the key, and the files."""


@pytest.mark.parametrize("kind", WRONG)
def test_a_wrong_file_gives_its_note(kind: str, tmp_path: Path) -> None:
    key, made = WRONG[kind]
    found = opened(tmp_path, made(Drive()))
    assert keys_of(found.notes) == {key}
    assert all(len(note) < 400 and "\n" not in note for note in found.notes)


@pytest.mark.parametrize(
    ("rows", "key"),
    [
        (lambda d: minutes(d.geodetic), "DDMM"),
        (lambda d: d.geodetic[:, [1, 0, 2]], "exchanged"),
        (lambda d: d.geodetic * [1e7, 1e7, 1], "no place on Earth"),
    ],
    ids=["DDMM.MM", "exchanged", "integers"],
)
def test_what_is_no_place_on_earth_is_one_sentence(tmp_path: Path, rows: Callable, key: str) -> None:
    place = np.array([39.9, 116.4, 50.0])  # of which the exchanged latitude is beyond 90
    drive = Drive(place=place)
    with pytest.raises(InputError, match=key):
        opened(tmp_path, {"gnss": geodetic(rows(drive), drive.fix_t)})


def still(gravity: float = 9.81, shake: float = 0.02) -> Drive:
    return Drive(speed=0.0, turn=0.0, tilt=0.0, gravity=gravity, shake=shake)


def everything(d: Drive) -> dict[str, tuple[str, dict]]:
    return {
        "imu": (imu(d.t, d.rates, d.forces), {}),
        "gnss": geodetic(d.geodetic, d.fix_t, 0.5),
        "wheel": wheel(d.wheel_t, d.way, d.turns),
    }


def jumped() -> Drive:
    """Half of the time in the air: the accelerometer measures hardly anything there."""
    d = Drive(shake=0.3)
    d.forces[600:1800] *= 0.02
    return d


def flown() -> Drive:
    """A racing drone: fast turns about all axes, twice gravity."""
    d = Drive(speed=0, turn=3.0, tilt=4.0)
    d.forces *= 2.0
    return d


def faster_and_faster() -> Drive:
    d = Drive()
    d.way = 0.05 * 3.0 * d.wheel_t
    return d


HEALTHY: dict[str, Callable[[], dict]] = {
    "drive": lambda: everything(Drive()),
    "stands still": lambda: everything(still()),
    "wheels at rest": lambda: {"wheel": wheel(Drive().wheel_t, 0 * Drive().way, 0 * Drive().turns),
                               "gnss": local(still().xyz, still().fix_t)},
    "moon": lambda: {"imu": everything(still(1.62))["imu"]},
    "mars": lambda: {"imu": everything(still(3.71))["imu"]},
    "jump": lambda: {"imu": everything(jumped())["imu"]},
    "racing drone": lambda: {"imu": everything(flown())["imu"]},
    "plane": lambda: {"gnss": geodetic(Drive(speed=330, place=np.array([60.0, 10, 11_000])).geodetic, Drive().fix_t)},
    "boat": lambda: everything(Drive(speed=1.0, turn=0.1)),
    "high latitude": lambda: everything(Drive(place=np.array([89.9, -30.0, 5.0]))),
    "equator": lambda: everything(Drive(place=np.array([0.0, 0.0, 0.0]))),
    "equator elsewhere": lambda: everything(Drive(place=np.array([0.0, -78.5, 2_800.0]))),
    "date line": lambda: everything(Drive(place=np.array([-17.0, 179.9999, 3.0]))),
    "below the sea": lambda: everything(Drive(place=np.array([31.5, 35.5, -430.0]))),
    "accelerates": lambda: {"wheel": wheel(Drive().wheel_t, faster_and_faster().way, Drive().turns)},
    "backwards": lambda: {"wheel": wheel(Drive().wheel_t, -Drive().way, Drive().turns)},
    "RTK": lambda: {"gnss": local(Drive().xyz, Drive().fix_t, 0.008)},
    "phone": lambda: {"gnss": local(Drive().xyz, Drive().fix_t, 15.0)},
    "1 kHz": lambda: {"imu": everything(Drive(hz=1000.0))["imu"]},
    "25 Hz": lambda: {"imu": everything(Drive(hz=25.0))["imu"]},
    "longer than the images": lambda: {"imu": (imu(3 * Drive().t - 5, Drive().rates, Drive().forces), {})},
}  # fmt: skip


@pytest.mark.parametrize("kind", HEALTHY)
def test_a_healthy_file_gives_none(kind: str, tmp_path: Path) -> None:
    found = opened(tmp_path, HEALTHY[kind]())
    assert not keys_of(found.notes), found.notes


def test_fixes_at_null_are_left_out(tmp_path: Path) -> None:
    d = Drive()
    found = opened(tmp_path, {"gnss": geodetic(without_fix(d.geodetic), d.fix_t)})
    fixes = [m for m in map(found.load, range(len(found))) if isinstance(m, GnssFix)]
    assert 0 < len(fixes) <= len(d.fix_t) - 2
    assert max(abs(fix.xyz_in_local).max() for fix in fixes) < 1e3
    assert np.allclose(local_of(d.geodetic[:1], d.geodetic[0]), 0)


CAMERA = {"width": 640, "height": 480, "fx": 450.0, "fy": 450.0, "cx": 322.0, "cy": 238.0,
          "distortion": [-0.28, 0.07, 0.0, 0.0]}  # fmt: skip
CAMERAS = {
    "fx ten times too long": ({"fx": 4500.0, "fy": 4500.0}, "focal_long"),
    "fx in millimetres": ({"fx": 40.0, "fy": 40.0, "distortion": []}, "focal_short"),
    "fx unlike fy": ({"fx": 600.0}, "focal_aspect"),
    "cx and cy exchanged": ({"cx": 238.0, "cy": 322.0}, "centre_swapped"),
    "cx far": ({"cx": 20.0}, "centre_far"),
    "k3 = 50": ({"distortion": [-0.28, 0.07, 0.0, 0.0, 50.0]}, "distortion_large"),
    "folds": ({"distortion": [-0.4, 0.0, 0.0, 0.0], "fx": 500.0, "fy": 500.0}, "distortion_folds"),
    "healthy": ({}, ""),
    "wide": ({"fx": 300.0, "fy": 300.0, "distortion": [-0.22, 0.05, 0, 0]}, ""),
    "telephoto": ({"fx": 1800.0, "fy": 1800.0, "distortion": [0.3, -8.0, 0, 0, 60.0]}, ""),
}


def pictures(folder: Path, made: Callable[[int], np.ndarray], suffix: str = ".png") -> Path:
    folder.mkdir(parents=True)
    for k in range(6):
        assert cv2.imwrite(str(folder / f"{k:03d}{suffix}"), made(k))
    return folder


def textured(k: int = 0, size: tuple[int, int] = (480, 640)) -> np.ndarray:
    rng = np.random.default_rng(3)
    coarse = rng.integers(30, 220, (size[0] // 20, size[1] // 20 + 8), np.uint8)
    wide = cv2.resize(coarse, (size[1] + 160, size[0]), interpolation=cv2.INTER_CUBIC)
    return np.ascontiguousarray(wide[:, 6 * k : 6 * k + size[1]])


@pytest.mark.parametrize("kind", CAMERAS)
def test_wrong_cameras_give_their_note(kind: str, tmp_path: Path) -> None:
    changes, key = CAMERAS[kind]
    folder = pictures(tmp_path / "images", textured)
    (folder / "camera.yaml").write_text(yaml.safe_dump({**CAMERA, **changes, "rate_hz": 10}))
    assert keys_of(open_sequence(str(folder)).notes) == ({key} if key else set())


def two_fields(k: int) -> np.ndarray:
    image = textured(k)
    image[1::2] = textured(k + 1)[1::2]
    return image


def see_through(k: int) -> np.ndarray:
    return np.dstack([textured(k)] * 3 + [np.zeros((480, 640), np.uint8)])


@pytest.mark.parametrize(
    ("made", "keys"),
    [
        (two_fields, {"images_interlaced"}),
        (lambda _: textured(0), {"images_frozen"}),
        (lambda k: np.full((480, 640), k % 3, np.uint8), {"images_black"}),
        (see_through, {"images_transparent"}),
        (textured, set()),
        (lambda k: textured(k) // 12, set()),
        (lambda k: np.random.default_rng(k).integers(0, 256, (480, 640), np.uint8), set()),
        (lambda k: np.tile(np.array([[40 + k], [200]], np.uint8), (240, 640)), {"images_interlaced"}),
    ],
    ids=["interlaced", "frozen", "black", "transparent", "healthy", "dark", "noise", "comb"],
)
def test_wrong_images_give_their_note(made: Callable, keys: set[str], tmp_path: Path) -> None:
    folder = pictures(tmp_path / "images", made)
    (folder / "camera.yaml").write_text(yaml.safe_dump({**CAMERA, "rate_hz": 10}))
    assert keys_of(with_look(open_sequence(str(folder))).notes) == keys


def test_few_images_are_loaded_however_long_the_recording_is() -> None:
    sequence, loaded = plain(2.0), list[int]()

    def load(i: int) -> Frame:
        loaded.append(i)
        return Frame.video(i, textured(i % 20))

    times_ns, kinds = np.arange(100_000) * 33_000_000, ("video",) * 100_000
    rig = Rig.single(sequence.rig.cameras["video"])
    with_look(replace(sequence, rig=rig, times_ns=times_ns, kinds=kinds, load=load))
    assert 4 <= len(set(loaded)) <= 7 + FILM_IMAGES


def test_sensors_are_seen_in_the_rig_of_a_recording(tmp_path: Path) -> None:
    folder = tmp_path / "own"
    pictures(folder / "video", textured)
    rig = {
        "video": {**CAMERA, "rig_from_video": {**IDENTITY, "translation_m": [0.0, 0.0, 80.0]}},
        "imu": {"sensor": "imu", "rig_from_imu": {**IDENTITY, "translation_m": [0.0, 0.0, 900.0]}},
    }
    (folder / "rig.yaml").write_text(yaml.safe_dump(rig))
    (folder / "sequence.yaml").write_text("video: {source: video, rate_hz: 10}")
    notes = [note for note in open_sequence(str(folder)).notes if isinstance(note, Doubt)]
    assert [note.key for note in notes] == ["mount_far", "mount_far"]


def test_a_doubt_is_text_with_a_key() -> None:
    doubt = Doubt("imu_hole", "a sentence")
    again = copy.copy(doubt)
    assert doubt == again == "a sentence" and again.key == "imu_hole" and type(str(doubt)) is str
    with pytest.raises(KeyError):
        Doubt("nothing", "a sentence")
    made = {key for key, _ in WRONG.values()} | {key for _, key in CAMERAS.values()}
    untested = DOUBTS.keys() - made
    assert untested == {
        "latitude_longitude_swapped", "latitude_in_minutes", "latitude_impossible",
        "images_black", "images_frozen", "images_interlaced", "images_transparent",
        "images_title", "images_cut", "images_repeated", "pair_unlike",
    }  # fmt: skip


def test_frames_without_sensors_have_no_doubts() -> None:
    assert Rig() is not None and all(isinstance(m, Frame) for m in map(plain(1).load, range(3)))
    assert not keys_of(plain(1).notes) and {*plain(1).kinds} <= FRAME_KINDS


DATA = Path(__file__).parents[2] / ".." / "shared" / "data"


def of_simulation(words: str) -> set[str]:
    sequence = open_sequence(f"sim:tiny?{words}&sensor=imu&sensor=gnss&sensor=wheel")
    readings = readings_of(sequence)
    assert {"imu", "gnss", "wheel"} <= readings.keys()
    doubts = sensor_doubts(str, sequence.rig, readings, frames_ns_of(sequence))
    return keys_of((*doubts, *mount_doubts("", sequence.rig)))


@pytest.mark.parametrize("motion", ["flight", "drive", "loop", "walk", "still", "tiny-steps", "rotation", "sideways"])
def test_simulated_sensors_give_none(motion: str) -> None:
    assert not of_simulation(f"motion={motion}")


def test_simulated_sensors_on_the_moon_and_upright_give_none() -> None:
    assert not of_simulation("place=moon&motion=drive")
    assert not of_simulation("portrait=true&motion=walk")


@pytest.mark.skipif(not (DATA / "sensors" / "kitti_00").is_dir(), reason="../shared/data/sensors/kitti_00 is absent")
def test_the_sensors_of_a_car_give_the_hole_that_they_have(tmp_path: Path) -> None:
    """Its first row is 1.9 s before its second."""
    pose = {"translation_m": [-0.3391, 0.7468, -1.0957], "rotation_xyzw": [0.506871, -0.495521, 0.500083, 0.497451]}
    folder = (DATA / "sensors" / "kitti_00").resolve()
    axes = {f"a{a}": f"accel{a.upper()}" for a in "xyz"} | {f"g{a}": f"omega{a.upper()}" for a in "xyz"}
    described = {
        "imu": {"file": str(folder / "imu.txt"), "columns": {"time_s": "Time", **axes}, "clock_offset_s": -46534.998},
        "gnss": {
            "file": str(folder / "gps.txt"),
            "columns": {"time_s": "Time", "x": "X", "y": "Y", "z": "Z"},
            "clock_offset_s": -46534.943,
            "sigma_m": 0.07,
        },
    }
    path = tmp_path / "sensors.yaml"
    path.write_text(yaml.safe_dump({name: {f"rig_from_{name}": pose, **entry} for name, entry in described.items()}))
    found = open_sequence(str(DATA / "kitti" / "sequences" / "00"), sensors=path)
    assert keys_of(found.notes) == {"imu_hole"}
    described["gnss"]["columns"] |= {"x": "Y", "y": "X"}
    path.write_text(yaml.safe_dump({name: {f"rig_from_{name}": pose, **entry} for name, entry in described.items()}))
    found = open_sequence(str(DATA / "kitti" / "sequences" / "00"), sensors=path)
    assert keys_of(found.notes) == {"imu_hole", "gnss_mirrored"}


@pytest.mark.skipif(not (DATA / "euroc_v1_01_start").is_dir(), reason="../shared/data/euroc_v1_01_start is absent")
def test_the_imu_of_a_drone_at_rest_gives_none(tmp_path: Path) -> None:
    path = tmp_path / "sensors.yaml"
    table = (DATA / "euroc_v1_01_start" / "mav0" / "imu0" / "data.csv").resolve()
    path.write_text(yaml.safe_dump({"imu": {"file": str(table), "rig_from_imu": IDENTITY}}))
    assert not keys_of(open_sequence(str(DATA / "euroc_v1_01_start"), sensors=path).notes)


REAL = ["kitti/sequences/00",
        "kitti/sequences/06", "euroc_v1_01_start", "handheld_board", "sensors/euroc_v1_01_features",
        "hard/terrace", "hard/rover_unlevel/sequences/32", "hard/fox_portrait", "hard/dashcam/film.mp4",
        "reports/20_tumvi_equidistant/tumvi_equidistant"]  # fmt: skip


@pytest.mark.parametrize("name", REAL)
def test_real_recordings_give_none(name: str) -> None:
    if not (DATA / name).exists():
        pytest.skip(f"../shared/data/{name} is absent")
    assert not keys_of(with_look(open_sequence(str(DATA / name))).notes)


@pytest.mark.skipif(not (DATA / "reports" / "v07_interlaced").is_dir(), reason="../shared/data/reports is absent")
def test_a_real_scene_in_two_fields_is_seen() -> None:
    found = with_look(open_sequence(str(DATA / "reports" / "v07_interlaced")))
    assert keys_of(found.notes) == {"images_interlaced"}
