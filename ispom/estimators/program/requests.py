"""What programs are asked: a line of JSON, and after it bytes as the line says."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import yaml

from ispom.io.rig import rig_text
from ispom.types import Measurement, Rig, as_grey, images_of


def start(rig: Rig, settings: Mapping[str, Any]) -> bytes:
    return _line({"type": "start", "rig": yaml.safe_load(rig_text(rig)), "settings": dict(settings)})


def restore(saved: bytes) -> bytes:
    return _line({"type": "restore", "state_bytes": len(saved)}) + saved


def step(index: int, measurement: Measurement, grey: bool) -> bytes:
    """`index` counts the frames that this method was given, from 0."""
    images = {name: as_grey(image) if grey else image for name, image in images_of(measurement).items()}
    raw = [np.ascontiguousarray(image).tobytes() for image in images.values()]
    listed = [
        {
            "camera": name,
            "width": image.shape[1],
            "height": image.shape[0],
            "channels": 1 if image.ndim == 2 else image.shape[2],
            "bytes": image.nbytes,
        }
        for name, image in images.items()
    ]
    return b"".join([_line({"type": "step", "index": index, "time_ns": measurement.time_ns, "images": listed}), *raw])


def _line(request: Mapping[str, Any]) -> bytes:
    return json.dumps(request, allow_nan=False).encode() + b"\n"
