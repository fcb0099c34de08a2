"""`ispom sources`: what is seen in a recording, in words."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ispom_app.cli.main import main
from ispom_app.features.sources.description import described

from ispom.sequences import open_sequence
from tests import doubles
from tests.alone import METHODS, PAPER
from tests.sequences.folders import MAKERS, make_euroc
from tests.sequences.own_folders import make_images


def test_cameras_rates_truth_and_notes_are_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sources", str(make_euroc(tmp_path))]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert printed[0] == "EuRoC V9"
    text = " ".join(" ".join(printed).split())
    assert all(part in text for part in ("96 x 64 px", "0.11 m", "6 pairs", "20 Hz")) and "no distortion" in text
    assert all(
        part in text for part in ("span 0.250 s", "2014-06-25 16:54:33 UTC", "gaps none", "12 of 12", "path 0.250 m")
    )
    assert ", ".join((*METHODS, *PAPER)) in text
    assert "note Emulated" in text


def test_gaps_and_uneven_rates_are_reported() -> None:
    sequence = doubles.sequence(30)
    video = np.flatnonzero(np.array(sequence.kinds) == "video")
    times_ns = sequence.times_ns.copy()
    times_ns[video[10] :] += 500_000_000
    text = "\n".join(described(replace(sequence, times_ns=times_ns, truth=None)))
    assert "30 Hz" in text and "not even" in text and "0.533 s at 0.300 s" in text
    assert "truth   none" in text and "distortion -0.05, 0.01, 0, 0" in text and doubles.sequence().notes[0] in text


@pytest.mark.parametrize("kind", MAKERS)
def test_every_kind_is_reported(kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sources", str(MAKERS[kind](tmp_path / "made"))]) == 0
    assert "methods monocular" in capsys.readouterr().out


def test_measurements_of_sensors_are_counted_not_their_batches(capsys: pytest.CaptureFixture[str]) -> None:
    words = "sensor=imu:rate_hz=200&sensor=gnss:rate_hz=5&sensor=wheel:rate_hz=20"
    assert main(["sources", f"sim:tiny?motion=drive&{words}"]) == 0
    lines = {line.split()[0]: " ".join(line.split()[1:]) for line in capsys.readouterr().out.splitlines()[1:]}
    seconds = float(lines["span"].split()[0])
    for name, hz in (("imu", 200), ("gnss", 5), ("wheel", 20)):
        count, _, rate, unit = lines[name].split()
        assert (rate, unit) == (str(hz), "Hz") and abs(int(count) - hz * seconds) <= 2


def test_what_is_likely_a_mistake_is_a_note(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = make_euroc(tmp_path)
    pose = "{translation_m: [0, 0, 700], rotation_xyzw: [0, 0, 0, 1]}"
    rows = "".join(f"{1403715273.0 + k / 10:.1f},{k},0,0\n" for k in range(8))
    (tmp_path / "gps.csv").write_text(f"time_s,x,y,z\n{rows}")
    times = open_sequence(str(source)).times_ns
    offset_s = float(times[0]) * 1e-9 - 1403715273.0
    (tmp_path / "sensors.yaml").write_text(
        f"gnss: {{file: gps.csv, rig_from_gnss: {pose}, sigma_m: 500, clock_offset_s: {offset_s:.3f}}}"
    )
    assert main(["sources", str(source), "--sensors", str(tmp_path / "sensors.yaml")]) == 0
    notes = [line for line in capsys.readouterr().out.splitlines() if line.startswith("  note")]
    assert sum("500" in note for note in notes) == 1 and sum("700" in note for note in notes) == 1


def test_what_is_no_source_is_reported_in_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sources", str(tmp_path / "nowhere")]) == 2
    assert "does not exist" in capsys.readouterr().err


def test_names_cannot_write_to_the_terminal_what_they_like(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sources", str(make_images(tmp_path / "\x1b[2Jgone").rename(tmp_path / "\x1b[2J"))]) == 0
    out = capsys.readouterr().out
    assert "\\x1b[2J" in out and "\x1b" not in out
