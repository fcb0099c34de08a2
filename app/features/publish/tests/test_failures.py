"""Ways to fail that are published: each run has the doctor's answer, in the list and on its page."""

from __future__ import annotations

import gzip
import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from ispom_app.features.publish.gallery.failures import FAILURES, Failure, failures_data
from ispom_app.features.publish.site import page_files, write_site

from ispom.ensemble import build as real
from tests.app.helpers import build_full
from tests.app.page.test_browser import CHROMIUM, FAKE, Page, browser  # noqa: F401 - a fixture
from tests.sequences.kitti_folder import make_drive

from .conftest import FRAMES
from .test_in_browser import served

FOUND = {
    "rotation": "no-parallax",
    "plane": None,
    "darkness": "darkness",
    "shutter": "rolling-shutter",
    "focal": "video-focal",
    "swapped": "exchanged",
    "clock": "clock",
    "object": "moving-objects",
}
"""The key of the cause that the doctor names first; None where it finds none, and says so."""


def read(files: Mapping[str, bytes], name: str) -> Any:
    return json.loads(gzip.decompress(files[f"{name}.bin"]))


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Of two runs."""
    drive = str(make_drive(tmp_path_factory.mktemp("dull"), FRAMES))
    dull = Failure("dull", "Dull", "Nothing to see.", drive, ("stereo",))
    return failures_data(build_full, 1e7, (dull, replace(dull, name="dim", title="Dim")))


def test_each_run_has_the_doctors_answer(files: dict[str, bytes]) -> None:
    listed = read(files, "site")["listed"][0]
    assert listed["name"] == read(files, "site")["first"] == "dull"
    run = read(files, "dull/run")
    doctor = run["panels"]["first"]["doctor"]
    first, last = doctor["stretch"]
    assert first <= listed["at"] <= last and (doctor["causes"] or doctor["answer"])
    assert listed["answer"] and run["message"]["address"]["run"] == "dull"
    assert {"dull/stage.bin", "dull/panels-0.bin", "dull/numbers.bin"} <= files.keys()


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")
def test_a_click_opens_a_run_with_the_answer_and_another_leads_back(
    browser,  # noqa: F811
    files: dict[str, bytes],
    tmp_path: Path,
) -> None:
    data = {f"data/{name}": content for name, content in files.items()}
    write_site(tmp_path, page_files(1, "failures") | data)
    listed = read(files, "site")["listed"][1]
    with served(tmp_path) as url:
        page = Page(browser, url, viewer=FAKE)
        page.tab.locator("#learn [data-run=dim]", has_text=listed["answer"]).click()
        page.until(f"state.source === 'dim' && state.index === {listed['at']}", "the run")
        page.tab.locator("#panels [data-cause] [role=status]").wait_for()
        assert not page.tab.locator("#panels [data-cause] button.act").is_visible(), "it examines nothing"
        page.until(f"location.hash === '#run=dim&at={listed['at']}&mode=debug'", "the address")
        page.tab.locator("#modes label", has_text="Gallery").click()
        page.tab.locator("#learn [data-run=dull]").click()
        page.until("state.source === 'dull' && state.address.run === 'dull'", "the other run")
        assert not page.faults
        page.tab.close()


def test_there_are_eight_each_with_its_own_name() -> None:
    assert {failure.name for failure in FAILURES} == FOUND.keys() and len(FAILURES) == 8


@pytest.mark.slow
@pytest.mark.parametrize("failure", FAILURES, ids=lambda failure: failure.name)
def test_the_doctor_names_the_fault_that_there_is(failure: Failure) -> None:
    files = failures_data(real, 1e7, (failure,))
    found = read(files, f"{failure.name}/run")["message"]["doctor"]["causes"]
    assert (found[0] if found else None) == FOUND[failure.name]


def test_failures_have_no_runs_of_others(publish: Callable[..., int], runs: tuple[Path, Path], tmp_path: Path) -> None:
    assert publish(runs[0], "--failures", "--out", tmp_path / "site") == 2
    assert publish("--failures", "--lessons", "--out", tmp_path / "site") == 2
    assert not (tmp_path / "site").exists()
