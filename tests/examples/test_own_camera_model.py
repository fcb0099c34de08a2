"""The example of a camera model in a package of its own: it keeps the contract, and images of it are run."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.examples.packages import install, python

CHECK = """
import ispom
for coefficients in ((-0.2, 0.55), (0.1, 0.45), (-0.27, 0.6)):
    ispom.check_camera_model(ispom.Camera(640, 480, 210.0, 212.0, 318.0, 241.0, coefficients, "double_sphere"))
wide = ispom.Camera(640, 480, 130.0, 130.0, 319.5, 239.5, (-0.2, 0.55), "double_sphere")
rays, valid = wide.unproject([[2.0, 239.5]])
assert valid.all() and rays[0, 2] < 0, "it sees beyond 180 degrees"
"""
RENDER = """
import sys, cv2, yaml, ispom
from pathlib import Path
from ispom.testing.flight import flight, flight_rig
folder = Path(sys.argv[1])
camera = ispom.Camera(320, 240, 150.0, 151.0, 160.5, 118.5, (-0.2, 0.55), "double_sphere")
frames = [m for m in flight(flight_rig().changed(video=camera)) if m.kind == "video"][:20]
for i, frame in enumerate(frames):
    cv2.imwrite(str(folder / f"{i:03d}.png"), frame.image)
values = {name: getattr(camera, name) for name in ("width", "height", "fx", "fy", "cx", "cy")}
values |= {"model": "double_sphere", "distortion": [*camera.distortion], "rate_hz": 30}
(folder / "camera.yaml").write_text(yaml.safe_dump(values))
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return install(tmp_path_factory.mktemp("installed"), "own_camera_model")


def test_it_keeps_the_contract(installed: Path) -> None:
    found = python(installed, "-c", CHECK)
    assert found.returncode == 0, found.stderr


def test_images_of_it_are_run_and_without_the_package_its_name_is_refused(installed: Path, tmp_path: Path) -> None:
    images, out = tmp_path / "images", tmp_path / "out"
    images.mkdir()
    found = python(installed, "-c", RENDER, images)
    assert found.returncode == 0, found.stderr
    words = ("-m", "ispom_app", "run", images, "--methods", "monocular", "monocular.paper", "--no-recording", "--out")
    found = python(installed, *words, out)
    assert found.returncode == 0, found.stderr
    assert "model: double_sphere" in (out / "rig.yaml").read_text()
    for method in ("monocular", "monocular.paper"):
        assert len((out / f"{method}.tum").read_text().splitlines()) >= 15
    found = python(tmp_path / "nothing", *words, tmp_path / "other")
    assert found.returncode == 2 and "double_sphere" in found.stderr and "Traceback" not in found.stderr
