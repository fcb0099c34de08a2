"""What is lost when the run on the screen is closed for another one."""

from __future__ import annotations

from collections.abc import Collection

from ispom.sequences.address import is_address, is_device

from .state import State


def loss(state: State, recorded: Collection[int]) -> str:
    """What would be lost, as part of a sentence; empty where all of it is kept elsewhere or can be had again.

    `recorded` has the numbers of the branches that are, or were, recorded.
    """
    own = [b for b in state.branches if b.parent is not None and not b.reproducible and b.number not in recorded]
    names = ", ".join(branch.name for branch in own)
    lost = [f"the branch {names}" if len(own) == 1 else f"{len(own)} branches ({names})"] if own else []
    if state.computed and 0 not in recorded and (is_device(state.source) or is_address(state.source)):
        lost.append(f"the live run of {state.source}")
    return " and ".join(lost)
