"""The images of a topic of a bag: decoded from any encoding of ROS, when they are requested."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ispom.errors import InputError, UnreadableImage
from ispom.io.bag_file import IMAGE_TYPES, BagFile, Index
from ispom.sequences.images import as_bytes, decode, sampled, span_of_values, values_of
from ispom.types import Image

_BAYER = {
    "rggb": cv2.COLOR_BayerRGGB2RGB,
    "bggr": cv2.COLOR_BayerBGGR2RGB,
    "gbrg": cv2.COLOR_BayerGBRG2RGB,
    "grbg": cv2.COLOR_BayerGRBG2RGB,
}
_COLOURS = {
    "rgb": (3, None),
    "bgr": (3, cv2.COLOR_BGR2RGB),
    "rgba": (4, cv2.COLOR_RGBA2RGB),
    "bgra": (4, cv2.COLOR_BGRA2RGB),
}
ENCODINGS: dict[str, tuple[type[np.generic], int, int | None]] = {
    "mono8": (np.uint8, 1, None),
    "mono16": (np.uint16, 1, None),
    **{f"{name}8": (np.uint8, *how) for name, how in _COLOURS.items()},
    **{f"{name}16": (np.uint16, *how) for name, how in _COLOURS.items()},
    **{f"bayer_{name}8": (np.uint8, 1, how) for name, how in _BAYER.items()},
    **{f"bayer_{name}16": (np.uint16, 1, how) for name, how in _BAYER.items()},
    "8UC1": (np.uint8, 1, None),
    "8UC3": (np.uint8, 3, cv2.COLOR_BGR2RGB),
    "8UC4": (np.uint8, 4, cv2.COLOR_BGRA2RGB),
    "16UC1": (np.uint16, 1, None),
    "16SC1": (np.int16, 1, None),
    "16UC3": (np.uint16, 3, cv2.COLOR_BGR2RGB),
    "16UC4": (np.uint16, 4, cv2.COLOR_BGRA2RGB),
    "32FC1": (np.float32, 1, None),
    "32FC3": (np.float32, 3, cv2.COLOR_BGR2RGB),
    "yuv422": (np.uint8, 2, cv2.COLOR_YUV2RGB_UYVY),
    "uyvy": (np.uint8, 2, cv2.COLOR_YUV2RGB_UYVY),
    "yuv422_yuy2": (np.uint8, 2, cv2.COLOR_YUV2RGB_YUY2),
    "yuyv": (np.uint8, 2, cv2.COLOR_YUV2RGB_YUY2),
}
"""Type and number of values per pixel, and OpenCV's conversion of bytes to RGB."""
MAX_TRIALS = 10
"""Number of first images of which one must be readable."""


class TopicImages:
    """The images of one topic, decoded when requested."""

    def __init__(self, bag: BagFile, topic: str, index: Index, size: tuple[int, int] | None = None) -> None:
        """`size` is (width, height), if it is known."""
        self._bag, self._topic, self._index, self._size = bag, topic, index, size
        self._compressed = bag.types[topic] == IMAGE_TYPES[1]

    def read(self, i: int) -> Image:
        """Returns image i, grey or RGB. Raises InputError where it is unreadable, of an unknown encoding, or of another
        size."""
        where, message = self._where(i), self._bag.message(self._topic, self._index.places[i])
        if self._compressed:
            return decode(bytes(message.data), where, self._size, span=lambda: self._span)
        values = _values(message, where)
        height, width = values.shape[:2]
        if self._size is not None and (width, height) != self._size:
            expected = f"{self._size[0]} x {self._size[1]}"
            raise InputError(f"{where} is {width} x {height}, not {expected} as its camera: correct the calibration")
        if values.dtype != np.uint8:
            values = as_bytes(values, self._span)
        conversion = ENCODINGS[message.encoding][2]
        image = values if conversion is None else np.asarray(cv2.cvtColor(values, conversion), np.uint8)
        image = np.ascontiguousarray(image)
        image.setflags(write=False)
        return image

    def first_size(self) -> tuple[int, int]:
        """Returns (width, height) of the first image that can be read."""
        fault = None
        for i in range(min(len(self._index.places), MAX_TRIALS)):
            try:
                return self.read(i).shape[1::-1]
            except UnreadableImage as error:
                fault = fault or error
        raise fault or InputError(f"{self._bag.path}: {self._topic} holds no image: give a bag with images")

    @cached_property
    def _span(self) -> tuple[float, float]:
        """The values of black and white in all images of the topic."""
        spans = []
        for i in sampled(len(self._index.places)):
            message = self._bag.message(self._topic, self._index.places[i])
            try:
                of = values_of if self._compressed else _values
                values = of(bytes(message.data) if self._compressed else message, self._where(i))
            except InputError:
                continue
            if values is not None:
                spans.append(values[np.isfinite(values)])
        return span_of_values(spans)

    def _where(self, i: int) -> str:
        return f"{self._bag.path}: image {i} of {self._topic}"


def _values(message: Any, where: str) -> NDArray[Any]:
    """Returns (H, W) or (H, W, C) as the message has them. Raises UnreadableImage where it is not whole."""
    if message.encoding not in ENCODINGS:
        raise InputError(f"{where} has encoding {message.encoding}, give one of {', '.join(ENCODINGS)}")
    kind, channels, conversion = ENCODINGS[message.encoding]
    width, height, step = message.width, message.height, message.step
    kind = np.dtype(kind).newbyteorder(">" if message.is_bigendian else "<")
    wide = width * channels * kind.itemsize
    if step < wide or len(message.data) < height * step or not width * height:
        raise UnreadableImage(f"{where} is not whole: restore the bag")
    if (channels == 2 and width % 2) or (conversion in _BAYER.values() and min(width, height) < 2):
        raise UnreadableImage(
            f"{where} has {width} x {height} px, which {message.encoding} cannot have: restore the bag"
        )
    rows = np.asarray(message.data, np.uint8)[: height * step].reshape(height, step)[:, :wide]
    values = np.ascontiguousarray(rows).view(kind)
    return values.reshape((height, width, channels) if channels > 1 else (height, width)).astype(kind.newbyteorder("="))
