"""Values by name; those that are given by their place are imported when they are used."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from ispom.errors import InputError
from ispom.registry import _REGISTRIES, Registry, named


class Thing:
    def __init__(self, name: str) -> None:
        self.name = name


MODULE = "lazily_imported_thing"


@pytest.fixture
def things(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Registry[Thing]]:
    (tmp_path / f"{MODULE}.py").write_text("from tests.test_registry import Thing\nTHING = Thing('late')\n")
    monkeypatch.syspath_prepend(tmp_path)
    registry = Registry("ispom.things", Thing, "thing", {"late": f"{MODULE}:THING"})
    yield registry
    _REGISTRIES.remove(registry)
    sys.modules.pop(MODULE, None)


def test_a_value_is_imported_when_it_is_asked_for(things: Registry[Thing]) -> None:
    assert things.names() == ("late",) and "late" in things.items() and len(things.items()) == 1
    things.add(Thing("early"))
    with pytest.raises(InputError, match="late"):
        things.add(Thing("late"))
    assert things.get("early").name == "early" and MODULE not in sys.modules
    assert things.get("late").name == "late" and MODULE in sys.modules
    assert things.get("late") is things.items()["late"] is named(f"{MODULE}:THING")
    assert [each.name for each in things.items().values()] == ["late", "early"]


def test_a_name_that_is_none_is_refused_with_all_names(things: Registry[Thing]) -> None:
    with pytest.raises(InputError, match=r"'other' .*late"):
        things.get("other")
    assert MODULE not in sys.modules
