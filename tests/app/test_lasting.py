"""Modules are imported without looking for garbage, and looked for it is again afterwards."""

from __future__ import annotations

import gc

import pytest
from ispom_app.lasting import lasting


@pytest.mark.parametrize("fault", [None, ImportError])
def test_what_is_made_meanwhile_is_not_looked_through(fault: type[Exception] | None) -> None:
    before = gc.get_freeze_count()
    try:
        with lasting():
            assert not gc.isenabled()
            made = [[number] for number in range(1000)]
            if fault:
                raise fault
    except ImportError:
        pass
    finally:
        frozen = gc.get_freeze_count()
        gc.unfreeze()
    assert gc.isenabled() and frozen - before >= len(made)
