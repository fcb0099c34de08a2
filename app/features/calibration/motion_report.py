"""A rig found from motion: in words, as JSON, and as a page."""

from __future__ import annotations

import json
from dataclasses import asdict

import numpy as np

from ispom.calibration.motion.combine import clock_of, parameters_of
from ispom.calibration.motion.recorded import FromMotion
from ispom.calibration.result import Verdict
from ispom.errors import printable

from ...presentation.templating import environment
from .drawings import bars
from .words import clock_words, parameter_words

GENERATOR = "ispom calibrate --report"


def facts(found: FromMotion) -> list[str]:
    """What was compared, and how well it agrees."""
    left = found.rough.residuals
    shift, turn = (float(np.sqrt((left[:, part] ** 2).sum(1).mean())) for part in (slice(0, 3), slice(3, 6)))
    out = [
        f"{len(found.rough.used)} of {found.motions} motions of the stereo pair used; the video's differ by "
        f"{1000 * shift:.1f} mm and {np.degrees(turn):.3f} deg (root mean square)",
        clock_words(clock_of(found.found)),
    ]
    if found.found.parts:
        out.append(
            f"{found.found.parts} parts of the recording solved apart; standard errors widened "
            f"{found.found.widened:.1f} times, as these differ"
        )
    return out


def printed(found: FromMotion, verdict: Verdict) -> str:
    """Lines for the terminal."""
    lines = [f"{verdict.level}: {'; '.join(verdict.reasons) or 'nothing to object to'}", "video, seen from left:"]
    lines += [f"  {parameter_words(each)}" for each in parameters_of(found.found)]
    lines += [*facts(found), *(f"film next: {text}" for text in verdict.advice)]
    return "".join(f"{printable(line)}\n" for line in lines)


def numbers_text(found: FromMotion, verdict: Verdict) -> str:
    """All of it; lengths in metres, angles in radians where no name says otherwise."""
    combined, pose = found.found, found.found.video_from_left
    content = {
        "written_by": "ispom calibrate",
        "verdict": verdict.level,
        "reasons": verdict.reasons,
        "film_next": verdict.advice,
        "from_motion": found.sequence.name,
        "clock": asdict(clock_of(combined)),
        "camera_from_first": {
            "video": {"translation_m": pose.translation.tolist(), "rotation_xyzw": pose.xyzw.tolist()}
        },
        "parameters": [asdict(each) for each in parameters_of(combined)],
        "undetermined": [f"video.{each.name}" for each in parameters_of(combined) if not each.determined],
        "covariance": combined.covariance.tolist(),
        "motions_used": len(found.rough.used),
        "motions": found.motions,
        "parts": combined.parts,
        "widened": combined.widened,
        "turned_deg": np.degrees(found.rough.turned_rad).tolist(),
        "turned_about_in_left": found.rough.axes.tolist(),
    }
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def page(found: FromMotion, verdict: Verdict) -> str:
    """The HTML file."""
    errors = np.sqrt(np.diag(found.found.covariance))
    related = found.found.covariance / np.outer(errors, errors)
    names = ["x", "y", "z", "roll", "pitch", "yaw", "clock"]
    residuals = found.rough.residuals
    labels = [f"motion {k}" for k in found.rough.used]
    return (
        environment(__name__.rpartition(".")[0])
        .get_template("motion.html")
        .render(
            generator=GENERATOR,
            name=found.sequence.name,
            verdict=verdict,
            parameters=[parameter_words(each) for each in parameters_of(found.found)],
            facts=facts(found),
            names=names,
            related=[[f"{value:+.2f}" for value in row] for row in related],
            shifts=bars(labels, (1000 * np.linalg.norm(residuals[:, :3], axis=1)).tolist()),
            turns=bars(labels, np.degrees(np.linalg.norm(residuals[:, 3:], axis=1)).tolist()),
        )
    )
