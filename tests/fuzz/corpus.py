"""The whole inputs that are mutated: recordings of every kind, image files, trajectories, and the folder of a run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
from ispom_app.cli.main import main

from ispom.io.kitti import poses_text
from ispom.io.maps import map_bytes
from ispom.io.rig import rig_text
from ispom.io.trajectories import euroc_text, tum_text
from ispom.types import Trajectory
from tests import doubles
from tests.app.helpers import build
from tests.io.test_maps import scene
from tests.sequences import bag_folders, car_folders, folders, own_folders
from tests.sequences.kitti_folder import make_drive

IMAGES = ("jpg", "bmp", "tif", "ppm", "webp")
FORMATS = ("tum", "kitti", "euroc", "ply", "colmap", "csv")
READ = "read"
"""Not a command of the program: a recording is opened and all its exposures are read."""


@dataclass(frozen=True)
class Item:
    """One input in a folder of its own, and what is done with it: command lines, `{}` standing for that folder."""

    name: str
    folder: Path
    commands: tuple[tuple[str, ...], ...]
    weight: int = 1
    """How often it is drawn, relative to others."""


def make_corpus(root: Path) -> list[Item]:
    """Writes all of them below a folder."""
    found = []
    for name, make in {
        **folders.MAKERS,
        **car_folders.CARS,
        **own_folders.OWN,
        **bag_folders.BAGS,
        **_folders_of_images(),
    }.items():
        folder = root / name.replace(" ", "-").replace(",", "")
        source = "{}/" + str(make(folder).relative_to(folder))
        run = ("run", source, "--no-recording", "--out", "{}/the-run")
        found.append(Item(name, folder, ((READ, source),) * 8 + (("sources", source), run), 3))
    return [*found, _trajectories(root / "trajectories"), _run(root / "run")]


def _folders_of_images() -> dict[str, Callable[[Path], Path]]:
    def maker(suffix: str) -> Callable[[Path], Path]:
        def make(root: Path) -> Path:
            folder = own_folders.make_images(root, frames=4)
            for path in sorted(folder.glob("*.png")):
                image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
                cv2.imwrite(str(path.with_suffix(f".{suffix}")), np.dstack([image, image, 255 - image]))
                path.unlink()
            return folder

        return make

    return {f"images {suffix}": maker(suffix) for suffix in IMAGES}


def _trajectories(folder: Path) -> Item:
    folder.mkdir()
    path = Trajectory.of([(t, doubles.pose_at(t)) for t in range(0, 10**10, 10**8)])
    (folder / "truth.tum").write_text(tum_text(path))
    (folder / "truth.csv").write_text(euroc_text(path))
    (folder / "truth.kitti").write_text(poses_text(path))
    (folder / "times.txt").write_text("".join(f"{t * 1e-9}\n" for t in path.times_ns))
    (folder / "run.yaml").write_text("options: {frame: rig}\n")
    files = ("{}/truth.tum", "{}/truth.csv")
    commands = [("evaluate", *files, "--alignment", kind) for kind in ("none", "first", "scale", "se3", "sim3")]
    commands.append(("evaluate", "{}/truth.kitti", "{}/truth.tum", "--times", "{}/times.txt", "--json", "{}/out.json"))
    commands.append(("evaluate", *files, "--csv", "{}/out.csv", "--delta", "3", "--max-difference-s", "0.2"))
    return Item("trajectories", folder, tuple(commands), 15)


def _run(folder: Path) -> Item:
    with TemporaryDirectory() as elsewhere:
        drive = make_drive(Path(elsewhere), frames=12)
        code = main(["run", str(drive), "--no-recording", "--out", str(folder / "run")], build)
    assert code == 0, "the corpus itself is whole"
    methods = sorted(path.stem for path in (folder / "run").glob("*.tum") if path.stem != "truth")
    (folder / "run" / "rig.yaml").write_text(rig_text(doubles.rig()))  # that of the scene
    (folder / "run" / "landmarks.npz").write_bytes(map_bytes(dict.fromkeys(methods, scene(noise_px=0.4))))
    exports = [("export", "{}/run", "--format", form, "--out", "{}/out") for form in FORMATS]
    report = ("report", "{}/run", "--out", "{}/report.html")
    return Item("run", folder, (*exports, report, report), 20)
