"""A data set format: a folder with `log.csv` (what was measured when), images, and `rig.json`.

log.csv has a row for each measurement, in the order of time: time_s, then `stereo` with the names of its left and right
image, or `gnss` with east, north, up and their standard deviation [m].
"""

import csv
import json
from pathlib import Path

import cv2
import numpy as np

import ispom


def recognises(folder: Path) -> bool:
    return (folder / "log.csv").is_file() and (folder / "rig.json").is_file()


def open_folder(folder: Path) -> ispom.Sequence:
    try:
        described = json.loads((folder / "rig.json").read_text())
        camera = ispom.Camera(**described["camera"])
        rig = ispom.Rig.stereo(camera, float(described["baseline_m"]))
        with (folder / "log.csv").open(newline="") as file:
            rows = list(csv.reader(file))
        times_ns = np.array([round(float(row[0]) * 1e9) for row in rows], np.int64)
        kinds = tuple(row[1] for row in rows)
        if not set(kinds) <= {"stereo", "gnss"}:
            raise ValueError(f"{sorted(set(kinds) - {'stereo', 'gnss'})[0]!r} is neither stereo nor gnss")
        if "gnss" in kinds:
            antenna = ispom.Pose(translation=np.array(described["antenna_in_rig_m"], float))
            rig = rig.changed(gnss=ispom.GnssAntenna(rig_from_sensor=antenna))
    except (OSError, ValueError, KeyError, IndexError, TypeError) as fault:
        raise ispom.InputError(f"{folder} is not as the format wants it: {fault}") from fault

    def image(name: str) -> np.ndarray:
        found = cv2.imread(str(folder / Path(name).name), cv2.IMREAD_GRAYSCALE)
        if found is None or found.shape != (camera.height, camera.width):
            raise ispom.UnreadableImage(f"{folder / name} is no image of {camera.width} x {camera.height} pixels")
        return np.asarray(found, np.uint8)

    def load(i: int) -> ispom.Measurement:
        time_ns, (_, kind, *values) = int(times_ns[i]), rows[i]
        if kind == "stereo":
            return ispom.Frame.stereo(time_ns, image(values[0]), image(values[1]))
        *xyz, sigma = map(float, values)
        return ispom.GnssFix(time_ns, np.array(xyz), sigma**2 * np.eye(3))

    return ispom.Sequence(f"log {folder.name}", rig, times_ns, kinds, load)


FORMAT = ispom.Format("own_log", recognises, open_folder)
