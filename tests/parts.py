"""Which tests the default run leaves to `.ci/run`."""

FULL = (
    "app/features/doctor/tests/test_rerun.py",
    "app/features/events/tests/test_in_browser.py",
    "app/features/loops/tests/test_command.py",
    "app/features/publish/tests/test_in_browser.py",
    "app/features/publish/tests/test_lessons_in_browser.py",
    "app/features/runs/tests/test_in_browser.py",
    "app/features/stage/tests/test_in_browser.py",
    "tests/accuracy/",
    "tests/app/agents/test_fault.py",
    "tests/app/calibrate/",
    "tests/app/experiment/",
    "tests/app/grading/test_cheats.py",
    "tests/app/page/",
    "tests/app/session/sweeping/",
    "tests/app/test_forked.py",
    "tests/app/test_killed.py",
    "tests/app/viser_ui/",
    "tests/docs/test_notebooks.py",
    "tests/docs/test_versions_in_browser.py",
    "tests/estimators/modern/test_loops.py",
    "tests/estimators/test_contract.py",
    "tests/estimators/test_soak.py",
    "tests/evaluation/audit/test_auditor.py",
    "tests/evaluation/doctor/test_moving.py",
    "tests/evaluation/doctor/test_start.py",
    "tests/evaluation/doctor/test_suspects_of_images.py",
    "tests/evaluation/judge/test_exact.py",
    "tests/evaluation/sensors/test_judged.py",
    "tests/examples/",
    "tests/fuzz/",
    "tests/notebook/test_show_in_browser.py",
    "tests/signals/",
    "tests/test_bare_machine.py",
    "tests/test_without_extras.py",
)
"""Beginnings of paths of tests with the mark `full`: most browser tests, notebooks, programs beside ISPOM, signals,
studies, mutated files, and whole runs of every method and command. They take more than half of the time of all."""
SMOKE = "tests/app/page/test_browser.py"
"""The page in a real browser, which the default run has all the same."""


def is_full(place: str) -> bool:
    """Checks that tests at a path, relative to the project's folder, have the mark `full`."""
    return place.startswith(FULL) and not place.startswith(SMOKE)
