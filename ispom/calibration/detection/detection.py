"""What is seen of a target in one image."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ispom.geometry import Array


@dataclass(frozen=True, eq=False)
class Detection:
    """The target's points in one image; without any where `reason` says why the image is not used."""

    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """(N,) increasing: indices of the target's points."""
    uv: Array = field(default_factory=lambda: np.zeros((0, 2)))
    """(N, 2) [px]."""
    sigma_px: Array = field(default_factory=lambda: np.zeros(0))
    """(N,) standard deviation of each coordinate, from how well the edges around agree on the corner."""
    reason: str = ""
    """Why nothing of the image is used; empty where it is."""
    rejected: tuple[tuple[int, str], ...] = ()
    """(id, reason) of single points that were seen and are not used."""

    def __len__(self) -> int:
        return len(self.ids)

    def only(self, keep: NDArray[np.bool_], reason: str = "") -> Detection:
        """Without the points where `keep` (N,) is false, which are rejected for `reason`."""
        more = tuple((int(i), reason) for i in self.ids[~keep])
        return Detection(self.ids[keep], self.uv[keep], self.sigma_px[keep], self.reason, self.rejected + more)

    @staticmethod
    def of(ids: NDArray[np.integer], uv: Array, sigma_px: Array) -> Detection:
        """Ordered by id."""
        order = np.argsort(ids)
        return Detection(np.asarray(ids, np.int64)[order], np.asarray(uv, float)[order], sigma_px[order])
