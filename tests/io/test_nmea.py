"""GGA sentences: positions, times past midnight, checksums, and sentences for what is damaged."""

from __future__ import annotations

import contextlib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ispom.errors import InputError
from ispom.io.nmea import DAY_NS, Gga, checksum, gga_of, read_gga


def sentence(time: str, latitude: float, longitude: float, height: float, quality: int = 1, hdop: float = 0.9) -> str:
    """Returns a GGA sentence with its checksum."""

    def angle(value: float, digits: int, sides: str) -> str:
        degrees, minutes = divmod(round(abs(value) * 60 * 10**6), 60 * 10**6)
        return f"{degrees:0{digits}d}{minutes / 10**6:09.6f},{sides[value < 0]}"

    place = f"{angle(latitude, 2, 'NS')},{angle(longitude, 3, 'EW')}"
    body = f"GPGGA,{time},{place},{quality},08,{hdop},{height:.3f},M,47.000,M,,"
    return f"${body}*{checksum(body):02X}"


def test_a_known_sentence() -> None:
    fix = gga_of("$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47")
    assert fix is not None
    assert (fix.latitude_deg, fix.longitude_deg) == pytest.approx((48 + 7.038 / 60, 11 + 31 / 60))
    assert fix.height_m == pytest.approx(592.3)
    assert fix.time_of_day_ns == (12 * 3600 + 35 * 60 + 19) * 10**9
    assert fix.sigma_m == pytest.approx([4.5, 4.5, 6.75])


@given(st.floats(-89.9, 89.9), st.floats(-179.9, 179.9), st.floats(-400, 9000), st.integers(1, 5))
def test_what_is_written_is_read(latitude: float, longitude: float, height: float, quality: int) -> None:
    fix = gga_of(sentence("000001.50", latitude, longitude, height, quality))
    assert isinstance(fix, Gga)
    assert fix.latitude_deg == pytest.approx(latitude, abs=2e-8)
    assert fix.longitude_deg == pytest.approx(longitude, abs=2e-8)
    assert fix.height_m == pytest.approx(height + 47, abs=1e-3)
    assert fix.time_of_day_ns == 1_500_000_000


@given(st.text(max_size=100))
def test_any_text_is_a_fix_or_none_or_refused(text: str) -> None:
    for line in (text, f"$GPGGA,{text}"):
        with contextlib.suppress(ValueError):
            assert gga_of(line) is None or isinstance(gga_of(line), Gga)


def test_midnight_and_damage(tmp_path: Path) -> None:
    path = tmp_path / "a.nmea"
    good = [sentence("235959.00", 49, 8, 100), "$GPRMC,x", sentence("000000.00", 49, 8, 100, 0)]
    path.write_text("\n".join([*good, sentence("000001.00", 49, 8, 100)]))
    times, fixes = read_gga(path)
    assert (len(fixes), times[1] - times[0], times[1] > DAY_NS) == (2, 2 * 10**9, True)
    path.write_text("\n".join([*good, sentence("000001.00", 49, 8, 100).replace("*", "1*")]))
    with pytest.raises(InputError, match=r"line 4: .*GGA.*checksum"):
        read_gga(path)
    path.write_text("$GPRMC,1\n")
    with pytest.raises(InputError, match="no GGA"):
        read_gga(path)
