"""What the examples are run on."""

from __future__ import annotations

from pathlib import Path

import cv2
import pytest
import yaml

from ispom.testing.flight import flight, flight_rig
from ispom.types import is_video

FRAMES = 20


@pytest.fixture(scope="session")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of images past a cloud of balls, with its camera."""
    folder, rig = tmp_path_factory.mktemp("recording"), flight_rig()
    for i, frame in enumerate([e for e in flight(rig) if is_video(e)][:FRAMES]):
        cv2.imwrite(str(folder / f"{i:03d}.png"), frame.image)
    camera = rig.camera("video")
    names = ("width", "height", "fx", "fy", "cx", "cy")
    values = {name: getattr(camera, name) for name in names} | {"distortion": [*camera.distortion], "rate_hz": 30}
    (folder / "camera.yaml").write_text(yaml.safe_dump(values))
    return folder
