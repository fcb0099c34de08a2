"""Table 3's rings of cameras: as many as the plan says, overlapping as it says, and each line runs."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
import yaml
from ispom_app.cli.main import main
from ispom_app.engine.options import SourceOptions
from ispom_app.features.experiments.options import Experiment
from ispom_app.features.experiments.plan_file import read_plan

RINGS = {
    "one of a ring": (1, None),
    "two without overlap": (2, -100),
    "a ring of five": (5, 8),
    "a ring of six": (6, 20),
    "a ring of eight": (8, 35),
}
"""By line: number of cameras, and by how much neighbours overlap [degrees]."""


@pytest.mark.parametrize("name", RINGS)
def test_cameras_overlap_as_the_plan_says(name: str, tmp_path: Path) -> None:
    line = next(each for each in read_plan(Experiment(plan="table3", out=tmp_path)).lines if each.name == name)
    count, overlap_deg = RINGS[name]
    rig = SourceOptions().open(line.sources[0]).rig
    assert len(rig.cameras) == count and line.method == "multicamera"
    if overlap_deg is not None:
        camera = rig.camera("camera0")
        view_deg = 2 * np.degrees(np.arctan(camera.width / 2 / camera.fx))
        between = rig.rig_from("camera0").inverse() @ rig.rig_from("camera1")
        assert view_deg - np.degrees(np.linalg.norm(between.rotvec)) == pytest.approx(overlap_deg, abs=0.1)
        assert overlap_deg < 0 or f"overlap by {overlap_deg} degrees" in line.note


@pytest.mark.slow
def test_each_ring_of_the_plan_runs(tmp_path: Path) -> None:
    plan = read_plan(Experiment(plan="table3", out=tmp_path))
    lines = {line.name: {"method": line.method, "sources": list(line.sources)} for line in plan.lines}
    lines = {name: line for name, line in lines.items() if name in RINGS}
    sources = [line["sources"][0] for line in lines.values()]
    content = {"title": "Rings", "sources": sources, "lines": lines, "seeds": [0], "max_exposures": 4}
    (tmp_path / "rings.yaml").write_text(yaml.safe_dump(content))
    assert main(["experiment", str(tmp_path / "rings.yaml"), "--out", str(tmp_path / "out"), "--workers", "0"]) == 0
    with (tmp_path / "out" / "results.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["line"] for row in rows] == list(RINGS)
    few = "no method found any motion"  # as of one camera in four frames
    assert all(row["failure"] == "" or few in row["failure"] for row in rows)
    assert [row["failure"] for row in rows if row["line"].startswith("a ring")] == ["", "", ""]
