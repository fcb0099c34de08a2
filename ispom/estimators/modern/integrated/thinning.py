"""What leaves the joint window: the oldest pairs, and of very many views between two pairs every second."""

from __future__ import annotations

from itertools import pairwise

from ispom.estimators.modern.integrated.joint_window import JointWindow
from ispom.estimators.modern.integrated.view import View

NEWEST = 8
"""The last views are never thinned out: what comes next is located by their points."""
MOST_ATTACHED = 3
"""Frames that move along with others, per view that the window may have: with more its oldest part leaves it."""


def shortened(window: JointWindow, pairs: int) -> tuple[JointWindow, tuple[View, ...]]:
    """With this many stereo pairs, and the views that left."""
    places = window.pairs
    if len(places) <= pairs:
        return window, ()
    cut = places[-pairs]
    return window.with_views(window.views[cut:], truncated=True), window.views[:cut]


def thinned(window: JointWindow, most: int) -> tuple[JointWindow, tuple[View, ...]]:
    """With at most so many views, and those that left: none, unless a very long time passes between two pairs.

    Where there are too many, every second video view of the longest way between two pairs (or since the last one)
    becomes a frame that moves along with the view before it.
    """
    if len(window.views) <= most:
        return window, ()
    if sum(len(v.attached) for v in window.views) > MOST_ATTACHED * most:
        cut = len(window.views) // 2
        return window.with_views(window.views[cut:], truncated=True), window.views[:cut]
    ends = [-1, *window.pairs, len(window.views) - NEWEST]
    before, after = max(pairwise(ends), key=lambda way: way[1] - way[0])
    views = list[View]()
    for i, view in enumerate(window.views):
        if before < i - 1 and i < after and (i - before) % 2 == 0:
            views[-1] = views[-1].with_attached(view)
        else:
            views.append(view)
    return window.with_views(tuple(views), window.truncated), ()
