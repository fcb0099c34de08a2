"""The options of `ispom grade` and `ispom new-method`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from ...engine.options import FirstFrames


@dataclass(frozen=True, kw_only=True)
class Grade(FirstFrames):
    """Runs a package's method on hidden seeds of the simulator. Gives points per stage: tracking, two-view geometry,
    triangulation, resection and scale. The package's code runs in a process of its own, which gets images, times and
    calibration only. It runs with your rights: grade in a container what you do not trust."""

    package: tyro.conf.Positional[str]
    """Folder of a package (with pyproject.toml), an installed package, or the name of a method."""
    methods: tuple[str, ...] = ()
    """Methods of the package to grade; none given means all."""
    key: str | None = None
    """Secret word that the seeds are made of. Give the same one for all packages of a class. A single - reads it from
    standard input: a submission could read it from the list of processes. Without it a new one is made, and printed
    at the end."""
    runs: int = 3
    """Number of seeds; the points are the mean."""
    source: str = "sim:tiny?fault=dropped:share=0.5,from_s=1.5"
    """Simulation without a seed. Half of the frames of the default one's second half are missing: a method whose
    motions are all of one length loses the scale there."""
    contract: bool = True
    """Check the contract of estimators first (ispom.testing.check_estimator); it has no points."""
    seconds: float = 600.0
    """Longest time of one run, with loading and compiling [s]."""
    memory_gb: float = 4.0
    """Memory of the process of a run [GB]."""
    json: Path | None = None
    """Write all numbers as JSON to this file."""


@dataclass(frozen=True, kw_only=True)
class NewMethod:
    """Writes the skeleton of a package with a method: code that runs, its tests, and a README that says what to do
    next."""

    name: tyro.conf.Positional[str]
    """Name of the method and of the package: small letters, digits and underscores."""
    out: Path = Path()
    """Folder in which the package's folder is made."""
