"""What happens in a run, as values: it is opened, takes steps, and finishes. Everything that draws, records or counts
a run gets these and nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from uuid import uuid4

import numpy as np

from ispom.geometry import Similarity
from ispom.methods import Config
from ispom.types import Frame, Measurement, Sequence, Step, Trajectory

from .external_trajectories.placed import ExternalTrajectory
from .run_folder.made_map import MadeMap


@dataclass(frozen=True, eq=False)
class Opened:
    """A sequence was opened and its estimators built."""

    sequence: Sequence
    methods: tuple[str, ...]
    config: Config
    truth: Trajectory | None
    """world_from_rig, moved so that it starts at the pose where the estimates start."""
    recording_id: str = field(default_factory=lambda: uuid4().hex)
    """The run's id in all of its recordings: a viewer distinguishes runs by it."""
    external_trajectories: tuple[ExternalTrajectory, ...] = ()
    """Trajectories of other programs over the same sequence."""
    map: MadeMap | None = None
    """What `ispom map` made of this run, where it is over."""
    image_sizes: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    """Width and height of the drawn images, by camera. Only for a recording, whose cameras are not known."""


@dataclass(frozen=True, eq=False)
class Stepped:
    """One frame went through the estimators."""

    index: int
    """Of the frame in the sequence."""
    exposure: Measurement
    steps: tuple[Step, ...]
    placements: Mapping[str, Similarity]
    """By method: shared world from the method's own world. It differs from the identity only for methods with a unit or
    a world of their own."""
    errors_m: Mapping[str, float]
    """By method, the live error: the distance of the rig from the truth, by the pose that this step gave, in the world
    of the first stereo pair. It is not aligned, and so it is no part of the ATE. A provisional pose has none, and
    neither has a method whose unit is unknown."""
    skipped: str = ""
    """Why no estimator saw the frame: which image is unreadable. Its images are empty then."""


@dataclass(frozen=True, eq=False)
class Finished:
    """The sequence ended, or the run was closed early: the final trajectories, each in its own world and frame."""

    trajectories: Mapping[str, Trajectory]
    placements: Mapping[str, Similarity]


@dataclass(frozen=True, eq=False)
class Pictured:
    """The images of an earlier frame that was drawn without them, and that somebody looks at now."""

    index: int
    exposure: Measurement
    steps: tuple[Step, ...]


@dataclass(frozen=True)
class Bookmark:
    """A frame that a person marked."""

    exposure: int
    time_ns: int
    note: str = ""


Event = Stepped | Finished | Pictured


def blank(sequence: Sequence, index: int) -> Measurement:
    """Returns the measurement with empty images, which nobody draws; of another sensor, the measurement itself."""
    time_ns, nothing, kind = int(sequence.times_ns[index]), np.zeros((0, 0), np.uint8), sequence.kinds[index]
    if kind == "stereo":
        return Frame.stereo(time_ns, nothing, nothing)
    if kind == "video":
        return Frame.video(time_ns, nothing)
    return Frame(time_ns, {}) if kind == "cameras" else sequence[index]
