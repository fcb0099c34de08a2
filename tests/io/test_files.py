"""Files of the user: whatever is in the place of one, it is opened safely or refused in one sentence."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest

from ispom.errors import LONGEST, InputError
from ispom.io.files import bounded, exists, expanded, names, read_bytes
from ispom.io.rows import read_text

linux = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no named pipes here")


@linux
def test_a_named_pipe_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="pipe is a named pipe"):
        read_bytes(tmp_path / "pipe")


@linux
def test_devices_sockets_and_folders_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with socket.socket(socket.AF_UNIX) as made:
        made.bind("socket")
        for path, kind in (("/dev/zero", "a device"), ("socket", "a socket"), (".", "a folder")):
            with pytest.raises(InputError, match=f"is {kind}:"):
                read_bytes(Path(path))


def test_a_file_that_is_too_large_is_not_read(tmp_path: Path) -> None:
    with (tmp_path / "large").open("wb") as file:
        file.truncate(1 << 40)
    with pytest.raises(InputError, match="larger than 65536 kB"):
        read_text(tmp_path / "large")


def test_a_link_to_nothing_is_refused_instead_of_ignored(tmp_path: Path) -> None:
    (tmp_path / "times.txt").symlink_to("gone.txt")
    with pytest.raises(InputError, match=r"times.txt is a link to gone.txt"):
        exists(tmp_path / "times.txt")


def test_a_folder_that_cannot_be_read_is_not_called_empty(tmp_path: Path) -> None:
    (tmp_path / "loop").symlink_to("loop")
    for look in (exists, names):
        with pytest.raises(InputError, match=r"loop cannot be read \(.+\)"):
            look(tmp_path / "loop")


@pytest.mark.parametrize("name", ["a\0b", "x" * 5000, "/".join(["y"] * 5000)])
def test_names_that_no_file_can_have(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cannot be read \(.+\)|is missing"):
        read_bytes(tmp_path / name)


def test_an_unknown_user_s_home_stays_as_written() -> None:
    assert expanded("~no-such-user/x") == Path("~no-such-user/x")
    assert expanded("~") == Path.home()


def test_a_sentence_stays_on_one_line_whatever_it_quotes() -> None:
    said = str(InputError("\x1b[31mred\n.png is missing: " + "x" * 5000))
    assert said.startswith("\\x1b[31mred\\n.png is missing") and said.isprintable() and len(said) <= LONGEST + 20


def test_nothing_outside_of_the_bounds_is_opened_links_followed(tmp_path: Path) -> None:
    inner, secret = tmp_path / "inner", tmp_path / "secret.txt"
    inner.mkdir()
    secret.write_text("secret")
    (inner / "link.txt").symlink_to(secret)
    (inner / "own.txt").write_text("own")
    with bounded((inner,)):
        assert read_bytes(inner / "own.txt") == b"own"
        for path in (secret, inner / "link.txt", inner / ".." / "secret.txt"):
            assert not exists(path)
            with pytest.raises(InputError, match="outside"):
                read_bytes(path)
    with bounded((inner, secret)):
        assert read_bytes(inner / "link.txt") == b"secret"
