"""Meshes of somebody else: what they name is read from their own folder only."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from ispom.io.meshes import read_coloured_mesh

OBJ = "mtllib a.mtl\nv 0 0 1\nv 1 0 1\nv 0 1 1\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n"


def mesh(folder: Path, texture: str) -> Path:
    folder.mkdir(exist_ok=True)
    (folder / "a.mtl").write_text(f"newmtl m\nmap_Kd {texture}\n")
    (folder / "a.obj").write_text(OBJ)
    return folder / "a.obj"


def picture(path: Path) -> None:
    cv2.imwrite(str(path), np.full((8, 8, 3), 77, np.uint8))


def test_a_texture_beside_it_is_read(tmp_path: Path) -> None:
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
