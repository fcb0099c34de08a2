"""The site of all versions: a release adds its own pages, and those of the others stay."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.docs.test_pages import module

ROOT = Path(__file__).parents[2]
VERSIONS = module(ROOT / "docs" / "versions.py")


def built(folder: Path, text: str) -> Path:
    """A site of one page, with what Sphinx leaves beside it."""
    (folder / ".doctrees").mkdir(parents=True, exist_ok=True)
    (folder / ".doctrees" / "index.doctree").write_text("")
    (folder / "index.html").write_text(text)
    (folder / f"{text}.html").write_text(text)
    return folder


def listed(site: Path) -> Any:
    """What the pages read of the versions."""
    text = (site / "versions.js").read_text().removeprefix("window.ISPOM_VERSIONS = ").rstrip("\n;")
    return json.loads(text)


def files(folder: Path) -> dict[str, bytes]:
    """The content of a folder's files, by name."""
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_a_release_adds_its_pages_and_those_of_older_ones_stay(tmp_path: Path) -> None:
    site = tmp_path / "site"
    VERSIONS.publish(built(tmp_path / "a", "first"), site, "0.9.0")
    before = files(site / "0.9.0")
    VERSIONS.publish(built(tmp_path / "b", "second"), site, "0.10.0")
    assert files(site / "0.9.0") == before == {"index.html": b"first", "first.html": b"first"}
    assert files(site / "latest") == files(site / "0.10.0") == {"index.html": b"second", "second.html": b"second"}
    assert listed(site) == {"latest": "0.10.0", "all": ["0.10.0", "0.9.0"]}
    assert (site / ".nojekyll").is_file() and "latest/index.html" in (site / "index.html").read_text()


@pytest.mark.parametrize("version", ["0.9.1", "0.11.0rc1"])
def test_neither_an_old_line_nor_a_candidate_is_the_latest(version: str, tmp_path: Path) -> None:
    site = tmp_path / "site"
    VERSIONS.publish(built(tmp_path / "a", "release"), site, "0.10.0")
    VERSIONS.publish(built(tmp_path / "b", "other"), site, version)
    assert listed(site)["latest"] == "0.10.0" and set(listed(site)["all"]) == {"0.10.0", version}
    assert (site / "latest" / "index.html").read_text() == "release"
    assert (site / version / "index.html").read_text() == "other"


def test_a_release_replaces_only_its_own_earlier_pages(tmp_path: Path) -> None:
    site = tmp_path / "site"
    for text in ("wrong", "right"):
        VERSIONS.publish(built(tmp_path / text, text), site, "0.1.0")
    assert set(files(site / "0.1.0")) == {"index.html", "right.html"} == set(files(site / "latest"))


@pytest.mark.parametrize("name", ["latest", "", "..", "next"])
def test_a_name_that_is_no_version_is_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError):
        VERSIONS.publish(built(tmp_path / "a", "first"), tmp_path / "site", name)
    assert not (tmp_path / "site").exists()


def test_the_workflow_keeps_the_versions_that_are_in_the_branch(tmp_path: Path) -> None:
    """The steps of the workflow, as they are, in a repository whose server is a folder."""
    steps = yaml.safe_load((ROOT / ".github" / "workflows" / "release.yml").read_text())["jobs"]["site"]["steps"]
    (script,) = (step["run"] for step in steps if "docs/versions.py" in step.get("run", ""))
    origin, identity = tmp_path / "origin.git", ("-c", "user.name=n", "-c", "user.email=e@example.org")
    environment = {**os.environ, "GIT_CONFIG_GLOBAL": os.devnull, "GIT_CONFIG_SYSTEM": os.devnull}
    environment["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{environment['PATH']}"

    def git(*words: str, at: Path) -> str:
        command = ["git", *identity, *words]
        return subprocess.run(command, cwd=at, env=environment, check=True, capture_output=True, text=True).stdout

    git("init", "--quiet", "--bare", "-b", "main", str(origin), at=tmp_path)
    for version in ("0.1.0", "0.2.0"):
        clone = tmp_path / version / "clone"
        clone.parent.mkdir()
        git("clone", "--quiet", origin.as_uri(), str(clone), at=tmp_path)
        (clone / "docs").mkdir(exist_ok=True)
        (clone / "docs" / "versions.py").write_text((ROOT / "docs" / "versions.py").read_text())
        (clone / ".gitignore").write_text("docs/_build/\n")
        git("add", "--all", at=clone)
        git("commit", "--quiet", "--allow-empty", "-m", "code", at=clone)
        git("push", "--quiet", "origin", "HEAD:main", at=clone)
        built(clone / "docs" / "_build", version)
        for name in ("lessons", "failures"):
            (clone.parent / name).mkdir()
            (clone.parent / name / f"{version}.html").write_text("")
        done = subprocess.run(
            ["bash", "-e", "-o", "pipefail", "-c", script],
            cwd=clone,
            env={**environment, "GITHUB_REF_NAME": f"v{version}", "RUNNER_TEMP": str(clone.parent)},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
    names = git("ls-tree", "-r", "--name-only", "gh-pages", at=origin).split()
    assert {"0.1.0/0.1.0.html", "0.2.0/0.2.0.html", "latest/0.2.0.html", "versions.js", "index.html"} <= set(names)
    assert [name for name in names if name.startswith(("lessons/", "failures/"))] == [
        "failures/0.2.0.html",
        "lessons/0.2.0.html",
    ]
    assert "latest/0.1.0.html" not in names and not [name for name in names if name.startswith("docs/")]
    assert git("rev-list", "--count", "gh-pages", at=origin).strip() == "2"
