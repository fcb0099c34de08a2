"""The example of a front end in a package of its own: it keeps the contract, and a run uses it."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from tests.examples.conftest import FRAMES
from tests.examples.packages import EXAMPLES, install, python

ROOT = Path(__file__).parents[2]
EXAMPLE = EXAMPLES / "orb_front_end"
NAME = "orb-slam"


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return install(tmp_path_factory.mktemp("installed"), "orb_front_end")


def test_it_is_short() -> None:
    assert len((EXAMPLE / "orb_front_end.py").read_text().splitlines()) <= 80


def test_it_keeps_the_contract_of_front_ends(installed: Path) -> None:
    contract = ROOT / "tests" / "features" / "test_front_ends.py"
    found = python(installed, "-m", "pytest", "-n", "0", "-q", "-p", "no:cacheprovider", "-k", NAME, contract)
    assert found.returncode == 0, found.stdout  # 5 if no test is of this name


def test_a_run_uses_it(installed: Path, recording: Path, tmp_path: Path) -> None:
    words = ("-m", "ispom_app", "run", recording, "--methods", "monocular", "--no-recording")
    run = tmp_path / "run"
    found = python(installed, *words, "--monocular.features", NAME, "--out", run)
    assert found.returncode == 0, found.stderr
    assert yaml.safe_load((run / "run.yaml").read_text())["config"]["monocular"]["features"] == NAME
    assert len((run / "monocular.tum").read_text().splitlines()) >= FRAMES - 2


def test_an_unknown_one_is_refused_with_all_names(installed: Path, recording: Path, tmp_path: Path) -> None:
    words = ("-m", "ispom_app", "run", recording, "--methods", "monocular", "--out", tmp_path / "run")
    found = python(installed, *words, "--monocular.features", "freak")
    assert found.returncode == 2 and found.stderr.count("\n") == 1
    assert all(name in found.stderr for name in ("freak", "klt", "corners", "patches", "sift", "orb", NAME))
