"""What the examples are run on."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import cv2
import pytest
import yaml

from ispom.types import VideoFrame
from ispom.warm_up import flight, flight_rig

FRAMES = 20


@pytest.fixture(scope="session")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of images past a cloud of balls, with its camera."""
    folder, rig = tmp_path_factory.mktemp("recording"), flight_rig()
    for i, frame in enumerate([e for e in flight(rig) if isinstance(e, VideoFrame)][:FRAMES]):
        cv2.imwrite(str(folder / f"{i:03d}.png"), frame.image)
    camera = rig.camera("video")
    names = ("width", "height", "fx", "fy", "cx", "cy")
    values = {name: getattr(camera, name) for name in names} | {"distortion": [*camera.distortion], "rate_hz": 30}
    (folder / "camera.yaml").write_text(yaml.safe_dump(values))
    return folder


def install(example: Path, folder: Path) -> Path:
    """Writes a package into a folder, as pip does. Returns the folder."""
    project = tomllib.loads((example / "pyproject.toml").read_text())
    described = project["project"]
    for name in project["tool"]["setuptools"]["py-modules"]:
        (folder / f"{name}.py").write_bytes((example / f"{name}.py").read_bytes())
    info = folder / f"{described['name'].replace('-', '_')}-{described['version']}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {described['name']}\nVersion: {described['version']}\n"
    )
    lines = [f"[{g}]\n" + "".join(f"{k} = {v}\n" for k, v in e.items()) for g, e in described["entry-points"].items()]
    (info / "entry_points.txt").write_text("\n".join(lines))
    return folder


def python(installed: Path, *words: str | Path) -> subprocess.CompletedProcess[str]:
    """Runs Python as a person who has installed the example; the tests' own process does not know it."""
    environment = {**os.environ, "PYTHONPATH": str(installed)}
    command = [sys.executable, *map(str, words)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=200, check=False)
