"""Trains a vocabulary for ORB-SLAM3 from images of your own, where its own of 139 MB cannot be had, or is too large.

    python make_vocabulary.py VOCABULARY.txt IMAGE [IMAGE ...]

ORB descriptors of the images are split again and again into `BRANCHES` clusters (Galvez-Lopez and Tardos, T-RO 2012).
A word weighs the logarithm of the share of images that have it. A vocabulary of few images is good for tracking,
where it only speeds up matching; loops over other places need the large one.
"""

import sys
from pathlib import Path

import cv2
import numpy as np

BRANCHES, DEPTH = 10, 4
ROUNDS = 8
"""Of k-medians per split."""
FEATURES = 2000
"""Per image."""
BITS = 256


def descriptors(paths):
    """All ORB descriptors (N, 32), and the image of each (N,)."""
    orb, found, images = cv2.ORB_create(FEATURES), [], []
    for place, path in enumerate(paths):
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        if image is None:
            sys.exit(f"cannot read {path}: give images")
        values = orb.detectAndCompute(image, None)[1]
        if values is not None:
            found.append(values)
            images.append(np.full(len(values), place))
    if not found:
        sys.exit("the images have no features: give others")
    return np.concatenate(found), np.concatenate(images)


def split(bits, rng):
    """Clusters (N,) of descriptors as bits (N, 256), and their medians, bit by bit."""
    distinct = np.unique(bits, axis=0)
    count = min(BRANCHES, len(distinct))
    centres = distinct[rng.choice(len(distinct), count, replace=False)]
    for _ in range(ROUNDS):
        cluster = np.argmax((2.0 * bits - 1) @ (2.0 * centres.T - 1), axis=1)  # the Hamming distance is least
        centres = np.array(
            [bits[cluster == c].mean(axis=0) >= 0.5 if (cluster == c).any() else centres[c] for c in range(count)]
        ).astype(np.float32)
    return cluster, centres


def nodes(bits, images, total):
    """Lines of the file: parent, whether it is a word, 32 bytes, weight; a parent comes before its children."""
    rng, waiting, last = np.random.default_rng(0), [(0, np.arange(len(bits)), 1)], 0
    while waiting:
        parent, own, level = waiting.pop(0)
        cluster, centres = split(bits[own], rng)
        for c, centre in enumerate(centres):
            members = own[cluster == c]
            if not len(members):
                continue
            last += 1
            is_word = level == DEPTH or len(members) <= BRANCHES
            weight = np.log(total / len(np.unique(images[members]))) if is_word else 0.0
            values = " ".join(map(str, np.packbits(centre.astype(bool))))
            yield f"{parent} {int(is_word)} {values} {weight:.6g}"
            if not is_word:
                waiting.append((last, members, level + 1))


def main(target, paths):
    found, images = descriptors(paths)
    bits = np.unpackbits(found, axis=1).astype(np.float32)
    lines = [f"{BRANCHES} {DEPTH} 0 0", *nodes(bits, images, len(paths))]
    Path(target).write_text("\n".join(lines), encoding="ascii")  # ORB-SLAM3 reads a last empty line as a node
    sys.stdout.write(f"{len(lines) - 1} nodes from {len(found)} descriptors of {len(paths)} images\n")


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit("give the vocabulary to write, and images: make_vocabulary.py VOCABULARY.txt IMAGE [IMAGE ...]")
    main(sys.argv[1], sys.argv[2:])
