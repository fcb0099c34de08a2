"""The wheel, made from the source distribution as a release makes it: complete, and at work from an empty folder on a
machine that has Python and wheels alone. What it depends on is that of the tests, but for the last ones: they install
all of it from a local index, by pip, uvx and pipx. It takes 10 GB of the disk for a while."""

from __future__ import annotations

import email
import fnmatch
import json
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import tomllib
import zipfile
from collections.abc import Iterator
from pathlib import Path
from urllib.request import urlopen

import pytest

from ispom.child import Child

ROOT = Path(__file__).parents[1]
BARE = ROOT.parent / "shared" / "tools" / "bare"
PACKAGES = {"ispom": "ispom", "app": "ispom_app"}
LEFT_BEHIND = ("__pycache__", "tests")
DEMO_BYTES = 12_000_000
"""Of the recorded frames with which the demo begins, at most."""
MOST_INSTALLED_BYTES = 2_200_000_000
"""Of the whole environment on Linux. The five packages that the project is built on take 1.6 GB with what they need."""
MOST_BYTES = 4_000_000 + DEMO_BYTES
"""Of the wheel: other recordings, and figures, do not belong into it."""


def packaged() -> set[str]:
    """Files that belong into the wheel."""
    return {
        f"{name}/{path.relative_to(ROOT / folder).as_posix()}"
        for folder, name in PACKAGES.items()
        for path in (ROOT / folder).rglob("*")
        if path.is_file() and not set(LEFT_BEHIND) & set(path.relative_to(ROOT / folder).parts)
    }


def test_every_file_that_is_no_code_has_a_pattern() -> None:
    """A folder of a new name would be missing in the wheel, and in no clone."""
    patterns = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"]["*"]
    for file in packaged():
        if not file.endswith(".py"):
            parts = file.split("/")
            names = {pattern: "/".join(parts[-1 - pattern.count("/") :]) for pattern in patterns}
            assert any(fnmatch.fnmatch(name, pattern) for pattern, name in names.items()), file


def test_the_recorded_demo_is_small() -> None:
    found = [path.stat().st_size for path in (ROOT / "app" / "features" / "page" / "demo").iterdir()]
    assert 0 < sum(found) <= DEMO_BYTES


@pytest.fixture(scope="module")
def dist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Both files, of a copy of the sources: what setuptools leaves behind would get into the next one."""
    pytest.importorskip("build")
    source, out = tmp_path_factory.mktemp("source") / "ispom", tmp_path_factory.mktemp("dist")
    ignored = shutil.ignore_patterns(".*", "build", "dist", "tests", "docs", "recordings", "*.egg-info", "__pycache__")
    shutil.copytree(ROOT, source, ignore=ignored)
    command = [sys.executable, "-m", "build", "--outdir", str(out), str(source)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=280, check=False)
    if done.returncode and "No matching distribution found for setuptools" in done.stdout + done.stderr:
        pytest.skip("setuptools cannot be had here")
    assert done.returncode == 0, done.stdout + done.stderr
    return out


@pytest.mark.slow
def test_it_has_all_files_and_no_tests(dist: Path) -> None:
    (wheel,), (sdist,) = dist.glob("*.whl"), dist.glob("*.tar.gz")
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        (about,) = (name for name in names if name.endswith("METADATA"))
        described = email.message_from_string(archive.read(about).decode())
    assert {name for name in names if ".dist-info/" not in name} == packaged()
    assert {name.split("/")[0] for name in names if ".dist-info/" not in name} == {"ispom", "ispom_app"}
    assert wheel.stat().st_size < MOST_BYTES
    with tarfile.open(sdist) as archive:
        inside = {name.partition("/")[2] for name in archive.getnames()}
    assert {"README.md", "LICENSE", "pyproject.toml", "setup.py"} <= inside
    assert described["License-Expression"] == "MIT" and described["Requires-Python"] == ">=3.11"
    assert described.get_all("Classifier") and "visual odometry" in described["Keywords"]
    assert {"bags", "fusion", "cluster", "plots", "all"} <= set(described.get_all("Provides-Extra") or ())


@pytest.fixture(scope="module")
def installed(dist: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[list[str], dict[str, str], Path]:
    """The command, its environment and an empty folder."""
    target, home, empty = (tmp_path_factory.mktemp(name) for name in ("installed", "home", "empty"))
    (wheel,) = dist.glob("*.whl")
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", str(target), str(wheel)]
    subprocess.run(command, check=True, timeout=200)
    environment = {**os.environ, "HOME": str(home), "XDG_CACHE_HOME": f"{home}/cache", "PYTHONPATH": str(target)}
    bare = [str(BARE)] if BARE.is_file() and subprocess.run([BARE, "true"], check=False).returncode == 0 else []
    where = [sys.executable, "-c", "import ispom, ispom_app; print(ispom.__file__, ispom_app.__file__)"]
    found = subprocess.run(where, env=environment, cwd=empty, capture_output=True, text=True, check=True).stdout
    assert found.count(str(target)) == 2, "the sources were imported instead"
    return [*bare, sys.executable, str(target / "bin" / "ispom")], environment, empty


@pytest.mark.slow
def test_it_runs_from_an_empty_folder(installed: tuple[list[str], dict[str, str], Path]) -> None:
    command, environment, empty = installed
    words = ["run", "sim:city", "--variant", "paper", "--max-exposures", "20", "--out", "run"]
    done = subprocess.run([*command, *words], env=environment, cwd=empty, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and not done.stderr, done.stderr
    assert json.loads((empty / "run" / "metrics.json").read_text()) and (empty / "run" / "run.rrd").stat().st_size


@pytest.mark.slow
@pytest.mark.parametrize("words", [["demo"], []], ids=["demo", "start screen"])
def test_it_opens_the_page(words: list[str], installed: tuple[list[str], dict[str, str], Path]) -> None:
    """`ispom` alone opens the start screen, in a browser: here that is none."""
    command, environment, empty = installed
    options = [*(words or ["app"]), "--port", "0", "--no-browser"]
    assert_it_serves_a_page([*command, *options], environment, empty)


@pytest.fixture(scope="module")
def index(dist: Path) -> Iterator[Path]:
    """A folder of the wheel, of all that it needs, and of what pipx needs."""
    (wheel,) = dist.glob("*.whl")
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "pip", "download", "--quiet", "--dest", folder, str(wheel), "pip"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            pytest.skip(f"what it needs cannot be had here: {done.stderr.strip().splitlines()[-1]}")
        yield Path(folder)


@pytest.fixture
def fresh(index: Path) -> Iterator[tuple[dict[str, str], Path]]:
    """The environment of somebody who has installed nothing and kept nothing, and an empty folder."""
    with tempfile.TemporaryDirectory() as folder:
        home, empty = Path(folder) / "home", Path(folder) / "empty"
        empty.mkdir()
        home.mkdir()
        pip = {
            "PIP_NO_INDEX": "1",
            "PIP_FIND_LINKS": str(index),
            "PIP_CONFIG_FILE": os.devnull,
            "PIP_NO_CACHE_DIR": "1",
        }
        uv = {"UV_OFFLINE": "1", "UV_FIND_LINKS": str(index), "UV_PYTHON": sys.executable, "UV_NO_CONFIG": "1"}
        uv |= {"UV_CACHE_DIR": str(home / "uv")}
        pipx = {"PIPX_HOME": str(home / "pipx"), "PIPX_DEFAULT_PYTHON": sys.executable, "PIPX_DEFAULT_BACKEND": "pip"}
        places = {"HOME": str(home), "XDG_CACHE_HOME": str(home / "cache"), "XDG_DATA_HOME": str(home / "data")}
        yield {**os.environ, **places, **pip, **uv, **pipx}, empty


DEMO = ["ispom", "demo", "--port", "0", "--no-browser"]


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_pip_installs_it_from_an_index(fresh: tuple[dict[str, str], Path]) -> None:
    environment, empty = fresh
    venv = empty.parent / "venv"
    subprocess.run([sys.executable, "-m", "venv", str(venv)], env=environment, check=True)
    install = [str(venv / "bin" / "pip"), "install", "--quiet", "ispom"]
    subprocess.run(install, env=environment, cwd=empty, check=True)
    assert_it_serves_a_page([str(venv / "bin" / "ispom"), *DEMO[1:]], environment, empty)
    size = sum(path.lstat().st_size for path in venv.rglob("*"))
    assert sys.platform != "linux" or size < MOST_INSTALLED_BYTES


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("runner", [["uvx"], ["pipx", "run"]], ids=["uvx", "pipx"])
def test_one_command_starts_it(runner: list[str], fresh: tuple[dict[str, str], Path]) -> None:
    """Its duration is that from an empty cache to the page, without what the network takes."""
    if shutil.which(runner[0]) is None:
        pytest.skip(f"{runner[0]} is not installed")
    environment, empty = fresh
    assert_it_serves_a_page([*runner, *DEMO], environment, empty)


def assert_it_serves_a_page(command: list[str], environment: dict[str, str], folder: Path) -> None:
    """Starts the command in a folder, and reads the page whose address it says."""
    script = 'cd "$1"; shift; exec "$@" 2>&1'
    child = Child(["sh", "-c", script, "sh", str(folder), *command], environment)
    try:
        text = ""
        for line in child.answers:
            text += line.decode()
            if address := re.search(r"ISPOM is at (\S+)", text):
                break
        else:
            raise AssertionError(f"it {child.ending()}: {text}")
        with urlopen(address[1], timeout=60) as page:
            assert page.status == 200 and b"<title>" in page.read()
    finally:
        child.stop()
