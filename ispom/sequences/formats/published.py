"""Replica and ICL-NUIM: folders of images without a camera file; the camera is published with the data set.

| data set | recognised by | camera |
| --- | --- | --- |
| Replica, as NICE-SLAM renders it | `results/frame000000.jpg` and `traj.txt` | 1200 x 680, f 600, centre 599.5, 339.5 |
| ICL-NUIM, as TUM RGB-D | `rgb/0.png` and `associations.txt` | 640 x 480, f 481.2 and 480, centre 319.5, 239.5 |

For images of another size there is no such camera. A calibration file in the folder has priority. Replica's poses are
world_from_camera (x to the right, y down, z ahead); those of ICL-NUIM (`*.gt.freiburg`) have other axes and are not
used. Written from public documentation: NICE-SLAM's configuration of Replica, and the page of ICL-NUIM.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ispom.io.files import exists, is_folder, names
from ispom.sequences.formats.folder import holds_images, open_folder
from ispom.sequences.recording import Recording
from ispom.types import Camera

REPLICA = Camera(1200, 680, 600.0, 600.0, 599.5, 339.5)
ICL_NUIM = Camera(640, 480, 481.2, 480.0, 319.5, 239.5)


def looks_like_published(folder: Path) -> bool:
    """Checks whether a folder is one of Replica or of ICL-NUIM."""
    return _of(folder) is not None


def open_published(folder: Path, calibration: Path | None = None) -> Recording:
    """Opens a folder of images, with the published camera where it has no calibration. Raises InputError as
    `open_folder`."""
    opened = open_folder(folder, calibration)
    found = _of(folder)
    if found is None:
        return opened
    name, camera = found
    opened = replace(opened, name=f"{name} {folder.resolve().name}")
    poses = [entry for entry in names(folder) if entry.endswith(".gt.freiburg")]
    if poses:
        other = f"{folder / poses[0]}: not used as ground truth, as its axes are not those of images"
        opened = replace(opened, notes=(*opened.notes, other))
    if opened.guess is None:
        return opened
    size = f"{camera.width} x {camera.height}"
    known = f"fx {camera.fx:g}, fy {camera.fy:g}, cx {camera.cx:g}, cy {camera.cy:g} for {size}"
    if (opened.camera.width, opened.camera.height) == (camera.width, camera.height):
        note = f"No calibration: the camera that is published with {name} is used ({known})."
        return replace(opened, camera=camera, guess=None, notes=(note, *opened.notes))
    note = f"{name} has published its camera ({known}), and these images are smaller or larger: give a camera.yaml"
    return replace(opened, notes=(note, *opened.notes))


def _of(folder: Path) -> tuple[str, Camera] | None:
    if exists(folder / "traj.txt") and is_folder(folder / "results") and holds_images(folder / "results"):
        return "Replica", REPLICA
    listed = exists(folder / "associations.txt") and not exists(folder / "rgb.txt")
    if listed and any(exists(folder / "rgb" / f"0{kind}") for kind in (".png", ".jpg")):
        return "ICL-NUIM", ICL_NUIM
    return None
