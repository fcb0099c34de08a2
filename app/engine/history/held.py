"""How much of a run is held, and what was thinned out of it: a value for people to read."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Held:
    """Of one run; all its exposures are on disk, with poses, statuses and checks."""

    in_memory: int = 0
    """The newest exposures that are in memory as well."""
    exposures_bytes: int = 0
    """Memory that they take."""
    points_from: int = 0
    """The first exposure that has its tracks, landmarks and residuals still."""
    states: int = 0
    """States to fork from; others are reached by replay from them."""
    states_bytes: int = 0
    """Memory that they take."""
    interval: int = 0
    """Exposures from one such state to the next."""

    @property
    def sentence(self) -> str:
        """Empty where nothing is held."""
        if not self.interval:
            return ""
        newest = f"the newest {self.in_memory} in memory ({_mb(self.exposures_bytes)})"
        tracks = f"tracks from exposure {self.points_from} on" if self.points_from else "tracks of all exposures"
        return (
            f"Held: all exposures on disk, {newest}; {tracks}; "
            f"{self.states} states to fork from, one in {self.interval} exposures ({_mb(self.states_bytes)})."
        )


def _mb(size_bytes: int) -> str:
    return f"{size_bytes / 1e6:.0f} MB"
