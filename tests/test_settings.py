"""Settings that are given in Python are checked where they are given, or where the method is built."""

from __future__ import annotations

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from ispom.errors import InputError
from ispom.features.front_ends import KLT, REGISTRY
from ispom.methods import Config, method
from ispom.notebook.register import register
from ispom.settings import settings
from tests import doubles


@pytest.mark.parametrize(
    ("values", "name"),
    [
        ({"window": 400, "max_tracks": -5}, "max_tracks"),
        ({"max_tracks": "many"}, "max_tracks"),
        ({"max_tracks": 99.5}, "max_tracks"),
        ({"max_tracks": float("nan")}, "max_tracks"),
        ({"max_tracks": True}, "max_tracks"),
        ({"max_tracks": 10**400}, "max_tracks"),
        ({"max_tracks": -(10**400)}, "max_tracks"),
        ({"loops": "no"}, "loops"),
        ({"features": "freak"}, "features"),
        ({"features": None}, "features"),
    ],
)
def test_a_value_that_cannot_be_is_refused_by_build(values: dict[str, object], name: str) -> None:
    with pytest.raises(InputError, match=f"ModernStereoConfig.{name}"):
        method("stereo").config(**values).build(doubles.rig())


def test_numbers_of_numpy_are_numbers() -> None:
    assert method("stereo").config(max_tracks=np.int64(99)).build(doubles.rig())


@pytest.mark.parametrize("given", [{"stereo": {"max_tracks": 99}}, {"other": None}, {"stereo": None}])
def test_settings_are_those_of_a_method(given: dict[str, object]) -> None:
    with pytest.raises(InputError, match=next(iter(given))):
        Config(given)


def test_choices_are_those_of_now() -> None:
    """A front end of a notebook is registered after its settings were listed."""
    config, names = method("monocular").config, REGISTRY.names()
    assert choices(config) == names
    own = replace(KLT, name="own")
    register(own)
    try:
        assert choices(config) == (*names, "own")
        assert config(features="own").build(doubles.rig())
    finally:
        REGISTRY.remove(own)
    assert choices(config) == names


def choices(config: type) -> tuple[str, ...]:
    (setting,) = (each for each in settings(config) if each.name == "features")
    return get_args(setting.type)
