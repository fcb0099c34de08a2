"""One short simulated flight, rendered once for all estimator tests."""

from __future__ import annotations

from pathlib import Path

import pytest

from ispom.sequences.formats.simulated import open_simulated
from ispom.types import Measurement, Sequence


@pytest.fixture(scope="session")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the flight's images are kept."""
    return tmp_path_factory.mktemp("rendered")


@pytest.fixture(scope="session")
def flight(rendered: Path) -> Sequence:
    """2.4 s of sim:tiny."""
    return open_simulated("tiny", seed=0, cache_dir=rendered, duration_s=2.4)


@pytest.fixture(scope="session")
def exposures(flight: Sequence) -> list[Measurement]:
    return [flight[i] for i in range(len(flight))]
