"""The registry: what is in it, what other packages add, and any methods beside each other."""

from __future__ import annotations

import pkgutil
from importlib import import_module
from importlib.metadata import EntryPoint

import numpy as np
import pytest

from ispom import registry
from ispom.ensemble import build
from ispom.errors import InputError
from ispom.estimator import Method
from ispom.estimators import survey
from ispom.estimators.paper.stereo import StereoConfig
from ispom.methods import (
    BUILT_IN,
    GROUPS,
    REGISTRY,
    SURVEY,
    Config,
    choices,
    chosen_methods,
    default_methods,
    in_order,
    members,
    method,
    names,
    possible_methods,
    with_dependencies,
)
from ispom.simulation.cameras import ring_rig
from ispom.types import Measurement, Rig, Sequence
from tests.alone import METHODS, OF_CAMERAS, PAPER

NAMES = (*BUILT_IN, *SURVEY)


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest):
    """With the marked entry points of another package."""
    group = REGISTRY.group
    found = [EntryPoint(name, f"tests.estimators.test_methods:{value}", group) for name, value in request.param]
    monkeypatch.setattr(registry, "entry_points", lambda group: found if group == REGISTRY.group else [])
    REGISTRY.refresh()
    yield
    monkeypatch.undo()
    REGISTRY.refresh()


ORB = Method("orb", frozenset({"stereo"}), StereoConfig, "metric", "a package of its own")


def broken() -> Method:
    raise RuntimeError("no such library")


def second_stereo() -> Method:
    return Method("stereo", frozenset({"stereo"}), StereoConfig, "metric", "a name that is taken")


def test_the_built_in_methods_in_their_order() -> None:
    assert names() == NAMES
    assert in_order(("stereo.paper", "monocular", "stereo.paper")) == ("monocular", "stereo.paper")
    assert with_dependencies(("integrated.paper",)) == ("monocular.paper", "stereo.paper", "integrated.paper")
    with pytest.raises(InputError, match=r"'slam' .*monocular.*--external"):
        method("slam")


def test_each_module_of_the_survey_that_has_a_method_is_listed() -> None:
    modules = [import_module(f"{survey.__name__}.{module.name}") for module in pkgutil.iter_modules(survey.__path__)]
    places = {module.METHOD: f"{module.__name__}:METHOD" for module in modules if hasattr(module, "METHOD")}
    found = {(each if isinstance(each, Method) else each()).name: place for each, place in places.items()}
    assert found == SURVEY and sorted(SURVEY) == list(SURVEY)


def test_each_method_has_the_name_under_which_it_is_listed() -> None:
    assert [method(name).name for name in NAMES] == list(NAMES)


def test_a_variant_is_a_choice_of_methods(flight: Sequence) -> None:
    assert possible_methods(flight.rig) == tuple(name for name in NAMES if name not in OF_CAMERAS)
    assert default_methods(flight.rig) == METHODS and default_methods(flight.rig, "paper") == PAPER
    assert default_methods(ring_rig(5)) == OF_CAMERAS


def test_a_group_stands_for_its_methods_that_the_rig_has_the_sensors_for(flight: Sequence) -> None:
    assert GROUPS["paper"] == PAPER and GROUPS["survey"] == tuple(SURVEY)
    assert members(("survey", "stereo", "paper")) == tuple(n for n in NAMES if n not in ("monocular", "integrated"))
    assert choices(("survey", "stereo", "survey", "monocular")) == ("monocular", "stereo", "survey")
    pair = Rig.stereo(flight.rig.sensors["left"].camera, 0.3)  # type: ignore[union-attr]
    assert chosen_methods(("paper",), pair) == ("stereo.paper",)
    assert chosen_methods(("paper", "stereo"), flight.rig) == ("stereo", *PAPER)
    assert chosen_methods((), flight.rig) == METHODS and chosen_methods((), flight.rig, "paper") == PAPER
    assert not set(OF_CAMERAS) & set(chosen_methods(("survey",), flight.rig))
    with pytest.raises(InputError, match="monocular needs"):
        chosen_methods(("monocular", "paper"), pair)
    with pytest.raises(InputError, match="paper"):
        chosen_methods(("paper",), ring_rig(5))
    with pytest.raises(InputError, match="'slam'"):
        choices(("slam",))


@pytest.mark.parametrize("installed", [[("orb", "ORB")]], indirect=True)
def test_another_packages_method_is_one_of_them(
    installed: None, flight: Sequence, exposures: list[Measurement]
) -> None:
    assert names() == (*NAMES, "orb") and not REGISTRY.faults()
    assert "orb" not in default_methods(flight.rig)
    ensemble = build(Config(), ("orb", "stereo.paper"), flight.rig)
    state = ensemble.start()
    for exposure in exposures[:20]:
        state, steps = ensemble.step(state, exposure)
        assert [step.method for step in steps] in ([], ["stereo.paper", "orb"])
    found = ensemble.finish(state)
    np.testing.assert_array_equal(found["orb"].translations, found["stereo.paper"].translations)


@pytest.mark.parametrize(
    "installed", [[("bad", "broken"), ("worse", "nothing"), ("two", "second_stereo")]], indirect=True
)
def test_a_broken_package_is_skipped_and_reported(installed: None) -> None:
    assert names() == NAMES
    bad, two, worse = sorted(REGISTRY.faults())
    assert "no such library" in bad and "new name" in two and "worse" in worse


def test_a_shared_dependency_is_computed_once_and_other_methods_change_nothing(
    flight: Sequence, exposures: list[Measurement]
) -> None:
    together = build(Config(), ("monocular", "integrated.paper"), flight.rig)
    assert list(together.members) == ["monocular", "monocular.paper", "stereo.paper", "integrated.paper"]
    alone = [build(Config(), (name,), flight.rig) for name in together.methods]
    states = [ensemble.start() for ensemble in (together, *alone)]
    for exposure in exposures[:45]:
        states[0], steps = together.step(states[0], exposure)
        states[1:] = [ensemble.step(state, exposure)[0] for ensemble, state in zip(alone, states[1:], strict=True)]
        assert {step.method for step in steps} <= set(together.methods)
        for step in steps:
            assert {part.method for part in step.parts} <= set(method(step.method).asks.values())
    found = together.finish(states[0])
    for ensemble, state in zip(alone, states[1:], strict=True):
        (name,) = ensemble.methods
        np.testing.assert_array_equal(found[name].translations, ensemble.finish(state)[name].translations)
        assert len(found[name]) > 10


def test_settings_belong_to_one_method() -> None:
    for name in ("monocular", "stereo", "monocular.paper", "stereo.paper"):
        config = Config()
        changed = config.with_settings(name, type(config.of(name))(max_tracks=123))
        assert changed.of(name).max_tracks == 123 and changed.with_settings(name, config.of(name)).of(
            name
        ) == config.of(name)
        assert all(changed.of(other) == config.of(other) for other in names() if other != name)
