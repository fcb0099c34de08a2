"""Self-calibration of a sequence without a calibration, by its own images."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np

from ispom.calibration.diagnostics import Parameter
from ispom.calibration.result import Verdict
from ispom.calibration.tracked.solve import TrackedLens, lens_of_tracks
from ispom.calibration.tracked.tracks import key_tracks
from ispom.errors import InputError
from ispom.features.pair_look import MIXED_UP
from ispom.types import Camera, Guess, Image, Sequence, is_video

MOST_IMAGES, MOST_VIEWS = 600, 45
BETTER = 0.8
"""Share of the prior standard deviation: a focal length that is not better determined was not found."""
RELIABLE_SIGMA = 0.03
"""Relative standard deviation of a focal length that suffices for more than a first look."""
GOOD_SIGMA = 0.01
"""The same, of one that nothing is said against."""
ADVICE = "film near things at several depths, turn the camera by 20 degrees and more about two axes while it moves"
_BETTER = "Better: film a target and run `ispom calibrate video`, or give --camera."


def self_calibrated(sequence: Sequence, most_images: int = MOST_IMAGES, most_views: int = MOST_VIEWS) -> Sequence:
    """Returns the sequence with the camera estimated from its first images, and its uncertainty in the notes.

    Unchanged with a calibration, and where a note says that its images are mixed up. Where the images do not determine
    the camera, the guess stays, with a note.
    """
    guess = sequence.guess
    if guess is None or any(note in MIXED_UP for note in sequence.notes):
        return sequence
    found = estimate_lens(sequence, guess, most_images, most_views)
    note = words(guess, found)
    if found is not None and is_informative(guess, found):
        origin = f"from the motion in {found.views} of its images"
        estimate = Guess(found.camera.fy, float(found.sigma[0]), origin, guess.aspect)
        sequence = replace(sequence, rig=sequence.rig.changed(video=rounded(found.camera)), guess=estimate)
    return replace(sequence, notes=tuple(note if each == guess.note else each for each in sequence.notes))


def estimate_lens(sequence: Sequence, guess: Guess, most_images: int, most_views: int) -> TrackedLens | None:
    """Estimates the lens by the tracks through the first images of the video."""
    camera = sequence.rig.camera("video")
    width = round(camera.width * guess.aspect)
    square = replace(guess, aspect=1.0).camera((width, camera.height))
    images = (_resized(image, width) for image in _images(sequence, most_images))
    found = lens_of_tracks(key_tracks(images, most_views), square, guess.sigma)
    if found is None or width == camera.width:
        return found
    share = camera.width / width
    as_filmed = replace(
        found.camera, width=camera.width, fx=found.camera.fx * share, cx=(found.camera.cx + 0.5) * share - 0.5
    )
    scale = np.array([1, share, 1, 1, 1])
    return replace(found, camera=as_filmed, covariance=found.covariance * np.outer(scale, scale))


def is_informative(guess: Guess, found: TrackedLens) -> bool:
    """Returns whether the images determine the focal length better than the guess."""
    return bool(found.sigma[0] < BETTER * guess.sigma)


def rounded(camera: Camera) -> Camera:
    """Rounds to fewer digits than are significant, so that every machine's arithmetic makes the same camera."""
    values = {name: round(getattr(camera, name), 2) for name in ("fx", "fy", "cx", "cy")}
    return replace(camera, **values, distortion=tuple(round(k, 5) for k in camera.distortion))


def parameters_of(found: TrackedLens) -> tuple[Parameter, ...]:
    """Returns fx (and fy, which is the same), cx, cy, k1, k2 with their standard errors."""
    camera, errors = found.camera, found.sigma * np.array([found.camera.fx, 1, 1, 1, 1])
    values = (camera.fx, camera.cx, camera.cy, *camera.distortion[:2])
    known = found.sigma < 0.95 * found.prior_sigma
    names = ("fx", "cx", "cy", "k1", "k2")
    return tuple(
        Parameter("video", name, float(value), float(error), bool(sure))
        for name, value, error, sure in zip(names, values, errors, known, strict=True)
    )


def verdict_of(found: TrackedLens) -> Verdict:
    """Returns whether the focal length is good, usable or to be filmed again, by its standard error."""
    reasons = (f"video: its focal length is uncertain by {100 * found.sigma[0]:.1f} %",)
    if found.sigma[0] > RELIABLE_SIGMA:
        return Verdict("redo", reasons, (ADVICE,))
    return Verdict("usable", reasons, (ADVICE,)) if found.sigma[0] > GOOD_SIGMA else Verdict("good", (), ())


def words(guess: Guess, found: TrackedLens | None) -> str:
    """Returns a note for people: the assumption, its uncertainty, and how to do better."""
    if found is None:
        return (
            f"{guess.note} The first images have too little motion or texture to refine it: shape and scale drift "
            f"suffer. {_BETTER}"
        )
    percent = 100 * found.sigma[0]
    if not is_informative(guess, found):
        return (
            f"{guess.note} The motion in the first images does not tell it (a camera must turn as well as move): shape "
            f"and scale drift suffer. {_BETTER}"
        )
    k1, sigma = found.camera.distortion[0], found.sigma[3]
    pixels = "" if guess.aspect == 1 else f", pixels {guess.aspect:.4g} times as wide as high"
    head = (
        f"The camera has no calibration: from the motion in {found.views} of its images, focal length "
        f"{found.camera.fy:.0f} px +- {percent:.1f} %{pixels}, distortion k1 {k1:+.3f} +- {sigma:.3f}"
    )
    if found.sigma[0] <= RELIABLE_SIGMA:
        return f"{head}. {_BETTER}"
    return f"{head}: for a first look only; a camera that turns more tells more. {_BETTER}"


def _resized(image: Image, width: int) -> Image:
    """Returns the camera with square pixels."""
    if image.shape[1] == width:
        return image
    return np.asarray(cv2.resize(image, (width, image.shape[0]), interpolation=cv2.INTER_LINEAR), np.uint8)


def _images(sequence: Sequence, most: int) -> Iterator[Image]:
    """Yields the video's first images; those that cannot be read are skipped here and reported by the run."""
    for i in np.flatnonzero(np.array(sequence.kinds) == "video")[:most].tolist():
        try:
            exposure = sequence[i]
        except InputError:
            continue
        if is_video(exposure):
            yield exposure.image
