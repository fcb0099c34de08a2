"""A video camera without a calibration: what its focal length is taken from."""

from __future__ import annotations

from dataclasses import dataclass

from ispom.types.camera import Camera


@dataclass(frozen=True)
class Guess:
    """A focal length that nobody measured; distortion is taken to be none, the principal point to be the middle."""

    focal_px: float
    sigma: float
    """Standard deviation, as a share of it."""
    origin: str
    """Where it comes from, in words."""
    aspect: float = 1.0
    """Width of a pixel, as a share of its height; `focal_px` counts heights."""

    def camera(self, size: tuple[int, int]) -> Camera:
        """Of images (width, height)."""
        width, height = size
        return Camera(width, height, self.focal_px / self.aspect, self.focal_px, (width - 1) / 2, (height - 1) / 2)

    @property
    def note(self) -> str:
        """For people: what was assumed, and how sure it is."""
        pixels = "" if self.aspect == 1 else f", pixels {self.aspect:.4g} times as wide as high"
        return (
            f"The camera has no calibration: focal length {self.focal_px:.0f} px +- {100 * self.sigma:.0f} % "
            f"({self.origin}), no distortion{pixels}."
        )
