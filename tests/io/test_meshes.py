"""Meshes of somebody else: what they name is read from their own folder only."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from ispom.errors import InputError
from ispom.io import meshes as module
from ispom.io.meshes import read_coloured_mesh

OBJ = "mtllib a.mtl\nv 0 0 1\nv 1 0 1\nv 0 1 1\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n"


def mesh(folder: Path, texture: str) -> Path:
    folder.mkdir(exist_ok=True)
    (folder / "a.mtl").write_text(f"newmtl m\nmap_Kd {texture}\n")
    (folder / "a.obj").write_text(OBJ)
    return folder / "a.obj"


def picture(path: Path) -> None:
    cv2.imwrite(str(path), np.full((8, 8, 3), 77, np.uint8))


def test_a_texture_next_to_it_is_read(tmp_path: Path) -> None:
    path = mesh(tmp_path / "mesh", "own.png")
    picture(tmp_path / "mesh" / "own.png")
    texture = read_coloured_mesh(path).texture
    assert texture is not None and (texture == 77).all()


@pytest.mark.parametrize("name", ["../secret.png", "{}/secret.png", "link.png"])
def test_a_texture_elsewhere_is_not(name: str, tmp_path: Path) -> None:
    path = mesh(tmp_path / "mesh", name.format(tmp_path))
    picture(tmp_path / "secret.png")
    (tmp_path / "mesh" / "link.png").symlink_to(tmp_path / "secret.png")
    texture = read_coloured_mesh(path).texture
    assert texture is None or not (texture == 77).all()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="named pipes are POSIX's")
@pytest.mark.timeout(60)
def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    path = mesh(tmp_path / "mesh", "pipe.png")
    os.mkfifo(tmp_path / "mesh" / "pipe.png")
    assert len(read_coloured_mesh(path).triangles) == 1


def test_corners_beyond_any_length_are_refused(tmp_path: Path) -> None:
    path = mesh(tmp_path / "mesh", "none.png")
    path.write_text(OBJ.replace("v 1 0 1", "v 1e300 0 1"))
    with pytest.raises(InputError, match="holds no triangles"):
        read_coloured_mesh(path)


# Where Open3D or a library below it is missing, one sentence says what to install.


@pytest.mark.parametrize(
    ("fault", "sentence"),
    [
        (ModuleNotFoundError("No module named 'open3d'", name="open3d"), "run 'pip install open3d'"),
        (
            OSError("libusb-1.0.so.0: cannot open shared object file: No such file"),
            r"libusb-1\.0\.so\.0: .*libusb-1\.0",
        ),
        (ImportError("/lib/x86_64-linux-gnu/libEGL.so.1: file too short"), r"library libEGL\.so\.1: install it"),
        (ImportError("DLL load failed while importing pybind"), "DLL load failed .*: install it again"),
    ],
    ids=["not installed", "no libusb", "a broken libEGL", "a broken Open3D"],
)
def test_what_is_missing_is_named_in_one_sentence(
    monkeypatch: pytest.MonkeyPatch, fault: Exception, sentence: str
) -> None:
    def fail(_: str) -> None:
        raise fault

    monkeypatch.setattr(module, "import_module", fail)
    with pytest.raises(InputError, match=sentence) as caught:
        module.open3d()
    assert "\n" not in str(caught.value)


def test_a_module_that_open3d_itself_lacks_is_no_mistake_of_the_user(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: str) -> None:
        raise ModuleNotFoundError("No module named 'numpy'", name="numpy")

    monkeypatch.setattr(module, "import_module", fail)
    with pytest.raises(ModuleNotFoundError):
        module.open3d()
