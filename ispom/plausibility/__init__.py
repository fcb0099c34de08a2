"""What in the values of cameras and sensors is likely a mistake: pure functions from values to doubts.

A doubt is a note of a sequence with a key. It is certain, or says "looks like". Its limits come from physics and from
what sensors can do, never from the data of one recording.
"""

from __future__ import annotations

from ispom.plausibility.doubt import DOUBTS, Doubt

__all__ = ["DOUBTS", "Doubt"]
