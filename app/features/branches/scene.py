"""The trajectories of branches that are not shown, as thin lines beside those of the one that is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import viser

from ispom.geometry import Array, Similarity

from ...engine.model.run_model import MethodModel
from ...views.viser.method_scene import add_line
from .branches import Beside

ROOT = "/branches"
THIN = 1.2
"""Width of the lines [px]."""


class BranchScene:
    """A line for each branch and method, in the branch's colour; drawn again where its poses changed."""

    def __init__(self, api: viser.SceneApi) -> None:
        self._api = api
        self._drawn: dict[str, tuple[Any, ...]] = {}

    def show(self, branches: Mapping[int, Beside], hidden: frozenset[str]) -> None:
        """By number; without the hidden methods."""
        wanted: dict[str, None] = {}
        for number, branch in branches.items():
            placements, colour = branch.placements, branch.colour
            for method, known in branch.model.methods.items():
                if method in hidden or not known.poses.drawn_blocks():
                    continue
                name = f"{ROOT}/{number}/{method}"
                wanted[name] = None
                values = (*known.poses.blocks, placements.get(method))
                if not _same(self._drawn.get(name), values):
                    self._drawn[name] = values
                    xyz = placements.get(method, Similarity()).apply(_line(known))
                    add_line(self._api, name, xyz, colour, THIN)
        for name in self._drawn.keys() - wanted.keys():
            self._api.remove_by_name(name)
            del self._drawn[name]


def _line(known: MethodModel) -> Array:
    """(K, 3) of all known poses."""
    return np.concatenate([block.positions[block.known] for block in known.poses.blocks])


def _same(before: tuple[Any, ...] | None, now: tuple[Any, ...]) -> bool:
    return before is not None and len(before) == len(now) and all(a is b for a, b in zip(before, now, strict=True))
