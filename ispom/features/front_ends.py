"""The available front ends: built-in ones, and those of installed packages."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ispom.features import orb, sift, surf
from ispom.features.harris import Harris
from ispom.features.interfaces import FrontEnd
from ispom.features.klt import Klt
from ispom.features.patches import PatchTracker
from ispom.features.shi_tomasi import ShiTomasi
from ispom.features.susan import Susan
from ispom.registry import Registry

KLT = FrontEnd(
    "klt",
    "Shi & Tomasi 1994; Bouguet 2001; recognition by SIFT",
    ShiTomasi(),
    Klt(levels=5),
    Klt(levels=3, max_forward_backward_px=np.inf),
    sift.SIFT,
    sift.SIFT_MATCHER,
)
"""The default front end."""
CORNERS = replace(KLT, name="corners", detector=ShiTomasi(spread=False), tracker=Klt(levels=4), guided=Klt(levels=4))
"""The default front end of the paper's method: the strongest corners, tracked with a forward-backward check."""
PATCHES = FrontEnd(
    "patches",
    "Shi & Tomasi 1994; Baker & Matthews 2004; recognition by SIFT",
    ShiTomasi(),
    PatchTracker(levels=4),
    PatchTracker(levels=2),
    sift.SIFT,
    sift.SIFT_MATCHER,
)
SHI_TOMASI = replace(KLT, name="shi_tomasi", tracker=Klt(levels=4), guided=Klt(levels=4))
"""Corners of an even spread, tracked with a forward-backward check; the next two differ in the detector only."""
HARRIS = replace(SHI_TOMASI, name="harris", reference="Harris & Stephens 1988; Bouguet 2001", detector=Harris())
SUSAN = replace(SHI_TOMASI, name="susan", reference="Smith & Brady 1997; Bouguet 2001", detector=Susan())
REGISTRY = Registry(
    "ispom.front_ends",
    FrontEnd,
    "front end",
    (KLT, CORNERS, PATCHES, sift.FRONT_END, orb.FRONT_END, surf.FRONT_END, HARRIS, SUSAN, SHI_TOMASI),
    "or install the package that adds it",
)
"""Registry of front ends; entry points of its group name a FrontEnd, or a function that returns one."""
front_end, front_ends = REGISTRY.get, REGISTRY.names
