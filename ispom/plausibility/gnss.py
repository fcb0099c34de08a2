"""Whether the fixes of a GNSS receiver can be positions of a camera's carrier."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array
from ispom.plausibility.doubt import Doubt
from ispom.plausibility.imu import turned_about_up

NULL_DEG = 1e-7
"""Nearer to 0, 0 (1 cm) no fix is: receivers write that where they have none."""
NEAR_DEG = 1.0
"""If another fix is as near to it as this, the recording is of that place."""
NEAR_NULL_DEG = 0.02
"""Radians up to this are places within 1.2 degrees of 0, 0: then nothing tells the two apart."""
HIGHEST_M, LOWEST_M = 50_000.0, -1_000.0
"""Balloons fly up to 50 km; the lowest land is at -430 m, and geoids lie up to 110 m below the ellipsoid."""
FASTEST_M_S = 400.0
"""No airliner is as fast over ground (340 m/s in a jet stream)."""
JUMP_M, JUMP_RATIO = 5_000.0, 10.0
"""Length above which a step is a jump already where its speed exceeds this multiple of the usual speed. A shorter step
is a jump only above FASTEST_M_S."""
FAR_M = 50_000.0
"""The first fix lies near the origin of a local frame: at 50 km, its plane is 200 m above the ground."""
EARTH_M = (6.33e6, 6.42e6)
"""Distances from the Earth's centre to its surface, and planes."""
UTM_EAST, UTM_NORTH = (100_000.0, 900_000.0), (0.0, 10_000_000.0)
"""[m] of the coordinates of UTM."""
SIGMA_M = (5e-4, 100.0)
"""Fixed ambiguities give 5 to 20 mm, static ones 1 mm; receivers without any correction 3 to 30 m."""
TURNING_RAD, OPPOSITE, LEAST_STEPS = 0.3, -0.8, 8
"""Least standard deviation of headings, correlation with those of the IMU, and number of steps, for a mirrored path: a
random one of 8 steps is as contrary once in 100."""


def geodetic_doubts(where: str, geodetic: Array) -> tuple[tuple[Doubt, ...], bool]:
    """Returns doubts about latitude, longitude [deg] and height [m] (N, 3), and whether they can be no place on
    Earth."""
    fixes = geodetic[~null_fixes(geodetic)]
    if not len(fixes):
        return (
            Doubt("gnss_all_zero", f"{where}: all {len(geodetic)} fixes are at 0, 0: give those of the recording."),
        ), False
    lat, lon = np.abs(fixes[:, 0]), np.abs(fixes[:, 1])
    if lat.max() > 90 or lon.max() > 360:
        i = int(np.argmax(np.maximum(lat / 90, lon / 360)))
        begin = f"{where}: latitude {fixes[i, 0]:.7g}, longitude {fixes[i, 1]:.7g} is no place on Earth"
        if (
            (lat < 9000).all()
            and (lon < 18000).all()
            and ((lat % 100 < 60) & (lon % 100 < 60)).all()
            and lat.max() > 180
        ):
            return (Doubt("latitude_in_minutes", f"{begin}: this looks like DDMM.MM; give degrees."),), True
        if lat.max() <= 360 and lon.max() <= 90:
            return (Doubt("latitude_longitude_swapped", f"{begin}: they look exchanged; name lat and lon."),), True
        return (Doubt("latitude_impossible", f"{begin}: give degrees, up to 90 and 180."),), True
    out = []
    if len(fixes) < len(geodetic):
        text = f"{where}: {len(geodetic) - len(fixes)} of {len(geodetic)} fixes are at 0, 0, as receivers write them "
        out.append(Doubt("gnss_null_fix", f"{text}without a fix: they are left out; remove those lines."))
    if lat.max() <= np.pi / 2 and lon.max() <= np.pi and max(lat.max(), lon.max()) > NEAR_NULL_DEG:
        text = f"{where}: all fixes are near latitude {fixes[0, 0]:.3g}, longitude {fixes[0, 1]:.3g}, in the sea off "
        text += (
            f"Africa: this looks like radians ({np.degrees(fixes[0, 0]):.4g}, {np.degrees(fixes[0, 1]):.4g} degrees)"
        )
        out.append(Doubt("latitude_in_radians", f"{text}; give degrees, if so."))
    height = float(fixes[np.argmax(np.abs(fixes[:, 2])), 2])
    if not LOWEST_M <= height <= HIGHEST_M:
        text = f"{where}: a height of {height:.4g} m is outside the atmosphere: this looks like millimetres"
        out.append(Doubt("height_impossible", f"{text}; give metres."))
    return tuple(out), False


def null_fixes(geodetic: Array) -> NDArray[np.bool_]:
    """Returns (N,) which fixes are at latitude 0, longitude 0; none where others are near it."""
    off = np.abs(geodetic[:, :2]).max(axis=1)
    null = off < NULL_DEG
    there = not null.all() and off[~null].min() < NEAR_DEG
    return np.zeros(len(off), bool) if there else null


def gnss_doubts(
    where: str, times_ns: NDArray[np.int64], xyz: Array, sigma: Array, null: NDArray[np.bool_] | None = None
) -> tuple[Doubt, ...]:
    """Returns doubts about times (N,), local positions (N, 3) [m] and their standard deviations (N, 3) [m].

    `null` (N,) are fixes that were at 0, 0.
    """
    out, stated = [], float(np.median(sigma))
    if stated < SIGMA_M[0]:
        text = f"{where}: its standard deviation is {stated:.3g} m (median), which no receiver reaches"
        out.append(Doubt("sigma_small", f"{text}: give metres."))
    if stated > SIGMA_M[1]:
        text = f"{where}: its standard deviation is {stated:.3g} m (median), with which a fix says nothing"
        out.append(Doubt("sigma_large", f"{text}: give metres, or leave the sensor out."))
    good = np.ones(len(xyz), bool) if null is None else ~null
    times_ns, xyz = times_ns[good], xyz[good]
    if not len(xyz):
        return tuple(out)
    if null is None and len(xyz) > 1 and not xyz.any():
        return (*out, Doubt("gnss_all_zero", f"{where}: all {len(xyz)} positions are 0, 0, 0: give those measured."))
    return (*out, *_far(where, xyz), *_jumps(where, times_ns, xyz))


def _far(where: str, xyz: Array) -> tuple[Doubt, ...]:
    nearest = float(np.linalg.norm(xyz[:, :2], axis=1).min())
    if nearest < FAR_M:
        return ()
    x, y, z = np.median(xyz, axis=0).tolist()
    begin = f"{where}: its positions are {nearest * 1e-3:.0f} km or more from the origin of the local frame"
    cure = "subtract the first position"
    if EARTH_M[0] < np.linalg.norm((x, y, z)) < EARTH_M[1] and abs(z) > EARTH_M[1] - EARTH_M[0]:
        text = f"{begin}: this looks like coordinates from the centre of the Earth; give lat, lon and height."
        return (Doubt("gnss_earth_centred", text),)
    ranges = UTM_EAST, UTM_NORTH
    for a, b, order in ((x, y, "x east and y north"), (y, x, "x north and y east")):
        if ranges[0][0] < a < ranges[0][1] and ranges[1][0] < b < ranges[1][1]:
            return (Doubt("gnss_utm", f"{begin}: this looks like UTM ({order}); {cure}, with x east and y north."),)
    return (Doubt("gnss_far", f"{begin}: {cure}, or correct `origin`."),)


def _jumps(where: str, times_ns: NDArray[np.int64], xyz: Array) -> tuple[Doubt, ...]:
    if len(xyz) < 2:
        return ()
    steps, seconds = np.linalg.norm(np.diff(xyz, axis=0), axis=1), np.diff(times_ns) * 1e-9
    speeds = steps / seconds
    usual = float(np.median(speeds))
    wild = (steps > JUMP_M) & (speeds > JUMP_RATIO * usual + 20) if len(steps) > 2 else np.zeros(len(steps), bool)
    jumps = np.flatnonzero(((speeds > FASTEST_M_S) & (steps > 100)) | wild)
    if not len(jumps):
        return ()
    i = int(jumps[np.argmax(steps[jumps])])
    text = (
        f"{where}: {len(jumps)} of {len(steps)} steps are jumps, the largest of {steps[i]:.4g} m in {seconds[i]:.3g} s"
    )
    return (Doubt("gnss_jump", f"{text} at {times_ns[i] * 1e-9:.3f} s: remove the wrong fixes, or check the unit."),)


def mirrored_doubts(
    where: str,
    times_ns: NDArray[np.int64],
    xyz: Array,
    sigma: Array,
    imu: tuple[NDArray[np.int64], Array, Array],
) -> tuple[Doubt, ...]:
    """Returns a doubt where the path of fixes turns to the other side than the IMU (times, rates, forces): a mirror
    image, as of exchanged axes."""
    imu_ns, rates, forces = imu
    inside = (times_ns >= imu_ns[0]) & (times_ns <= imu_ns[-1]) if len(imu_ns) > 10 else np.zeros(len(times_ns), bool)
    times_ns, xyz, sigma = times_ns[inside], xyz[inside], sigma[inside]
    keep, last = [0], 0
    for i in range(1, len(xyz)):
        if np.linalg.norm(xyz[i, :2] - xyz[last, :2]) > max(2.0, 6 * float(sigma[i, :2].max())):
            keep.append(i)
            last = i
    if len(keep) < LEAST_STEPS + 2:
        return ()
    steps = np.diff(xyz[keep, :2], axis=0)
    middles = (times_ns[keep][1:] + times_ns[keep][:-1]) // 2
    course = np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])))
    turned = np.diff(turned_about_up(imu_ns, rates, forces, middles))
    if min(np.abs(course).sum(), np.abs(turned).sum()) < 2 * TURNING_RAD:
        return ()
    alike = float(np.corrcoef(course, turned)[0, 1])
    if not alike < OPPOSITE:
        return ()
    text = (
        f"{where}: its path turns to the right where the IMU turns to the left (correlation {alike:.2f}): this looks "
    )
    return (Doubt("gnss_mirrored", f"{text}like exchanged latitude and longitude, or x and y; or z points down."),)
