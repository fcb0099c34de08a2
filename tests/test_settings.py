"""Settings that are given in Python are checked where they are given, or where the method is built."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.errors import InputError
from ispom.methods import Config, method
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
