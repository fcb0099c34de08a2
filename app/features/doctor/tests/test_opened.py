"""The calibration that a run estimated is examined, and not estimated again."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from ispom_app.features.doctor.command import opened
from ispom_app.features.doctor.options import Doctor

from ispom.io.rig import rig_text
from ispom.sequences import open_sequence
from ispom.types import Camera, Rig

from ....engine.run_folder.run_file import RunFile
from ....engine.run_folder.run_folder import RIG

FX = 123.0


def test_images_without_a_calibration_have_that_of_the_run(tmp_path: Path) -> None:
    images, run = tmp_path / "images", tmp_path / "run"
    images.mkdir()
    run.mkdir()
    for k in range(5):
        cv2.imwrite(str(images / f"{k:06d}.png"), np.full((96, 128), 10 * k, np.uint8))
    assert open_sequence(str(images)).guess is not None
    (run / RIG).write_text(rig_text(Rig.single(Camera(128, 96, FX, FX, 63.5, 47.5))))
    found = opened(Doctor(run=run), RunFile(str(images), "images", {}, {}, own=True))
    assert len(found) == 5 and found.rig.camera("video").fx == FX
