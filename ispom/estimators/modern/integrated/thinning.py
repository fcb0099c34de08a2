"""Removes views from the joint window: the oldest pairs, and every second view of a very long interval between
pairs."""

from __future__ import annotations

from itertools import pairwise

from ispom.estimators.modern.integrated.joint_window import JointWindow
from ispom.estimators.modern.integrated.view import View

NEWEST = 8
"""Number of the newest views that are never thinned out: their points localise the next frames."""
MOST_ATTACHED = 3
"""Largest number of attached frames, per view that the window may have: beyond it the oldest part leaves the window."""


def shortened(window: JointWindow, pairs: int) -> tuple[JointWindow, tuple[View, ...]]:
    """Keeps this number of stereo pairs; returns the window and the views that left."""
    places = window.pairs
    if len(places) <= pairs:
        return window, ()
    cut = places[-pairs]
    return window.with_views(window.views[cut:], truncated=True), window.views[:cut]


def thinned(window: JointWindow, most: int) -> tuple[JointWindow, tuple[View, ...]]:
    """Keeps at most `most` views; returns the window and the views that left: none, unless the time between two pairs
    is very long.

    Every second video view in the interval between pairs (or since the last one) that has the most views is attached to
    the view before it, and moves along with that.
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
