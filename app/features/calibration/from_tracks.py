"""`ispom calibrate video IMAGES --from-motion`: a camera's interior from its own images, without a target."""

from __future__ import annotations

import json
import sys

from ispom.calibration.diagnostics import Parameter
from ispom.calibration.result import Redo, Verdict
from ispom.calibration.tracked.self_calibration import (
    ADVICE,
    estimate_lens,
    is_informative,
    parameters_of,
    rounded,
    verdict_of,
)
from ispom.calibration.tracked.solve import TrackedLens
from ispom.errors import InputError, printable
from ispom.sequences import open_sequence
from ispom.sequences.guess import guessed
from ispom.types import Guess, Rig

from ...engine.outputs import write_file
from .numbers import JSON_HEAD
from .options import Calibrate
from .saved import save
from .words import parameter_words

MOST_IMAGES = 3000


def lens_from_motion(options: Calibrate) -> tuple[Verdict, list[str]]:
    """The verdict and what to print; files are written. Redo where the images say nothing about the focal length,
    InputError for several places or a report, which is of targets only."""
    if len(options.images) != 1:
        raise InputError(f"--from-motion takes one film or folder of images, not {len(options.images)}: give one")
    if options.report is not None:
        raise InputError("--report shows images of a target: leave it out with --from-motion, or give --json")
    sequence = open_sequence(str(options.images[0]), sensors=None)
    camera = sequence.rig.video
    if camera is None:
        raise InputError(f"{options.images[0]} has no video camera: give images of one camera")
    guess = sequence.guess or guessed((camera.width, camera.height), None)
    found = estimate_lens(sequence, guess, MOST_IMAGES, options.max_views)
    if found is None:
        raise Redo(f"the images have too little motion or texture: {ADVICE}")
    if not is_informative(guess, found):
        raise Redo(f"the motion does not tell the focal length (+- {100 * found.sigma[0]:.0f} %): {ADVICE}")
    verdict, listed = verdict_of(found), parameters_of(found)
    if options.json is not None:
        write_file(options.json, _numbers_text(found, listed, guess, verdict), JSON_HEAD)
    if options.out is not None and verdict.level != "redo":
        about = f"{verdict.level}, from the motion in {sequence.name}, focal length +- {100 * found.sigma[0]:.1f} %"
        save(Rig.single(rounded(found.camera)), None, about, options.out, options.format)
    used = f"{found.views} keyframes, {found.points} points, {found.rms_px:.2f} px (root mean square)"
    return verdict, [*(f"  {parameter_words(each)}" for each in listed), used]


def _numbers_text(found: TrackedLens, listed: tuple[Parameter, ...], guess: Guess, verdict: Verdict) -> str:
    content = {
        "written_by": "ispom calibrate",
        "verdict": verdict.level,
        "reasons": verdict.reasons,
        "film_next": verdict.advice,
        "guess": vars(guess),
        "parameters": [vars(each) for each in listed],
        "undetermined": [f"video.{each.name}" for each in listed if not each.determined],
        "covariance": found.covariance.tolist(),
        "covariance_of": ["log fx", "cx", "cy", "k1", "k2"],
        "reprojection_rms_px": found.rms_px,
        "views": found.views,
        "points": found.points,
    }
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def print_lens(verdict: Verdict, lines: list[str]) -> None:
    """On standard output."""
    head = f"{verdict.level}: {'; '.join(verdict.reasons) or 'nothing to object to'}"
    advice = (f"film next: {text}" for text in verdict.advice)
    sys.stdout.write("".join(f"{printable(line)}\n" for line in (head, *lines, *advice)))
