"""What a run suspects at its end: mistakes in its recording that no frame of it shows, in a line each.

A run of a wrong calibration, or of a film that was cut, mirrored or squeezed, may end without any event. So the whole
film is looked at, the path is compared with the ground truth, and the doctor is asked for its quick suspects. A motion
or a drop that troubled no method is no mistake: where nothing went wrong, only the recording and its calibration are
judged.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from ispom.errors import InputError
from ispom.evaluation.doctor.diagnose import diagnose
from ispom.evaluation.doctor.diagnosis import Diagnosis
from ispom.evaluation.doctor.examination import examination
from ispom.evaluation.doctor.suspects import SUSPECTS
from ispom.evaluation.mirrored import mirrored
from ispom.plausibility.doubt import DOUBTS, keys_of
from ispom.stop import check_stop
from ispom.types import Rig, Sequence, Trajectory

from ...engine.run_events.event import RunEvent
from ...engine.run_events.stretch import stretch_of
from .job import Job
from .seen import Seen

FRAMES = 45
"""Frames of the main camera in the doctor's stretch, as `ispom doctor` takes by itself."""
EXPLAINED = frozenset(key for key in DOUBTS if key.startswith(("pair_", "images_"))) - {"images_title"}
"""Keys of notes about what makes the doctor's tracks wrong, too; a title is left out."""
CALIBRATION = "counterfactual"
"""Where the evidence of suspects is from that are about the calibration: a changed one, or a changed clock."""
MISTAKES = frozenset({suspect.key for suspect in SUSPECTS if suspect.how == CALIBRATION} | {"zoom"})
"""Keys of suspects that are a mistake though nothing went wrong."""
NOTHING = Diagnosis(0, 0, ())


def suspicions(job: Job) -> Iterator[str]:
    """Yields a sentence each; none for a simulation, whose faults are known, and a live source.

    Raises what `check_stop` raises.
    """
    said, found = suspected(job)
    yield from said
    if found.causes:
        cause = found.answer.removeprefix("The likely cause: ")
        yield f"Suspected: {cause} `ispom doctor {job.folder.path}` says more."


def suspected(job: Job) -> tuple[list[str], Diagnosis]:
    """Returns the same as sentences about film and paths, and what the doctor's quick suspects say."""
    sequence, seen = job.playback.sequence, job.seen
    if job.options.source.startswith("sim:") or sequence.grow is not None:
        return [], NOTHING
    paths = {} if seen.finished is None else seen.finished.trajectories
    said = [*of_film(seen, sequence), *of_paths(paths, job.playback.truth, sequence.rig)]
    if keys_of(sequence.notes) & EXPLAINED:
        return said, NOTHING
    events = [event for event in job.events.log.events if event.severity.alarming]
    return said, asked(sequence.truncated(job.playback.position), events)


def of_film(seen: Seen, sequence: Sequence) -> list[str]:
    """Returns what is wrong with the film, and was not known when it was opened."""
    known = keys_of(sequence.notes)
    return [doubt for doubt in seen.film.doubts(f"{sequence.name}: {seen.kind}")[0] if doubt.key not in known]


def of_paths(paths: Mapping[str, Trajectory], truth: Trajectory | None, rig: Rig) -> list[str]:
    """Returns a sentence where the path of a method is that of mirrored images; `truth` is world_from_rig."""
    for method, path in paths.items():
        if truth is not None and (words := mirrored(path, truth, rig)):
            return [
                f"Suspected: the images are mirrored {words}, for the path of {method} is, against the ground truth. "
                "Give the images as the camera took them, or correct the ground truth."
            ]
    return []


def asked(sequence: Sequence, alarming: list[RunEvent]) -> Diagnosis:
    """Returns what the doctor's quick suspects say of the stretch that `ispom doctor` examines by itself: all of them
    where something went wrong (`alarming`), else those of the calibration. A guessed calibration is no mistake."""
    try:
        stretch = stretch_of(sequence, None, FRAMES, alarming)
        seen = examination(sequence, stretch.first, stretch.last, check_stop)
    except InputError:  # too short, or unreadable: the run said so
        return NOTHING
    suspects = [each for each in SUSPECTS if alarming or each.key in MISTAKES]
    suspects = [each for each in suspects if sequence.guess is None or each.how != CALIBRATION]

    def advance(name: str) -> bool:
        check_stop()
        return True

    return diagnose(seen, suspects, advance)
