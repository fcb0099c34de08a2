"""What is saved of a view: the numbers as they are shown."""

from __future__ import annotations

import csv
from dataclasses import replace
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from ispom_app.engine.model.corrections import corrected_by
from ispom_app.engine.playback import Playback
from ispom_app.session.current_run import CurrentRun
from ispom_app.views.web.numbers import of_exposure, over_time

from ispom.io.rig import read_rig
from ispom.types import Corrections, LensCorrection
from tests import doubles
from tests.alone import METHODS
from tests.app.helpers import build_full, run_to_end
from tests.app.page.test_browser import CHROMIUM, FAKE, App, Page, app, browser  # noqa: F401 - fixtures


@pytest.fixture
def run() -> CurrentRun:
    return run_to_end(Playback(doubles.sequence(20), METHODS, builder=build_full))


def test_the_numbers_over_time_are_the_quantities_to_the_last_bit(run: CurrentRun) -> None:
    rows = list(csv.DictReader(StringIO(over_time(run.series, len(run.series)))))
    assert len(rows) == len(run.history)
    for name in rows[0]:
        quantity, values = run.series.quantities[name], run.series.values(name)
        if quantity.kind != "text":
            np.testing.assert_array_equal([float(row[name] or "nan") for row in rows], values)
        else:
            assert [row[name] or None for row in rows] == [run.series.value(quantity, i) for i in range(len(rows))]
    with_values = {n for n in run.series.quantities if np.isfinite(run.series.values(n)).any()}
    assert set(rows[0]) == with_values


def test_the_numbers_of_an_exposure_are_those_with_a_value_and_their_units(run: CurrentRun) -> None:
    rows = {row["quantity"]: row for row in csv.DictReader(StringIO(of_exposure(run.series, 7)))}
    assert rows["exposure"]["value"] == "7" and rows["time_s"]["unit"] == "s"
    error = run.series.value(run.series.quantities["stereo.error_m"], 7)
    assert float(rows["stereo.error_m"]["value"]) == error and rows["stereo.error_m"]["unit"] == "m"
    assert "monocular.parallax.passed" not in rows or rows["monocular.parallax.passed"]["value"] in ("0", "1")


def test_the_rig_is_as_the_newest_corrections_before_an_exposure_say(run: CurrentRun, tmp_path: Path) -> None:
    rig, path = run.opened.sequence.rig, tmp_path / "rig.yaml"
    text = corrected_by(run.history, 7, rig)
    assert text.startswith("# No method had corrected anything by then.")
    path.write_text(text)
    assert read_rig(path).video == rig.video
    record = run.history[3]
    lens = Corrections(lens=LensCorrection.of(np.array([0.02, 0.0]), np.diag([1e-3, 1e-3]) ** 2))
    corrected = replace(record, steps=(replace(record.steps[0], calibration=lens), *record.steps[1:]))
    path.write_text(corrected_by({i: corrected if i == 3 else run.history[i] for i in range(8)}, 7, rig))
    assert read_rig(path).video.fx == pytest.approx(1.02 * rig.video.fx, rel=1e-4)


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")
def test_the_numbers_are_downloaded(browser, app: App) -> None:  # noqa: F811
    page = Page(browser, app.url, viewer=FAKE)
    page.until("state.ended && !state.playing", "the end")
    page.send("{do: 'seek', index: 12}")
    page.until("state.index === 12", "the frame")
    found = {}
    for name in ("Numbers of this frame", "All quantities"):
        page.tab.get_by_role("button", name="save this view").click()
        with page.tab.expect_download() as download:
            page.tab.locator("#save").get_by_text(name).click()
        page.tab.locator("#save").wait_for(state="hidden")
        found[download.value.suggested_filename] = Path(download.value.path()).read_bytes()
    assert list(found) == ["double-40-12.csv", "double-40.csv"]
    assert found["double-40-12.csv"].decode().splitlines()[1] == "exposure,12,,counted from 0"
    assert len(found["double-40.csv"].decode().splitlines()) == 45
    assert not page.faults
    page.tab.close()
