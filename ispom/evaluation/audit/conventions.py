"""Checks whether one file follows another convention: inverse poses, w first, mirrored axes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from ispom.evaluation.audit.correction import UNDONE, Convention, Correction
from ispom.evaluation.audit.explanation import Explanation, Scene, without_parameters
from ispom.evaluation.audit.samples import Samples

MIRRORS: tuple[Convention, ...] = ("mirrored-x", "mirrored-y", "mirrored-z")


def conventions(scene: Scene, before: Samples) -> Iterator[Explanation]:
    """Returns the explanation by each convention of either file; of the mirrors, by the one that fits best."""
    found = {(name, reference): _by(scene, before, name, reference) for name in UNDONE for reference in (False, True)}
    mirrors = [found.pop((name, False)) for name in MIRRORS]
    for name in MIRRORS:
        del found[name, True]  # the mirror of the one is the mirror of the other
    yield max(mirrors, key=lambda explanation: explanation.gain)
    yield from found.values()


def _by(scene: Scene, before: Samples, name: Convention, reference: bool) -> Explanation:
    if reference:
        rotations, positions = UNDONE[name](before.true_rotations, before.true)
        after = replace(before, true=positions, true_rotations=rotations)
        correction = Correction(reference_conventions=(name,))
    else:
        rotations, positions = UNDONE[name](before.own_rotations, before.own)
        after = before.moved(positions, rotations)
        correction = Correction(conventions=(name,))
    key = "mirrored" if name in MIRRORS else name
    return without_parameters(key, before, after, (scene.with_scale, scene.with_scale), correction)
