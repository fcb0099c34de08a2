"""Puts the built documentation of a release beside those of the others: `python docs/versions.py BUILT SITE VERSION`.

SITE has a folder for each version, and `latest`, a copy of the newest release. Folders of other versions are never
touched. `versions.js` names all versions: each page loads it, so that old pages know of newer versions, from a web
server and from a disk alike.
"""

from __future__ import annotations

import json
import shutil
import sys
from pathlib import Path

from packaging.version import InvalidVersion, Version

LATEST = "latest"
START = f"""<!doctype html>
<meta charset="utf-8">
<title>ISPOM</title>
<meta http-equiv="refresh" content="0; url={LATEST}/index.html">
<a href="{LATEST}/index.html">ISPOM</a>
"""


def publish(built: Path, site: Path, version: str) -> None:
    """Adds a version to the site, or replaces its own earlier pages. Raises ValueError where it is no version."""
    if not is_version(version):
        raise ValueError(f"'{version}' is no version: give one like 0.2.0")
    _copy(built, site / version)
    versions = versions_in(site)
    if latest(versions) == version:
        _copy(built, site / LATEST)
    listed = {LATEST: latest(versions), "all": versions}
    (site / "versions.js").write_text(f"window.ISPOM_VERSIONS = {json.dumps(listed)};\n", encoding="utf-8")
    (site / "index.html").write_text(START, encoding="utf-8")
    (site / ".nojekyll").touch()  # GitHub shows folders such as _static only with this file


def _copy(built: Path, folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(built, folder, ignore=shutil.ignore_patterns(".doctrees"))


def versions_in(site: Path) -> list[str]:
    """Returns the versions that have a folder, the newest first."""
    names = [path.name for path in site.iterdir() if path.is_dir() and is_version(path.name)]
    return sorted(names, key=Version, reverse=True)


def is_version(name: str) -> bool:
    """Checks that a name is a version as Python's packages have it."""
    try:
        Version(name)
    except InvalidVersion:
        return False
    return True


def latest(versions: list[str]) -> str:
    """Returns the newest release; the newest of all where there are only releases before a release."""
    return next((name for name in versions if not Version(name).is_prerelease), versions[0])


if __name__ == "__main__":
    publish(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3])
