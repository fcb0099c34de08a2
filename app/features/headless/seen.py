"""What of a run is kept for what is suspected at its end."""

from __future__ import annotations

from dataclasses import dataclass, field

from ispom.plausibility.film import Film
from ispom.types import images_of

from ...engine.events import Finished, Stepped


@dataclass(eq=False)
class Seen:
    """Grows by 16 bytes for each frame of a film."""

    film: Film = field(default_factory=Film)
    """The images of `kind`."""
    kind: str = ""
    """Of the first frame: those of a pair and of a video camera are no film together."""
    finished: Finished | None = None
    """None before the end of the run."""

    def add(self, event: Stepped) -> None:
        """The next frame."""
        images = images_of(event.exposure)
        if event.skipped or not images:
            return
        self.kind = self.kind or event.exposure.kind
        if event.exposure.kind == self.kind:
            self.film.add(next(iter(images.values())), event.exposure.time_ns)
