"""Laser scans from files: what a scanner measured comes back scan by scan, whatever its direction and field of view."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ispom.errors import InputError
from ispom.io.timed_points import holds_points, read_timed_points, timed_points_csv
from ispom.sensors import SENSOR_KINDS
from ispom.sensors.laser import SimulatedLaser, sweeps
from ispom.sensors.simulated import Scenery
from ispom.sequences.sensors_yaml import with_sensors
from ispom.simulation.motions import motion_of
from ispom.simulation.places.city import build_city
from ispom.types import LaserScan, Sequence, TimedPoints
from tests import doubles

POSE = "{translation_m: [0, 0.3, 0], rotation_xyzw: [0.5, -0.5, 0.5, 0.5]}"
KIND = SENSOR_KINDS.get("laser")


def scans_of(sequence: Sequence) -> list[LaserScan]:
    return [m for m in (sequence[i] for i, k in enumerate(sequence.kinds) if k == "laser") if isinstance(m, LaserScan)]


def opened(folder: Path, content: str, entry: str = "", base: Sequence | None = None) -> Sequence:
    (folder / "scans.csv").write_text(content)
    (folder / "sensors.yaml").write_text(f"laser: {{file: scans.csv, rig_from_laser: {POSE}{entry}}}\n")
    return with_sensors(base or doubles.sequence(), folder / "sensors.yaml")


def simulated(noise_m: float) -> list[LaserScan]:
    """Of 2 s of a flight, with points of their own times."""
    scene, sensor = build_city(0), replace(SimulatedLaser(points=180), noise_m=noise_m)
    around = Scenery(motion_of("flight", 0).pose_at, np.array([0, 2_000_000_000]), lambda: scene, 3)
    return [m for m in sensor.measured(around) if isinstance(m, LaserScan)]


@pytest.mark.parametrize("noise_m", [0.0, 0.05])
def test_scans_of_a_file_of_points_are_those_that_were_measured(noise_m: float, tmp_path: Path) -> None:
    true = simulated(noise_m)
    everything = TimedPoints(
        np.concatenate([scan.points.times_ns for scan in true]),
        np.concatenate([scan.points.xyz_in_laser for scan in true]),
    )
    (tmp_path / "points.csv").write_text(timed_points_csv(everything))
    assert holds_points(tmp_path / "points.csv")
    read = KIND.readings_of_points(read_timed_points(tmp_path / "points.csv"))
    found = [m for m in KIND.measurements(read, np.array([0, 2_000_000_000]), "laser") if isinstance(m, LaserScan)]
    # the simulated scanner begins in the middle of what is one turn of azimuths, -180 to 180 degrees
    assert abs(len(found) - len(true)) <= 1
    times_ns = np.concatenate([scan.points.times_ns for scan in found])
    xyz = np.concatenate([scan.points.xyz_in_laser for scan in found])
    assert np.array_equal(times_ns, everything.times_ns)
    np.testing.assert_allclose(xyz, everything.xyz_in_laser, atol=6e-5)
    assert all(scan.time_ns == scan.points.times_ns.max() for scan in found)


def test_a_table_of_ranges_is_a_scan_for_each_row(tmp_path: Path) -> None:
    rows = "0.1,2,0,4\n0.2,1,3,0\n"
    found = opened(tmp_path, f"time_s,-90,0,90\n{rows}", ", scan_s: 0.04, clock_offset_s: 0.01, range_noise_m: 0.05")
    one, other = scans_of(found)
    assert (one.time_ns, other.time_ns) == (150_000_000, 250_000_000)
    np.testing.assert_allclose(one.points.xyz_in_laser, [[0, -2, 0], [0, 4, 0]], atol=1e-12)
    assert one.points.times_ns.tolist() == [110_000_000, 150_000_000]
    np.testing.assert_allclose(other.points.xyz_in_laser, [[0, -1, 0], [3, 0, 0]], atol=1e-12)
    assert found.rig.rig_from("laser").translation.tolist() == [0, 0.3, 0]


@given(
    start_deg=st.floats(-180, 180),
    view_deg=st.floats(120, 360),
    forward=st.booleans(),
    missing=st.integers(0, 120),
    seed=st.integers(0, 9),
)
@settings(max_examples=60, deadline=None)
def test_a_scan_goes_one_way_and_is_less_than_a_turn(
    start_deg: float, view_deg: float, forward: bool, missing: int, seed: int
) -> None:
    """Of any scanner that begins anywhere, in which up to a third of the beams of a sweep in a row hit nothing."""
    beams, count, rng = 360, 4, np.random.default_rng(seed)
    angles = start_deg + np.linspace(0, view_deg, beams, endpoint=False) + rng.normal(0, 0.05, beams)
    angles = np.radians(angles if forward else -angles)
    hit = np.ones((count, beams), bool)
    for row in hit:
        at = rng.integers(1, beams - missing)
        row[at : at + missing] = False
    sweep, beam = np.nonzero(hit)
    xyz = np.stack([np.cos(angles[beam]), np.sin(angles[beam]), np.zeros(len(beam))], axis=1)
    found = sweeps((sweep * beams + beam) * 100_000, xyz)
    parts = [np.arctan2(xyz[found == k, 1], xyz[found == k, 0]) for k in range(found[-1] + 1)]
    assert count <= len(parts) <= 2 * count + 1  # those that see to the back are in two parts
    sign = 1 if forward else -1
    assert all((sign * np.diff(part) > -0.02).all() for part in parts)
    if not missing:
        assert all(0 <= sweep[found == k].max() - sweep[found == k].min() <= 1 for k in range(len(parts)))


def test_a_pause_ends_a_scan() -> None:
    angles = np.radians([0.0, 10, 20, 30, 40])
    xyz = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    assert sweeps(np.array([0, 1, 2, 2_000_000_003, 2_000_000_004]), xyz).tolist() == [0, 0, 0, 1, 1]


@given(text=st.text(alphabet='time_sxyz,0123456789.-e \n"#nai', max_size=120))
@settings(max_examples=150, deadline=None)
def test_any_text_is_scans_or_one_sentence(text: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("any", numbered=True)
    try:
        found = opened(folder, text)
    except InputError as fault:
        assert "\n" not in str(fault.args[0]) and len(fault.args[0]) > 10
    else:
        assert all(np.isfinite(scan.points.xyz_in_laser).all() for scan in scans_of(found))


@pytest.mark.parametrize(
    ("content", "entry", "said"),
    [
        ("time_s,left\n0.1,2\n", "", "'left', which is no angle"),
        ("time_s,0,400\n0.1,2,3\n", "", "'400', which is no angle"),
        ("time_s,0,90\n0.1,2,3\n0.1,2,3\n", "", "line 3: its time is not after"),
        ("time_s,0,90\n0.1,2\n", "", "line 2 has 2 columns, not 3"),
        ("time_s,x,y,z\n0.1,1,2,nan\n", "", "no finite coordinates"),
        ("x,y,z\n1,2,3\n", "", "has no time_s"),
        ("time_s,0,90\n0.1,2,3\n", ", scan_s: -1", "scan_s"),
        ("time_s,0,90\n99,2,3\n", "", "measured nothing within"),
    ],
)
def test_a_mistake_is_one_sentence(content: str, entry: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=said):
        opened(tmp_path, content, entry)


def test_the_pose_is_required(tmp_path: Path) -> None:
    (tmp_path / "scans.csv").write_text("time_s,0,90\n0.1,2,3\n")
    (tmp_path / "sensors.yaml").write_text("laser: {file: scans.csv}\n")
    with pytest.raises(InputError, match="rig_from_laser"):
        with_sensors(doubles.sequence(), tmp_path / "sensors.yaml")
