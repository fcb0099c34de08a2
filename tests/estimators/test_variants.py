"""The variants: which methods each has, and that both can run side by side."""

from __future__ import annotations

import numpy as np
import pytest

from ispom.errors import InputError
from ispom.estimators import COMPARED, METHODS, Config, ModernConfig, build, default_methods, possible_methods
from ispom.types import Exposure, Sequence


def test_the_papers_variant_has_nothing_to_compare_itself_with(flight: Sequence) -> None:
    assert possible_methods(flight.rig, "paper") == METHODS == default_methods(flight.rig, "paper")
    with pytest.raises(InputError, match="--variant modern"):
        build(Config(variant="paper"), (COMPARED,), flight.rig)


def test_the_modern_one_runs_the_papers_integration_where_asked(flight: Sequence) -> None:
    assert COMPARED in possible_methods(flight.rig, "modern")
    assert COMPARED not in default_methods(flight.rig, "modern")


def test_the_papers_integration_beside_the_modern_methods_is_what_it_is_alone(
    flight: Sequence, exposures: list[Exposure]
) -> None:
    beside = build(Config(variant="modern"), ("monocular", COMPARED), flight.rig)
    alone = build(Config(variant="paper"), ("integrated",), flight.rig)
    modern = build(Config(variant="modern"), ("monocular",), flight.rig)
    states = [ensemble.start() for ensemble in (beside, alone, modern)]
    for exposure in exposures[:45]:
        states[0], steps = beside.step(states[0], exposure)
        states[1], _ = alone.step(states[1], exposure)
        states[2], _ = modern.step(states[2], exposure)
        assert {step.method for step in steps} <= {"monocular", COMPARED}
        assert not any(step.parts for step in steps if step.method == COMPARED)
    found = beside.finish(states[0])
    assert list(found) == ["monocular", COMPARED]
    integrated, monocular = alone.finish(states[1])["integrated"], modern.finish(states[2])["monocular"]
    np.testing.assert_array_equal(found[COMPARED].translations, integrated.translations)
    np.testing.assert_array_equal(found["monocular"].translations, monocular.translations)
    assert len(found[COMPARED]) > 10


def test_settings_are_those_of_the_variant() -> None:
    for variant in ("modern", "paper"):
        config = Config(variant=variant)
        for method in ("monocular", "stereo"):
            changed = config.having(method, type(config.of(method))(max_tracks=123))
            assert changed.of(method).max_tracks == 123 and changed.variant == variant
            assert changed != config and changed.having(method, config.of(method)) == config
    assert Config(variant="modern").of("stereo") == ModernConfig().stereo
    assert Config(variant="modern").of(COMPARED) == Config().integrated
