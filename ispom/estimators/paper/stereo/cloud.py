"""The point cloud of one pair: left-right matches along the row, triangulated."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ispom.estimators.paper.stereo.correspondence import Correspondences
from ispom.estimators.paper.stereo.state import Cloud
from ispom.features.row_search import RowSearch
from ispom.solvers.multiview.triangulation import points_from_disparity
from ispom.types import Image, Rig

MIN_DISPARITY_PX = 1.0
"""A smaller disparity says no more than that the point is far."""


def triangulated(rig: Rig, left: Image, right: Image, found: Correspondences) -> tuple[Cloud, NDArray[np.bool_]]:
    """The cloud, and which (N,) of the points are in it."""
    disparity, _ = RowSearch().disparity(left, right, found.features.uv)
    has_depth = disparity >= MIN_DISPARITY_PX
    features = found.features[has_depth]
    xyz = points_from_disparity(rig.camera("left"), rig.baseline_m, features.uv, disparity[has_depth])
    return Cloud(left, found.ids[has_depth], features, disparity[has_depth], xyz), has_depth
