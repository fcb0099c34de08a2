"""What means the same in several commands is one option: defined once, with one default and one text."""

from __future__ import annotations

from dataclasses import fields
from inspect import get_annotations

import pytest
from ispom_app.cli.commands import COMMANDS

OPTIONS = {name: command.options_class() for name, command in COMMANDS.items().items()}
SAME = {
    "workers": {"experiment", "gate", "triage"},
    "memory_gb": {"experiment", "gate", "triage"},
    "scheduler": {"experiment", "gate", "triage"},
    "shard": {"experiment", "triage"},
    "max_exposures": {"run", "app", "experiment", "gate", "triage", "grade", "shrink", "loops"},
    "source": {"blame", "budget", "doctor", "fork", "loops", "map", "passport", "perturb", "shrink"},
    "repair": {"app", "diff", "evaluate", "export", "map", "perturb", "publish", "report"},
    "seeds": {"experiment", "gate"},
    "recordings": {"experiment", "gate"},
}
"""Commands that have each of them; `memory_gb` of `map` and `grade`, and `source` of others, are something else."""


@pytest.mark.parametrize("name", SAME)
def test_an_option_is_defined_in_one_place(name: str) -> None:
    homes = {
        command: next(kind for kind in OPTIONS[command].__mro__ if name in get_annotations(kind))
        for command in SAME[name]
    }
    assert len(set(homes.values())) == 1, homes


@pytest.mark.parametrize("name", ["shard", "workers", "scheduler", "repair", "max_exposures", "seeds"])
def test_and_no_command_has_another_one_of_that_name(name: str) -> None:
    having = {command for command, kind in OPTIONS.items() if name in {field.name for field in fields(kind)}}
    if name == "max_exposures":
        homes = {k for c in having for k in OPTIONS[c].__mro__ if name in get_annotations(k)}
        assert len(homes) == 1
    else:
        assert having == SAME[name]
