"""The output of `rs-enumerate-devices -c` for a RealSense: intrinsics of each stream and size, and extrinsics.

Pixel (0, 0) is the centre of the top-left pixel. Coefficients: k1 k2 p1 p2 k3 (Brown Conrady); Kannala Brandt4: k1 to
k4. The inverse and the modified Brown Conrady model are not supported where they have coefficients. An extrinsic from A
to B is B_from_A (x_B = R x_A + t), rotation by rows, in metres. Streams are chosen by the size of the images; Infrared
1 and Infrared 2 (or Fisheye 1 and 2) are left and right, Color is the video camera, and where one camera is needed it
is Color. Source: librealsense, tools/enumerate-devices and wiki "Projection in RealSense SDK 2.0".
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from ispom.errors import InputError
from ispom.geometry import Pose
from ispom.io.calibrations.camera_info import ImageSize
from ispom.io.calibrations.content import Content
from ispom.io.calibrations.dialect import CalibrationFile, Dialect, lens_camera, not_supported, rigid
from ispom.io.calibrations.placed import Placed

_INTRINSIC = re.compile(r'^\s*Intrinsic of "([^"]{1,40})"\s*/?\s*(\d{1,5})\s*x\s*(\d{1,5})', re.MULTILINE)
_EXTRINSIC = re.compile(r'^\s*Extrinsic from "([^"]{1,40})"\s*To\s*"([^"]{1,40})"', re.MULTILINE)
_NUMBER = r"[-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?"
_ROLES = {"Infrared 1": "left", "Infrared 2": "right", "Fisheye 1": "left", "Fisheye 2": "right", "Color": "video"}
MAX_BLOCKS = 2000
"""Largest number of blocks, one for each stream and size of images."""


@dataclass(frozen=True)
class _Block:
    stream: str
    size: tuple[int, int]
    text: str


def _recognises(content: Content) -> bool:
    return 'Intrinsic of "' in content.words and _INTRINSIC.search(content.words) is not None


def _read(content: Content, size: ImageSize | None) -> CalibrationFile:
    path, blocks = content.path, _blocks(content)
    streams = [name for name in _ROLES if any(block.stream == name for block in blocks)]
    if not streams:
        others = ", ".join(sorted({block.stream for block in blocks})[:8])
        raise InputError(f"{path} has intrinsics of {others}, but of no stream with images (Color, Infrared 1)")
    wanted = size() if size is not None else _only_size(content, blocks)
    taken = _of_size(content, blocks, wanted)
    cameras = [_camera(content, taken[name]) for name in streams if name in taken]
    poses = _poses(content, [_stream(content, each.name, streams) for each in cameras])
    cameras = [each.at(pose) for each, pose in zip(cameras, poses, strict=True)]
    if len(cameras) == 1:
        return CalibrationFile(path, [cameras[0].at(None)])
    usual = "video" if any(each.name == "video" for each in cameras) else ""
    return CalibrationFile(path, cameras, is_relative=True, usual=usual)


def _stream(content: Content, role: str, streams: list[str]) -> str:
    return next(name for name in streams if _ROLES[name] == role)


def _blocks(content: Content) -> list[_Block]:
    text = content.words
    starts = list(_INTRINSIC.finditer(text))[:MAX_BLOCKS]
    ends = [match.start() for match in starts[1:]] + [len(text)]
    return [
        _Block(match[1], (int(match[2]), int(match[3])), text[match.end() : min(end, match.end() + 2000)])
        for match, end in zip(starts, ends, strict=True)
    ]


def _only_size(content: Content, blocks: list[_Block]) -> tuple[int, int]:
    sizes = sorted({block.size for block in blocks if block.stream in _ROLES})
    if len(sizes) > 1:
        shown = ", ".join(f"{w}x{h}" for w, h in sizes[:12])
        raise InputError(f"{content.path} is for images of several sizes ({shown}): say which with --image-size")
    return sizes[0]


def _of_size(content: Content, blocks: list[_Block], size: tuple[int, int]) -> dict[str, _Block]:
    """Returns the blocks of this size by stream; where there is none, those of the largest size of the same shape."""
    of_cameras = [block for block in blocks if block.stream in _ROLES]
    taken = [block for block in of_cameras if block.size == size]
    if not taken:
        shape = [block for block in of_cameras if block.size[0] * size[1] == block.size[1] * size[0]]
        if not shape:
            sizes = ", ".join(f"{w}x{h}" for w, h in sorted({block.size for block in of_cameras})[:12])
            raise InputError(f"{content.path} is for images of {sizes}, not of {size[0]} x {size[1]}: give those")
        largest = max(block.size for block in shape)
        taken = [block for block in shape if block.size == largest]
    return {block.stream: block for block in reversed(taken)}


def _camera(content: Content, block: _Block) -> Placed:
    path, where = content.path, f"{block.stream} {block.size[0]}x{block.size[1]}"
    values = []
    for key in ("Fx", "Fy", "PPX", "PPY"):
        found = re.search(rf"^\s*{key}:\s*({_NUMBER})\s*$", block.text, re.MULTILINE)
        if found is None:
            raise InputError(f"{path}: {where} has no {key}: print it again with rs-enumerate-devices -c")
        values.append(_float(path, where, found[1]))
    named = re.search(r"^\s*Distortion:\s*(.*)$", block.text, re.MULTILINE)
    model = "none" if named is None else named[1].strip().lower()
    listed = re.search(rf"^\s*Coeffs:((?:\s+{_NUMBER}){{0,8}})", block.text, re.MULTILINE)
    coefficients = [] if listed is None else [_float(path, where, word) for word in listed[1].split()]
    lens = "opencv"
    if any(coefficients) and model in ("kannala brandt4", "kannala brandt 4"):
        lens, coefficients = "fisheye", coefficients[:4]
    elif any(coefficients) and model not in ("brown conrady", "none"):
        raise not_supported(path, "RealSense", f"{where}: distortion {model[:40]}")
    sides = (float(block.size[0]), float(block.size[1]))
    return lens_camera(content, _ROLES[block.stream], sides, values, coefficients[:5], lens, None, (), where)


def _float(path: object, where: str, word: str) -> float:
    try:
        return float(word)
    except ValueError:
        raise InputError(f"{path}: {where}: {word[:40]} is no number: correct it") from None


def _poses(content: Content, streams: list[str]) -> list[Pose | None]:
    """Returns first_from_stream of each stream; None where the file has none."""
    if len(streams) < 2:
        return [None] * len(streams)
    found: dict[tuple[str, str], Pose] = {}
    for match in list(_EXTRINSIC.finditer(content.words))[:MAX_BLOCKS]:
        part = content.words[match.end() : match.end() + 600].split("Extrinsic from")[0]
        rotation, _, translation = part.partition("Translation Vector:")
        numbers = re.findall(_NUMBER, rotation.partition("Rotation Matrix:")[2]), re.findall(_NUMBER, translation)
        if len(numbers[0]) == 9 and len(numbers[1]) >= 3:
            where = f'the extrinsic from "{match[1]}" to "{match[2]}"'
            values = [_float(content.path, where, word) for word in (*numbers[0], *numbers[1][:3])]
            matrix = np.column_stack([np.array(values[:9]).reshape(3, 3), np.array(values[9:])])
            found.setdefault((match[1], match[2]), rigid(content.path, where, matrix))
    first = streams[0]
    poses: list[Pose | None] = [Pose()]
    for stream in streams[1:]:
        direct, back = found.get((stream, first)), found.get((first, stream))
        poses.append(direct if direct is not None else None if back is None else back.inverse())
    return poses


DIALECT = Dialect(
    "realsense", "RealSense", "output of `rs-enumerate-devices -c`", "text", 'Intrinsic of "Color"', _recognises, _read
)
