"""`ispom.register`: what a notebook adds is found by name, and a cell may run again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import pytest

import ispom
from ispom.methods import REGISTRY


@pytest.fixture
def mine() -> Iterator[ispom.Method]:
    found = replace(ispom.method("stereo"), name="mine")
    yield found
    for item in [item for item in REGISTRY.items().values() if item.name == "mine"]:
        REGISTRY.remove(item)


def test_a_method_is_found_by_its_name_and_may_be_registered_again(mine: ispom.Method) -> None:
    ispom.register(mine)
    again = replace(mine, source="changed")
    ispom.register(again)
    assert ispom.method("mine") is again
    sequence = ispom.open_sequence("sim:tiny", max_exposures=12)
    assert ispom.run(sequence, "mine").located.any()


def test_what_is_built_in_stays_and_other_things_are_refused(mine: ispom.Method) -> None:
    for item in (replace(mine, name="stereo"), "stereo", 3, ispom.MethodConfig):
        with pytest.raises(ispom.InputError):
            ispom.register(item)
    assert "mine" not in REGISTRY.names()
