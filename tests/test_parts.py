"""The default run and the mark `full` are all that is not `slow`."""

from __future__ import annotations

from pathlib import Path

from tests.parts import FULL, SMOKE, is_full

ROOT = Path(__file__).parents[1]


def test_each_place_has_tests() -> None:
    for place in FULL:
        path = ROOT / place
        assert path.is_file() or any(path.rglob("test_*.py")), place


def test_the_page_is_opened_by_default() -> None:
    assert (ROOT / SMOKE).is_file() and not is_full(SMOKE) and is_full("tests/app/page/test_keys.py")


def test_ci_runs_both() -> None:
    assert 'pytest -m "full and not slow"' in (ROOT / ".ci" / "run").read_text()
    assert "not slow and not full" in (ROOT / "pyproject.toml").read_text()
