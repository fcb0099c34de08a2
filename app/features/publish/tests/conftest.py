"""Two short runs on stand-in estimators, and what is published of them with a stand-in for the Rerun viewer."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ispom_app.cli.main import main
from ispom_app.features.publish import command
from ispom_app.views.web.rerun_assets import ViewerFiles

from ispom.geometry import Pose
from tests import doubles
from tests.app.helpers import build_full, ran
from tests.sequences.kitti_folder import make_drive

FRAMES = 14
STRAYS_AT = 12


@pytest.fixture(scope="session")
def runs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Folders of two finished runs on one source."""
    place = tmp_path_factory.mktemp("private place")
    drive = str(make_drive(place / "drive of somebody", FRAMES))
    found = place / "first", place / "second"
    for folder, more in zip(found, ([], ["--stereo.max-tracks", "300"]), strict=True):
        ran(drive, folder, "--stereo-every", "2", *more, builder=build_full)
    return found


@pytest.fixture(scope="session")
def publish(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., int]]:
    """Calls `ispom publish`; the Rerun viewer's files are short ones."""
    wasm = tmp_path_factory.mktemp("viewer") / "viewer.wasm"
    wasm.write_text("// viewer")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(command, "viewer_files", lambda: ViewerFiles(b"// viewer", wasm))
        yield lambda *words: main(["publish", *map(str, words)])


@pytest.fixture(scope="session")
def site(runs: tuple[Path, Path], publish: Callable[..., int], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first run, published."""
    found = tmp_path_factory.mktemp("sites") / "one"
    assert publish(runs[0], "--out", found) == 0
    return found


@pytest.fixture(scope="session")
def pair(runs: tuple[Path, Path], publish: Callable[..., int], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Both runs, published together."""
    found = tmp_path_factory.mktemp("sites") / "two"
    assert publish(*runs, "--out", found) == 0
    return found


class Strays(doubles.FullEstimator):
    """Is two metres aside from its STRAYS_AT-th frame on, and a little off before."""

    def step(self, state, exposure, asked=None):
        after, step = super().step(state, exposure, asked)
        pose = step.world_from_frame
        if pose is None:
            return after, step
        aside = 2.0 if len(after) > STRAYS_AT else 1e-3 * (len(after) % 3)
        moved = Pose(pose.rotation, pose.translation + np.array([aside, 0.0, 0.0]))
        return after, replace(step, world_from_frame=moved)


@pytest.fixture(scope="session")
def parted(publish: Callable[..., int], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two runs whose paths part, published together."""
    place = tmp_path_factory.mktemp("parted")
    drive = str(make_drive(place / "drive", 4 * STRAYS_AT))
    folders = place / "straight", place / "aside"
    for folder, kind in zip(folders, (doubles.FullEstimator, Strays), strict=True):
        arguments = ["run", drive, "--stereo-every", "1", "--methods", "stereo", "--out", str(folder)]
        assert main(arguments, lambda config, methods, rig, kind=kind: doubles.ensemble(methods, kind)) == 0
    found = place / "site"
    assert publish(*folders, "--out", found) == 0
    return found


@pytest.fixture(scope="session")
def publish_lesson(publish: Callable[..., int], tmp_path_factory: pytest.TempPathFactory) -> Callable[[Path], Path]:
    """Publishes a lesson about two drives into a folder."""
    place = tmp_path_factory.mktemp("own lesson")
    text = (Path(__file__).parent / "lesson.md").read_text()
    for word in ("SOURCE", "SECOND"):
        text = text.replace(word, f'"{make_drive(place / word, FRAMES)}"')
    (place / "own.md").write_text(text)

    def published(out: Path) -> Path:
        assert main(["publish", str(place / "own.md"), "--lessons", "--out", str(out)], build_full) == 0
        return out

    return published


@pytest.fixture(scope="session")
def lessons(publish_lesson: Callable[[Path], Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return publish_lesson(tmp_path_factory.mktemp("lessons") / "site")
