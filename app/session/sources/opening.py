"""Opens a source for playing: makes its sequence, and the estimators that run over it."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from ispom.calibration.opening import with_estimated_camera
from ispom.errors import InputError
from ispom.io.files import bounded, exists, expanded
from ispom.methods import (
    Config,
    Variant,
    chosen_methods,
    in_order,
    members,
    possible_methods,
    with_dependencies,
)
from ispom.sequences.address import is_address, is_device, without_secrets
from ispom.sequences.policy import ANY_SOURCE, SourcePolicy
from ispom.types import Sequence

from ...engine.external_trajectories.placed import ExternalTrajectory, TrajectoryOption, external_trajectory
from ...engine.options import SourceOptions
from ...engine.playback import Builder, Playback, truth_from_start
from ...engine.run_folder.run_file import read_run_file
from ...engine.run_folder.run_folder import RECORDING, RUN
from ..current_run import CurrentRun
from ..review.folder import read_stored
from ..review.recording import read_recording
from ..review.stored import Stored, source_options
from .folders import Folders

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class SourceOpener:
    """Opens sources. Its values stay the same while the app runs."""

    opener: Callable[..., Sequence]
    """`opener(source)` opens with the options of the command line, `opener(source, options)` with those of the page."""
    builder: Builder
    variant: Variant
    """Variant of the methods that run if nobody chose any."""
    trajectory_options: tuple[TrajectoryOption, ...] = ()
    """Trajectories of other programs, shown where they fit the source."""
    folders: Folders = Folders()
    """Folders in which a person at the page may look for runs and recordings."""
    named: str = ""
    """The source that the command line named; it may be opened wherever it is."""
    beginnings: Mapping[str, Path] = field(default_factory=dict)
    """By source: the folder of a run over its first frames, which are shown as they were recorded until they are
    computed."""
    compare: bool = False
    """Whether images of stored runs are compared with those of the run before any is given: an agent sees them."""
    _asked: set[str] = field(default_factory=set)
    """Sources that were opened."""

    @property
    def asked_for(self) -> frozenset[str]:
        """Returns sources that a person named or opened; a stored run may name these, too."""
        return frozenset({self.named, *self._asked} - {""})

    def stored(self, source: str, memory_bytes: int) -> CurrentRun | None:
        """A run or a recording that is over, where the source is the path of one; else None.

        InputError where it cannot be read, or lies where nobody at the page may look.
        """
        policy = ANY_SOURCE if self.named and source == self.named else SourcePolicy(self.folders.root)
        with bounded(policy.places):
            found = stored_at(source, self.opener, self.builder, policy, self.asked_for, self.compare)
            if found is None:
                return None
            if self.trajectory_options:
                sequence, shown = with_external_trajectories(self.trajectory_options, found.playback.sequence)
                found = replace(found, playback=replace(found.playback, sequence=sequence, external_trajectories=shown))
            return CurrentRun.of_stored(found, memory_bytes)

    def playback(
        self,
        source: str,
        options: SourceOptions | None,
        methods: tuple[str, ...] | None,
        config: Config,
        *,
        strict: bool,
        progress: Callable[[str], None],
    ) -> Playback:
        """Opens a source; `progress` gets the name of what takes long. InputError where it cannot be opened, or the
        methods do not fit.

        `methods` None means the usual ones; they may be groups. `strict`: exactly these; otherwise those of them that
        the source has the cameras for, or else the usual ones.
        """
        sequence = self.opener(source) if options is None else self.opener(source, options)
        self._asked.add(source)
        if sequence.guess is not None:
            progress(f"{without_secrets(source)} has no calibration: finding focal length and distortion in its images")
            sequence = with_estimated_camera(sequence)
        possible = possible_methods(sequence.rig)
        if not possible:
            raise InputError(
                f"{without_secrets(source)} has neither a video camera nor a stereo pair: open another source"
            )
        words = methods or ()
        if not strict:
            words = tuple(name for name in members(words) if name in possible)
        chosen = chosen_methods(words, sequence.rig, self.variant)
        sequence, externals = with_external_trajectories(self.trajectory_options, sequence)
        return Playback(sequence, chosen, config, self.builder, external_trajectories=externals)

    def begun(self, playback: Playback, source: str, options: SourceOptions, memory_bytes: int) -> CurrentRun | None:
        """The run that this playback is about to compute, with its first frames as they were recorded; None where none
        were, of this source, opened so, with these methods and settings."""
        folder = self.beginnings.get(source)
        if folder is None or playback.external_trajectories:
            return None
        try:
            stored, run = read_stored(folder, lambda *_: playback.sequence, self.builder), read_run_file(folder)
            fits = (
                not stored.unavailable
                and stored.recording is not None
                and run.sequence == playback.sequence.name
                and replace(source_options(run), max_exposures=None) == options
                and stored.playback.methods == playback.methods
                and all(
                    stored.playback.config.of(m) == playback.config.of(m) for m in with_dependencies(stored.methods)
                )
            )
            return CurrentRun.begun_by(replace(stored, playback=playback), memory_bytes) if fits else None
        except InputError as fault:
            log.warning("the recorded beginning of %s is not shown: %s", source, fault)
            return None

    def again(self, before: Playback, methods: tuple[str, ...], config: Config) -> Playback:
        """The same sequence from its first frame on. InputError where the methods do not fit."""
        if not methods:
            raise InputError("no method is selected: select at least one")
        return Playback(
            before.sequence, in_order(methods), config, self.builder, external_trajectories=before.external_trajectories
        )


def stored_at(
    source: str,
    opener: Callable[..., Sequence],
    builder: Builder,
    policy: SourcePolicy = ANY_SOURCE,
    named: Collection[str] = (),
    compare: bool = False,
) -> Stored | None:
    """The run or the recording that is over, where the source is the path of one; else None. `named` and `compare` as
    in `read_stored`. InputError where it cannot be read, or `policy` forbids it."""
    if source.startswith("sim:") or is_device(source) or is_address(source):
        return None
    policy.check(source)
    with bounded(policy.places):
        path = expanded(source)
        folder = path.parent if path.name == RECORDING else path
        if path.name == RUN or not (exists(folder / RUN) or path.suffix == ".rrd"):
            return None
        found = exists(folder / RUN)
        return read_stored(folder, opener, builder, named, compare) if found else read_recording(path)


def with_external_trajectories(
    trajectory_options: tuple[TrajectoryOption, ...], sequence: Sequence
) -> tuple[Sequence, tuple[ExternalTrajectory, ...]]:
    """Returns the sequence, with a note for each trajectory that does not fit, and the trajectories that do."""
    externals, notes = list[ExternalTrajectory](), list[str]()
    for number, each in enumerate(trajectory_options):
        try:
            externals.append(external_trajectory(number, each, sequence, truth_from_start(sequence)))
        except InputError:
            notes.append(f"{each.name} is of another recording and not shown")
    return replace(sequence, notes=(*sequence.notes, *notes)), tuple(externals)
