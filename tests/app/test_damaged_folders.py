"""`ispom repair` of folders whose files are not what they were: it ends, with what it could do or with one sentence."""

from __future__ import annotations

import os
import shutil
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import pytest
from ispom_app.cli.main import main

from tests.app.strangers import killed_run

pytestmark = [
    pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="named pipes are POSIX's"),
    pytest.mark.timeout(60),
]
NAMES = (".part-poses.csv", ".part-steps.csv", ".part-run.rrd", "decisions.csv", "INCOMPLETE", "run.yaml", "rig.yaml")
MOST_BYTES = 200 << 20


def sparse(path: Path) -> None:
    """A file of a terabyte that takes no place on the disk."""
    with path.open("r+b") as file:
        file.truncate(1 << 40)


def replaced(make: Callable[[Path], object]) -> Callable[[Path], object]:
    def damage(path: Path) -> None:
        path.unlink()
        make(path)

    return damage


DAMAGES: dict[str, Callable[[Path], object]] = {
    "a pipe": replaced(lambda path: os.mkfifo(path, 0o600)),
    "a folder": replaced(lambda path: path.mkdir()),
    "a device": replaced(lambda path: path.symlink_to("/dev/zero")),
    "in UTF-16": lambda path: path.write_bytes(path.read_bytes().decode(errors="replace").encode("utf-16")),
    "an endless field": lambda path: path.write_bytes(path.read_bytes()[:400] + b'"' + b"x" * 300_000 + b"\n"),
    "an endless row": lambda path: path.write_bytes(path.read_bytes()[:400] + b"x" * (2 << 20)),
    "zeros": lambda path: path.write_bytes(bytes(1 << 20)),
    "numbers that are none": lambda path: path.write_bytes(path.read_bytes().replace(b"1", b"9" * 400)),
    "sparse": sparse,
    "empty": lambda path: path.write_bytes(b""),
}


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> dict[bool, Path]:
    """With a recording, and without, whose repair takes most of the time."""
    return {has: killed_run(tmp_path_factory.mktemp("killed"), recording=has) for has in (True, False)}


@pytest.mark.parametrize("damage", DAMAGES)
@pytest.mark.parametrize("name", NAMES)
def test_a_damaged_file_is_a_repair_without_it_or_one_sentence(
    name: str, damage: str, killed: dict[bool, Path], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    run = Path(shutil.copytree(killed[name.endswith(".rrd")], tmp_path / "run", symlinks=True))
    DAMAGES[damage](run / name)
    capfd.readouterr()
    tracemalloc.start()
    code = main(["repair", str(run)])
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    message = capfd.readouterr()
    assert code == 0 or (code == 2 and message.err.startswith("ispom: ") and message.err.count("\n") == 1), message.err
    assert code == 2 or not message.err
    assert peak < MOST_BYTES
