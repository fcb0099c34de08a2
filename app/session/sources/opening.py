"""From a source to something that can be played: its sequence, and the estimators that run over it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from ispom.errors import InputError
from ispom.methods import Config, Variant, default_methods, in_order, possible_methods
from ispom.sequences.address import without_secrets
from ispom.types import Sequence

from ...options import SourceOptions
from ...run.beside.given import Given
from ...run.beside.placed import Beside, beside_run
from ...run.playback import Builder, Playback, truth_from_start


@dataclass(frozen=True)
class SourceOpener:
    """How sources are opened, the same for as long as the app runs."""

    opener: Callable[..., Sequence]
    """`opener(source)` opens as the command line said, `opener(source, options)` as the page says."""
    builder: Builder
    variant: Variant
    """Of the methods that run where nobody chose any."""
    given: tuple[Given, ...] = ()
    """Trajectories of other programs, shown where they fit the source."""

    def playback(
        self,
        source: str,
        options: SourceOptions | None,
        methods: tuple[str, ...] | None,
        config: Config,
        *,
        strict: bool,
    ) -> Playback:
        """Opens a source. InputError where it cannot be opened, or the methods do not fit.

        `methods` None means the usual ones. `strict`: exactly these; otherwise those of them that the source has the
        cameras for, or else the usual ones.
        """
        sequence = self.opener(source) if options is None else self.opener(source, options)
        possible, usual = possible_methods(sequence.rig), default_methods(sequence.rig, self.variant)
        if not possible:
            raise InputError(
                f"{without_secrets(source)} has neither a video camera nor a stereo pair: open another source"
            )
        wanted = methods or usual
        chosen = wanted if strict else tuple(m for m in wanted if m in possible) or usual
        sequence, found = beside_those(self.given, sequence)
        return Playback(sequence, chosen, config, self.builder, beside=found)

    def again(self, before: Playback, methods: tuple[str, ...], config: Config) -> Playback:
        """The same sequence from its first exposure on. InputError where the methods do not fit."""
        if not methods:
            raise InputError("no method is selected: select at least one")
        return Playback(before.sequence, in_order(methods), config, self.builder, beside=before.beside)


def beside_those(given: tuple[Given, ...], sequence: Sequence) -> tuple[Sequence, tuple[Beside, ...]]:
    """The trajectories of other programs that fit a sequence; a note in it tells of each that does not."""
    found, notes = list[Beside](), list[str]()
    for number, each in enumerate(given):
        try:
            found.append(beside_run(number, each, sequence, truth_from_start(sequence)))
        except InputError:
            notes.append(f"{each.name} is of another recording and not shown")
    return replace(sequence, notes=(*sequence.notes, *notes)), tuple(found)
