"""COLMAP's binary model: cameras.bin, images.bin and points3D.bin of a text model.

Numbers are little-endian; records have the values of the text files, line by line. Source: COLMAP, documentation,
"Output Format", and src/colmap/scene/reconstruction_io.cc.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

from ispom.io.colmap import ColmapModel

_NUMBERS = {"PINHOLE": 1, "OPENCV": 4, "OPENCV_FISHEYE": 5, "FULL_OPENCV": 6}
"""COLMAP's number of each model in binary files."""


def colmap_binary(model: ColmapModel) -> dict[str, bytes]:
    """Returns the three files by name."""
    return {
        "cameras.bin": _counted([_camera(line) for line in _lines(model.cameras)]),
        "images.bin": _counted([*_images(model.images)]),
        "points3D.bin": _counted([_point(line) for line in _lines(model.points)]),
    }


def _lines(text: str) -> list[str]:
    return [line for line in text.splitlines() if not line.startswith("#")]


def _counted(records: list[bytes]) -> bytes:
    return struct.pack("<Q", len(records)) + b"".join(records)


def _camera(line: str) -> bytes:
    number, model, width, height, *values = line.split()
    head = struct.pack("<iiQQ", int(number), _NUMBERS[model], int(width), int(height))
    return head + struct.pack(f"<{len(values)}d", *map(float, values))


def _images(text: str) -> Iterator[bytes]:
    """Yields the record of each image, which has two lines, of which the second may be empty."""
    lines = _lines(text)
    for first, second in zip(lines[::2], lines[1::2], strict=True):
        number, *pose, camera, name = first.split(maxsplit=9)
        words = second.split()
        yield (
            struct.pack("<i7di", int(number), *map(float, pose), int(camera))
            + name.encode()
            + b"\0"
            + (
                struct.pack("<Q", len(words) // 3)
                + b"".join(
                    struct.pack("<ddq", float(u), float(v), int(point))
                    for u, v, point in zip(words[::3], words[1::3], words[2::3], strict=True)
                )
            )
        )


def _point(line: str) -> bytes:
    number, *words = line.split()
    xyz, rgb, error, track = words[:3], words[3:6], words[6], [int(word) for word in words[7:]]
    head = struct.pack("<Q3d3Bd", int(number), *map(float, xyz), *map(int, rgb), float(error))
    return head + struct.pack(f"<Q{len(track)}i", len(track) // 2, *track)
