"""Before all tests: the same examples of property tests on every run, compiled kernels, and which tests are `full`."""

from pathlib import Path

import pytest
from hypothesis import settings

from tests.parts import is_full

ROOT = Path(__file__).parents[1]

settings.register_profile("steady", derandomize=True, deadline=None, max_examples=60)
settings.load_profile("steady")


@pytest.hookimpl(tryfirst=True)
def pytest_sessionstart(session: pytest.Session) -> None:
    """Compiles all kernels once, before the processes of the tests start: in each of them a test would wait for it, and
    a command that compiles says so on its standard error, where tests want one sentence."""
    if hasattr(session.config, "workerinput") or not getattr(session.config.option, "numprocesses", None):
        return
    from ispom_app.engine import warmup

    from ispom.kernel_list import kernel_list
    from ispom.methods import Config

    methods = sorted({method for kernel in kernel_list().values() for method in kernel.methods})
    warmup.start(methods, Config())
    while not warmup.finished(60.0):
        pass


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Marks the tests that are `full`, before pytest selects by marks."""
    for item in items:
        if item.path.is_relative_to(ROOT) and is_full(item.path.relative_to(ROOT).as_posix()):
            item.add_marker(pytest.mark.full)
