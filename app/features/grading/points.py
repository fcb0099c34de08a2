"""Points for what was measured: which value earns how many, and what to look at where some are missing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

from .measure import Measured


@dataclass(frozen=True)
class Part:
    """One value of a stage. Between `zero` and `full` the points grow in proportion."""

    key: str
    """In Measured.values."""
    label: str
    unit: str
    points: int
    full: float
    """Value that earns all points."""
    zero: float
    """Value that earns none."""
    look: str
    """What to look at where points are missing."""

    def earned(self, value: float | None) -> float:
        if value is None or not isfinite(value):
            return 0.0
        return self.points * min(1.0, max(0.0, (value - self.zero) / (self.full - self.zero)))


@dataclass(frozen=True)
class Stage:
    """A stage of visual odometry."""

    name: str
    parts: tuple[Part, ...]


STAGES = (
    Stage(
        "tracking",
        (
            Part("tracks", "right tracks in a frame", "", 5, 100, 10,
                 "Detect new corners where images have none left."),
            Part("wrong_percent", "tracks that are not on their point", "%", 15, 3, 40,
                 "Switch on the layer of tracks and follow the long ones. A forward-backward check ends wrong ones."),
        ),
    ),
    Stage(
        "two-view",
        (
            Part("turn_deg", "error of rotation over 0.33 s", "deg", 10, 0.1, 2,
                 "Compare the pose with the truth. Normalise the points, and use RANSAC."),
            Part("direction_deg", "error of direction over 0.33 s", "deg", 10, 1, 20,
                 "Two views need parallax: skip pairs whose points hardly moved. Check which of the four solutions "
                 "has points in front of both cameras."),
        ),
    ),
    Stage(
        "triangulation",
        (
            Part("landmarks", "landmarks in a frame", "", 5, 60, 5,
                 "Return 3-D points as Step.landmarks, with the ids of their tracks."),
            Part("depth_percent", "error of depth", "%", 15, 3, 30,
                 "Colour the map by its age. Triangulate only where the angle between the rays is large enough."),
        ),
    ),
    Stage(
        "resection",
        (
            Part("reprojection_px", "reprojection error of landmarks", "px", 10, 1, 5,
                 "Find the pose from 2-D and 3-D points (PnP with RANSAC), and refine it on the inliers."),
            Part("located_percent", "frames with a pose", "%", 5, 90, 40,
                 "Go to the first frame without a pose, and read which check failed there."),
            Part("ate_percent", "error of position, of the path", "%", 5, 1, 10,
                 "Open the error curve and go to where it begins to rise."),
        ),
    ),
    Stage(
        "scale",
        (
            Part("scale_percent", "change (or error) of the scale", "%", 20, 5, 60,
                 "Draw the scale over time. Poses from 3-D points keep the unit, motions of length 1 do not."),
        ),
    ),
)  # fmt: skip
"""100 points in all. The limits were set once, on the built-in methods and on the skeleton of `ispom new-method`."""


LABELS = {part.key: f"{part.label} [{part.unit}]" for stage in STAGES for part in stage.parts} | {
    "track_px": "distance of tracks from their points [px]"
}
"""Labels of values, by key."""


@dataclass(frozen=True)
class Result:
    """The points of a part, mean of all runs."""

    part: Part
    points: float
    value: float | None
    """Mean of the runs that have one."""
    worst: tuple[int, int] | None
    """Seed and frame of the run with the fewest points, where a frame can be named."""


def graded(runs: Sequence[Measured]) -> list[tuple[Stage, list[Result]]]:
    """Returns the points of each stage; a run that failed earns none."""
    return [(stage, [_result(part, runs) for part in stage.parts]) for stage in STAGES]


def total(stages: Sequence[tuple[Stage, Sequence[Result]]]) -> float:
    return sum(result.points for _, results in stages for result in results)


def _result(part: Part, runs: Sequence[Measured]) -> Result:
    earned = [part.earned(run.values.get(part.key)) for run in runs]
    values = [value for run in runs if (value := run.values.get(part.key)) is not None]
    least = runs[earned.index(min(earned))]
    worst = (least.seed, least.worst[part.key]) if part.key in least.worst else None
    return Result(part, sum(earned) / len(runs), sum(values) / len(values) if values else None, worst)
