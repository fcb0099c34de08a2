"""Unpacking the Rerun viewer: out of the wheel's module alone, without a process or a port, or with one sentence."""

from __future__ import annotations

import hashlib
import socket
from importlib.metadata import version
from pathlib import Path

import pytest
from ispom_app.views.web import rerun_assets

import ispom.child

SHA256 = {
    "re_viewer.js": "a11442cae181e4e2087a0fe9d791ec03e5b4932474915a686f9e17678e7afeb5",
    "re_viewer_bg.wasm": "ae2e0f964bf123d4c540bd9d5f172b93cf7e827508c662f2b54ab0c7578309ec",
}
"""Of the files that the wheel's own server gives out, in version 0.41.0."""


def digests(folder: Path) -> dict[str, str]:
    return {name: hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in rerun_assets.NAMES}


@pytest.mark.skipif(version("rerun-sdk") != "0.41.0", reason="the digests are of this version")
def test_the_files_are_those_of_the_wheel_and_nothing_listens(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("unpacking starts a process or opens a socket")

    monkeypatch.setattr(socket, "socket", refuse)
    monkeypatch.setattr(ispom.child.subprocess, "Popen", refuse)
    assert digests(rerun_assets.viewer_assets(tmp_path)) == SHA256


def test_files_in_the_cache_that_another_process_answered_are_replaced(tmp_path: Path) -> None:
    folder = tmp_path / version("rerun-sdk")
    folder.mkdir()
    for name in rerun_assets.NAMES:  # as earlier versions left them: from whatever answered on the port
        (folder / name).write_text("alert('mine now')")
    found = rerun_assets.viewer_assets(tmp_path)
    assert (found / "re_viewer_bg.wasm").read_bytes()[:4] == b"\0asm"
    assert (found / "re_viewer.js").read_text().startswith("let wasm_bindgen")


def test_they_are_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = rerun_assets.viewer_assets(tmp_path)
    monkeypatch.setattr(rerun_assets, "_assets", lambda _: pytest.fail("read again"))
    assert rerun_assets.viewer_assets(tmp_path) == found


def test_a_module_without_them_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module = tmp_path / "rerun_bindings.so"
    module.write_bytes(b"ELF" + rerun_assets.MAGIC + b"\1\2xx" + b"\xff" * 9)
    monkeypatch.setattr(rerun_assets, "_module", lambda: module)
    with pytest.raises(OSError, match="cannot be unpacked") as caught:
        rerun_assets.viewer_assets(tmp_path)
    assert "\n" not in str(caught.value)


def test_without_a_place_for_it_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rerun_assets, "cache_folder", lambda _: None)
    with pytest.raises(OSError, match="make the home folder or the temporary one writable"):
        rerun_assets.viewer_assets()
