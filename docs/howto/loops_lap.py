"""Writes lap.yaml and circle.tum, the example of loops.md: a pair that looks outwards from a circle, and comes back."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

SECONDS, TURN_DEG, RADIUS_M, WIDTH_PX = 10.0, 430.0, 1.5, 240


def write_lap(folder: Path) -> Path:
    """Returns the scenario, which any `ispom` command takes as a source."""
    with (folder / "circle.tum").open("w") as file:
        for t in np.arange(0.0, SECONDS + 0.01, 0.05):
            turned = Rotation.from_euler("y", np.radians(TURN_DEG) * t / SECONDS)
            x, _, z = turned.apply([0.0, 0.0, RADIUS_M])
            quaternion = " ".join(f"{q:.9f}" for q in turned.as_quat())
            file.write(f"{t:.3f} {x:.6f} -1.6 {z:.6f} {quaternion}\n")
    path, route = folder / "lap.yaml", (folder / "circle.tum").absolute()
    path.write_text(f"scene: tiny\nroute: {route}\nplace: city\nwidth_px: {WIDTH_PX}\n")
    return path


if __name__ == "__main__":
    sys.stdout.write(f"{write_lap(Path.cwd())}\n")
