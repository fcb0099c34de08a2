"""Measurements, rigs of named sensors, and sequences of them: what they accept and what they refuse."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ispom import methods
from ispom.ensemble import build
from ispom.errors import InputError
from ispom.estimator import Method, require_frame
from ispom.geometry import Pose
from ispom.methods import Config, require_sensors
from ispom.types import (
    Camera,
    CameraSensor,
    Frame,
    GnssAntenna,
    GnssFix,
    Imu,
    ImuSamples,
    LaserScan,
    LensSigma,
    Measurement,
    PairSigma,
    Rig,
    Sensor,
    TimedPoints,
    WheelIncrement,
    WheelOdometer,
    images_of,
    main_image,
)
from tests import doubles

CAMERA = Camera(64, 48, 50.0, 50.0, 31.5, 23.5)
GREY = np.zeros((48, 64), np.uint8)
HIGH = Pose(translation=np.array([0.0, -1.0, 0.0]))


def test_frames_are_of_the_kind_of_their_cameras() -> None:
    video, stereo, back = Frame.video(1, GREY), Frame.stereo(2, GREY, GREY), Frame(3, {"back": GREY, "video": GREY})
    assert [f.kind for f in (video, stereo, back)] == ["video", "stereo", "cameras"]
    assert main_image(stereo) == ("left", stereo.left) and main_image(back) is None
    changed = stereo.with_images(right=GREY + 1)
    assert changed.right.max() == 1 and changed.left is stereo.left and stereo.right.max() == 0


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((4, 6)),
        np.full((4, 6), np.nan, np.float32),
        np.zeros((4, 6), np.uint16),
        np.zeros((4, 6, 4), np.uint8),
        np.zeros((4, 6, 1), np.uint8),
        np.zeros(6, np.uint8),
        [[0, 1], [2, 3]],
        None,
    ],
    ids=str,
)
def test_an_image_is_grey_or_rgb_in_8_bits(image: Any) -> None:
    with pytest.raises(InputError, match="left"):
        Frame.stereo(7, image, GREY)
    with pytest.raises(InputError, match="video"):
        Frame.video(7, GREY).with_images(video=image)


FINE: list[Measurement] = [
    ImuSamples(20, np.array([10, 20]), np.zeros((2, 3)), np.zeros((2, 3))),
    GnssFix(5, np.zeros(3), np.eye(3)),
    WheelIncrement(20, since_ns=10, distance_m=-0.3),
    LaserScan(20, TimedPoints(np.array([20, 5]), np.zeros((2, 3)))),
]


@pytest.mark.parametrize("measurement", FINE, ids=lambda m: m.kind)
def test_other_measurements_have_no_images(measurement: Measurement) -> None:
    assert not images_of(measurement) and main_image(measurement) is None
    with pytest.raises(InputError, match=f"not on a measurement of the kind '{measurement.kind}'"):
        require_frame(measurement, frozenset({"video"}))


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        (ImuSamples, (20, np.array([20, 10]), np.zeros((2, 3)), np.zeros((2, 3)))),
        (ImuSamples, (30, np.array([10, 20]), np.zeros((2, 3)), np.zeros((2, 3)))),
        (ImuSamples, (20, np.array([10, 20]), np.zeros((2, 3)), np.zeros((3, 3)))),
        (ImuSamples, (20, np.array([10, 20]), np.full((2, 3), np.nan), np.zeros((2, 3)))),
        (GnssFix, (5, np.zeros(2), np.eye(3))),
        (GnssFix, (5, np.array([np.inf, 0, 0]), np.eye(3))),
        (GnssFix, (5, np.zeros(3), np.diag([1.0, 1.0, 0.0]))),
        (WheelIncrement, (10, 10, 1.0)),
        (WheelIncrement, (10, 5, np.nan)),
        (LaserScan, (10, TimedPoints(np.array([11]), np.zeros((1, 3))))),
    ],
)
def test_what_no_sensor_measures_is_refused(kind: type, values: tuple[Any, ...]) -> None:
    with pytest.raises(ValueError, match=r"must|finite|increase"):
        kind(*values)


def test_a_rig_is_made_of_named_sensors() -> None:
    rig = Rig.of(front=CAMERA, rig_from_front=HIGH, front_sigma=LensSigma(0.01, 0.0), gnss=GnssAntenna())
    assert rig.camera("front") == CAMERA and rig.video is None and not rig.has_stereo
    assert rig.has("gnss") and rig.has("cameras") and not rig.has("video") and not rig.has("imu")
    np.testing.assert_array_equal(rig.rig_from("front").matrix, HIGH.matrix)
    sensor = rig.sensors["front"]
    assert isinstance(sensor, CameraSensor) and sensor.sigma == LensSigma(0.01, 0.0)
    other = rig.changed(front=CAMERA.scaled(0.5))
    np.testing.assert_array_equal(other.rig_from("front").matrix, HIGH.matrix)
    assert other.sensors["gnss"] is rig.sensors["gnss"] and rig.camera("front") == CAMERA
    assert set(rig.changed(gnss=None).sensors) == {"front"}


@pytest.mark.parametrize(
    ("values", "fault"),
    [({"rig_from_gnss": HIGH}, KeyError), ({"gnss": 3.0}, TypeError), ({"gnss": HIGH}, TypeError)],
)
def test_a_rig_refuses_what_is_no_sensor(values: dict[str, Any], fault: type[Exception]) -> None:
    with pytest.raises(fault):
        Rig.of(**values)
    with pytest.raises(KeyError, match="gnss"):
        Rig.of(video=CAMERA).rig_from("gnss")


def test_a_rig_takes_over_the_others_of_another() -> None:
    pair = PairSigma(0.1, 0.2, 0.0, 0.0, 0.0, 0.0)
    other = Rig.of(video=CAMERA, video_sigma=LensSigma(0.01, 0.0), pair_sigma=pair, imu=Imu(gyroscope_noise=0.5))
    found = Rig.stereo(CAMERA, 0.4).changed(video=CAMERA).with_others_of(other)
    assert set(found.sensors) == {"imu", "left", "right", "video"}
    assert (found.video_sigma, found.pair_sigma) == (LensSigma(0.01, 0.0), pair)


class Sonar(Sensor):
    kind = "sonar"


class Echo(Measurement):
    @property
    def kind(self) -> str:
        return "sonar"


def test_a_package_may_add_a_kind_of_sensor() -> None:
    rig = doubles.rig().changed(sonar=Sonar())
    method = Method("bat", frozenset({"video", "sonar"}), Config, "own", "nobody")
    assert method.possible(rig) and method.missing(doubles.rig()) == ["sonar"]
    assert method.uses(Echo(3)) and method.uses(Frame.video(3, GREY)) and not method.uses(FINE[1])
    without = Method("bat", frozenset({"video", "sonar"}), Config, "own", "nobody", optional=frozenset({"sonar"}))
    assert without.possible(doubles.rig())


def test_others_come_before_frames_of_the_same_time_and_are_truncated_with_them() -> None:
    plain = doubles.sequence(10)
    prepared = list[int]()
    plain = type(plain)("p", plain.rig, plain.times_ns, plain.kinds, plain.load, prepare=prepared.append)
    fixes = [GnssFix(int(t), np.zeros(3), np.eye(3)) for t in plain.times_ns[::3]]
    fixes.append(GnssFix(int(plain.times_ns[-1]) + 1, np.zeros(3), np.eye(3)))
    found = plain.with_measurements(fixes[::-1])
    assert len(found) == len(plain) + len(fixes) and (np.diff(found.times_ns) >= 0).all()
    for i in range(len(found)):
        assert (found[i].time_ns, found[i].kind) == (found.times_ns[i], found.kinds[i])
    for i in np.flatnonzero(np.diff(found.times_ns) == 0).tolist():
        assert found.kinds[i] == "gnss"
    frames = [found[i].time_ns for i, kind in enumerate(found.kinds) if kind != "gnss"]
    assert frames == plain.times_ns.tolist()
    assert found.prepare is not None
    for i in range(len(found)):
        found.prepare(i)
    assert prepared == [sum(kind != "gnss" for kind in found.kinds[: i + 1]) for i in range(len(found) - 2)]
    assert len(found.truncated(3)) == 3


def test_a_sequence_of_times_that_decrease_is_refused() -> None:
    plain = doubles.sequence(4)
    with pytest.raises(ValueError, match="must not decrease"):
        type(plain)("p", plain.rig, plain.times_ns[::-1].copy(), plain.kinds, plain.load)


@pytest.mark.parametrize("name", methods.BUILT_IN)
def test_built_in_methods_refuse_other_measurements_by_a_sentence(name: str) -> None:
    rig = doubles.rig().changed(wheel=WheelOdometer())
    estimator: Any = methods.method(name).config().build(rig)
    inputs = ({},) if methods.method(name).asks else ()
    for measurement in (*FINE, Frame(3, {"back": GREY})):
        with pytest.raises(InputError, match="steps on"):
            estimator.step(estimator.start(), measurement, *inputs)


def test_stereo_refuses_a_frame_of_the_same_time() -> None:
    sequence = doubles.sequence(30)
    ensemble = build(Config(), ("stereo",), sequence.rig)
    frames = [sequence[i] for i, kind in enumerate(sequence.kinds) if kind == "stereo"]
    state, _ = ensemble.step(ensemble.start(), frames[0])
    state, _ = ensemble.step(state, frames[1])
    with pytest.raises(InputError, match="not later"):
        ensemble.step(state, frames[1])


def test_a_missing_sensor_is_named() -> None:
    method = Method("wheels", frozenset({"video", "wheel", "sonar"}), Config, "own", "nobody")
    methods.add(method)
    try:
        with pytest.raises(InputError, match=r"wheels needs .*sonar"):
            require_sensors(("wheels",), doubles.rig())
    finally:
        methods.REGISTRY.remove(method)
