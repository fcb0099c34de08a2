"""The study `soak`: runs without end and what is measured of them. No time is asserted."""

from __future__ import annotations

import json
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from ispom.methods import method as registered
from ispom.methods import names
from ispom.types import is_stereo, is_video
from tests.accuracy import child, soak
from tests.accuracy.__main__ import main
from tests.app import helpers
from tests.rounds import LAP, SCENARIOS, STOP, Scenario


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda s: f"{'+'.join(sorted(s.kinds))} {s.name}")
def test_a_sequence_holds_what_the_stream_gives(scenario: Scenario) -> None:
    count = 2 * STOP
    sequence = scenario.sequence(count)
    assert len(sequence) == count and (np.diff(sequence.times_ns) >= 0).all()
    for i, exposure in zip(range(count), islice(scenario.exposures(), count), strict=True):
        assert exposure.time_ns == sequence.times_ns[i]
        assert is_stereo(exposure) == (sequence.kinds[i] == "stereo")
        if i % 97 == 0:
            again = sequence[i]
            assert type(again) is type(exposure)
            pixels = [e.image if is_video(e) else e.left for e in (again, exposure)]
            np.testing.assert_array_equal(*pixels)


def test_images_come_again_after_a_round_and_end_where_they_should() -> None:
    moving, blank = (
        next(s for s in SCENARIOS if s.kinds == {"video"} and s.name == n) for n in ("moving", "goes blank")
    )
    images = [e.image for e in islice(moving.exposures(), LAP + 4) if is_video(e)]
    np.testing.assert_array_equal(images[3], images[LAP + 3])
    assert (images[3] != images[4]).any()
    last = [e.image for e in islice(blank.exposures(), STOP + 2) if is_video(e)][-1]
    assert np.ptp(last) == 0
    ended = next(s for s in SCENARIOS if s.pairs_end).sequence(3 * STOP)
    assert "stereo" in ended.kinds[:STOP] and "stereo" not in ended.kinds[2 * STOP :]


def test_every_method_has_its_scenarios() -> None:
    of_images = [name for name in names() if registered(name).sensors <= {"video", "stereo"}]
    assert all(map(soak.scenarios, of_images))


def test_time_and_memory_of_a_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(soak, "EARLY", 100)
    monkeypatch.setattr(soak, "LAST", 100)
    found = soak.soaked("integrated", soak.scenarios("integrated")[0], 400, helpers.build)
    assert found["early_ms"] > 0 and found["last_ms"] > 0 and found["located_percent"] == 100
    assert found["half_mb"] > 20 and 20 < found["last_mb"] < 10_000


def test_rows_are_printed_and_written(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def measured_elsewhere(module: str, task: dict, path: Path) -> dict:
        assert module == "tests.accuracy.soak" and task["exposures"] == 5000
        if task["scenario"] == "still":
            return {"error": "failed, please report it: why"}
        times = {"early_ms": 4.0, "last_ms": 5.0 if task["scenario"] == "stops" else 4.0}
        return times | {"exposures": 5000, "half_mb": 200.0, "last_mb": 201.0, "located_percent": 99.0}

    monkeypatch.setattr(child, "found", measured_elsewhere)
    written = tmp_path / "soak.json"
    arguments = ["soak", "--frames", "5000", "--methods", "monocular", "--json", str(written)]
    assert main(arguments) == main(arguments) == 0
    printed = capsys.readouterr().out
    assert "1.25 !" in printed and "1.00" in printed and "monocular, still: failed" in printed
    rows = json.loads(written.read_text())
    assert [row["scenario"] for row in rows] == ["moving", "still", "stops", "goes blank"]
    with pytest.raises(SystemExit):
        main(["soak", "--frames", "100"])
