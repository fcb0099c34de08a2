"""A program keeps the contract, goes back, and is told its settings."""

from __future__ import annotations

import gc
import pickle
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import pytest

from ispom.errors import InputError
from ispom.estimators.program.estimator import ProgramConfig, program_method
from ispom.estimators.program.store import STORE, FrameStore
from ispom.settings import Range, settings
from ispom.testing import check_estimator
from tests.estimators.program.programs import FORGETS, RIG, SAVES, assert_all_gone, config, faulty, walk

BOTH = pytest.mark.parametrize("command", [SAVES, FORGETS], ids=["saves", "forgets"])


def poses(state: object) -> list[tuple[float, ...]]:
    return [(time_ns, *pose.matrix.ravel()) for time_ns, pose in state.poses]  # type: ignore[attr-defined]


@BOTH
def test_it_keeps_the_contract(command: tuple[str, ...]) -> None:
    check_estimator(program_method(type(config(command)), ("video",)))


@BOTH
def test_two_at_once_do_not_disturb_each_other(command: tuple[str, ...]) -> None:
    alone, other = walk(config(command).build(RIG), 6)[-1], config(command).build(RIG)
    states, first = [other.start()], config(command).build(RIG)
    together = walk(first, 6, hook=lambda _: states.extend(walk(other, 2)))[-1]
    assert poses(together) == poses(alone) and poses(states[-1]) == poses(alone)[:2]


@BOTH
def test_it_goes_on_from_an_earlier_state_in_another_process(command: tuple[str, ...]) -> None:
    states = walk(config(command).build(RIG), 5)
    stored = pickle.loads(pickle.dumps(states[2]))  # noqa: S301 (made in this line)
    again, before = config(command).build(RIG), config(command).build(RIG)
    assert [poses(s) for s in walk(again, 3, stored)] == [poses(s) for s in walk(before, 3, states[2])]


def test_one_that_saves_nothing_cannot_go_back_beyond_its_budget() -> None:
    estimator = config(FORGETS, replay_mb=0).build(RIG)
    states = walk(estimator, 4)
    with pytest.raises(InputError, match=r"frame 2 .*--tested.replay-mb"):
        walk(estimator, 1, states[2])


def test_exposures_are_kept_as_long_as_a_state_refers_to_them() -> None:
    gc.collect()
    before = STORE.used_bytes
    states = walk(config(FORGETS).build(RIG), 4)
    assert STORE.used_bytes - before > 4 * 320 * 240
    again = walk(config(FORGETS).build(RIG), 4)
    assert STORE.used_bytes - before < 5 * 320 * 240, "kept twice"
    del states, again
    gc.collect()
    assert STORE.used_bytes == before


def test_the_program_ends_with_its_estimator(tmp_path: Path) -> None:
    estimator = faulty(tmp_path, "pass").build(RIG)
    walk(estimator, 1)
    del estimator
    gc.collect()
    assert_all_gone(tmp_path / "pids")


@dataclass(frozen=True)
class CompassConfig(ProgramConfig):
    name, command = "compass", SAVES

    min_contrast: Annotated[float, Range(0, 255)] = 5.0
    """Least spread of the columns [grey levels]."""


def test_settings_are_those_of_the_class_and_the_program_receives_its_own() -> None:
    assert [s.name for s in settings(CompassConfig)] == ["timeout_s", "replay_mb", "min_contrast"]
    assert all(s.help and s.range for s in settings(CompassConfig))
    located, blind = (walk(CompassConfig(min_contrast=c).build(RIG), 2)[-1] for c in (5.0, 255.0))
    assert len(located.poses) == 2 and not len(blind.poses)


def test_changed_settings_act_from_there_where_the_program_saves() -> None:
    states = walk(CompassConfig().build(RIG), 4)
    blind = walk(CompassConfig(min_contrast=255.0).build(RIG), 1, states[2])[-1]
    assert poses(blind) == poses(states[2]) and blind.count == 3


def test_what_a_full_disk_does_not_take_is_not_kept_and_its_place_stays_free(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    store = FrameStore()
    first, second = store.keep(b"1", b"abc", 1), store.keep(b"2", b"def", 1)
    del first
    with monkeypatch.context() as patched:
        patched.setattr(store, "_write", full)
        assert not store.keep(b"3", b"ghi", 1).size and store.read(b"3") is None
        assert store.used_bytes == second.size == 3
    again = store.keep(b"3", b"ghi", 1)
    assert again.offset == 0 and store.read(b"3") == b"ghi" and store.read(b"2") == b"def"
