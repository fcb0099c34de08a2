"""`python -m tests.accuracy.doctor`: what the doctor finds in recordings with one injected fault, and in healthy ones.

The rules were developed on seeds 0 to 9; a study is on seeds from 100 on, each time on new ones. Each case is
`sim:tiny` with one fault, and 45 video frames of it. It prints the confusion matrix as Markdown, and with --out writes
it; --rows keeps the results, so that a study that was interrupted goes on.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import gettempdir
from typing import Any

import numpy as np

from ispom.blas import one_thread
from ispom.evaluation.doctor.diagnose import diagnose
from ispom.evaluation.doctor.examination import examination
from ispom.geometry import Pose
from ispom.io.trajectories import tum_text
from ispom.sequences import open_sequence
from ispom.simulation.motions import motion_of
from ispom.simulation.scenario.scenario import FAULTS
from ispom.types import Frame, Measurement, Sequence, Trajectory

FRAMES = 45
HEALTHY = "healthy"
SWING_DEG, SWING_HZ = 35.0, 0.9


@dataclass(frozen=True)
class Kind:
    """A fault of a given size, and the suspect that is right."""

    suspect: str
    words: str
    """Of the simulation: `sim:tiny?` and these."""


KINDS: Mapping[str, Kind] = {
    HEALTHY: Kind("", ""),
    "darkness, 10 % of the light": Kind("darkness", "fault=darkness"),
    "exposure, gain 1.6 every 0.4 s": Kind("exposure-jumps", "fault=exposure-jumps:every_s=0.4"),
    "defocus, 2.5 px": Kind("blur", "fault=defocus:sigma_px=2.5"),
    "video half covered": Kind("covered-lens", "fault=blocked:share=0.5"),
    "40 drops of rain": Kind("on-lens", "fault=rain"),
    "a fifth of the frames dropped": Kind("dropped-frames", "fault=dropped"),
    "a fifth of the frames repeated": Kind("repeated-frames", "fault=repeated"),
    "left and right exchanged": Kind("exchanged", "exchanged"),
    "clock, 20 ms": Kind("clock", "fault=clock"),
    "video focal length, 3 %": Kind("video-focal", "fault=wrong-lens:focal_percent=3"),
    "video principal point, 6 px": Kind("video-centre", "fault=wrong-lens:focal_percent=0,centre_x_px=6"),
    "video distortion, k1 0.1": Kind("distortion", "fault=wrong-lens:focal_percent=0,k1=0.1"),
    "mount, 1 degree": Kind("mount-turned", "fault=wrong-mount:yaw_deg=1"),
    "right camera, 0.3 degrees": Kind("pair-turned", "fault=wrong-pair:pitch_deg=0.3,yaw_deg=0"),
    "baseline, 30 %": Kind("baseline", "fault=wrong-baseline:percent=30"),
    "rolling shutter, 25 ms": Kind("rolling-shutter", "rolling_shutter_ms=25&fault=wrong-shutter"),
    "camera that only turns": Kind("no-parallax", "motion=rotation"),
    "wall without texture": Kind("low-texture", "place=blank&motion=sideways"),
    "camera swung, 200 degrees per second": Kind("too-fast", "swung"),
    "40 vehicles and 200 people": Kind("moving-objects", "vehicles=40&people=200"),
}
"""By what a person reads in the table."""
assert all(kind.words.partition("fault=")[2].partition(":")[0] in ("", *FAULTS) for kind in KINDS.values())


def recording(kind: Kind, seed: int) -> Sequence:
    """Returns the simulation with the fault."""
    if kind.words == "exchanged":
        return exchanged(open_sequence("sim:tiny", seed=seed))
    if kind.words == "swung":
        return swung(seed)
    return open_sequence(f"sim:tiny?{kind.words}" if kind.words else "sim:tiny", seed=seed)


def swung(seed: int) -> Sequence:
    """Returns the flight of this seed with a camera that is swung to and fro, up to 198 degrees per second."""
    path = motion_of("flight", seed)
    poses = []
    for time_ns in range(0, 2_000_000_000, 10_000_000):
        turn = np.radians(SWING_DEG) * np.sin(2 * np.pi * SWING_HZ * time_ns * 1e-9)
        poses.append((time_ns, path.pose_at(time_ns) @ Pose.from_rotvec(np.array([0.0, turn, 0.0]), np.zeros(3))))
    route = Path(gettempdir()) / f"ispom-doctor-swung-{seed}.tum"  # stays, so that its images are rendered once
    route.write_text(tum_text(Trajectory.of(poses)))
    return open_sequence(f"sim:tiny?route={route}", seed=seed)


def exchanged(sequence: Sequence) -> Sequence:
    """Returns the sequence with the left and right images exchanged."""

    def load(i: int) -> Measurement:
        seen = sequence.load(i)
        if isinstance(seen, Frame) and seen.kind == "stereo":
            return Frame.stereo(seen.time_ns, seen.right, seen.left)
        return seen

    return replace(sequence, load=load)


def case(name: str, seed: int) -> dict[str, Any]:
    """Returns what the doctor says of one recording."""
    sequence = recording(KINDS[name], seed)
    own = [i for i, kind in enumerate(sequence.kinds) if kind == "video"]
    found = diagnose(examination(sequence, 0, own[min(FRAMES, len(own)) - 1]))
    return {
        "kind": name,
        "seed": seed,
        "causes": [each.suspect.key for each in found.causes],
        "strengths": {each.suspect.key: round(each.finding.strength, 3) for each in found.ranked},
    }


def table(rows: list[dict[str, Any]]) -> str:
    """Returns the result as Markdown: a row for each kind of fault, with what came first and how often."""
    lines = ["| fault | cases | first | in the first three | what came first |", "| --- | --- | --- | --- | --- |"]
    first = third = cases = 0
    for name, kind in KINDS.items():
        own = [row for row in rows if row["kind"] == name]
        if not own:
            continue
        answers = Counter(row["causes"][0] if row["causes"] else "nothing found" for row in own)
        said = ", ".join(f"{answer} {count}" for answer, count in answers.most_common())
        if name == HEALTHY:
            lines.append(f"| {name} | {len(own)} | {answers['nothing found']} right | | {said} |")
            continue
        top = answers[kind.suspect]
        near = sum(kind.suspect in row["causes"][:3] for row in own)
        lines.append(f"| {name} ({kind.suspect}) | {len(own)} | {top} | {near} | {said} |")
        first, third, cases = first + top, third + near, cases + len(own)
    if cases:
        lines.append(f"| all faults | {cases} | {100 * first / cases:.0f} % | {100 * third / cases:.0f} % | |")
    return "\n".join(lines) + "\n"


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first-seed", type=int, default=100)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--rows", type=Path, help="JSON lines of results; those that are there are not computed again")
    parser.add_argument("--out", type=Path, help="write the table to this file")
    given = parser.parse_args(arguments)
    one_thread()
    rows: list[dict[str, Any]] = []
    if given.rows is not None and given.rows.exists():
        rows = [json.loads(line) for line in given.rows.read_text().splitlines()]
    done = {(row["kind"], row["seed"]) for row in rows}
    for name in KINDS:
        for seed in range(given.first_seed, given.first_seed + given.seeds):
            if (name, seed) in done:
                continue
            rows.append(case(name, seed))
            sys.stderr.write(f"{seed} {name}: {rows[-1]['causes'][:3]}\n")
            if given.rows is not None:
                given.rows.write_text("".join(json.dumps(row) + "\n" for row in rows))
    sys.stdout.write(table(rows))
    if given.out is not None:
        given.out.write_text(table(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
