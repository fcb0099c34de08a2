"""Files that appear whole: whatever a stranger's folder holds under their hidden names, no other file is touched."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from ispom.errors import InputError
from ispom.io.whole import append_to_file, create_file, part_of, require_no_links, write_parts, write_whole

ROOT = Path(__file__).parents[2]
OWN_WRITERS = {
    "ispom/io/whole.py",
    "ispom/compiled_code.py",  # these three write to the user's own cache
    "ispom/simulation/rendering/cache.py",
    "app/engine/run_folder/own.py",
    "app/__main__.py",  # standard streams
    "app/engine/memory.py",  # a switch of /proc
    "app/engine/run_folder/table.py",  # cuts a table that it has looked at
}


def test_a_log_goes_on_and_a_link_is_refused(tmp_path: Path) -> None:
    for line in (b"one\n", b"two\n"):
        with append_to_file(tmp_path / "calls.log") as file:
            file.write(line)
    assert (tmp_path / "calls.log").read_bytes() == b"one\ntwo\n"
    (tmp_path / "link").symlink_to(tmp_path / "calls.log")
    with pytest.raises(InputError):
        append_to_file(tmp_path / "link")


def test_a_planted_link_is_replaced_and_not_followed(tmp_path: Path) -> None:
    victim = tmp_path / "precious"
    victim.write_text("mine")
    (tmp_path / "run").mkdir()
    part_of(tmp_path / "run" / "notes.yaml").symlink_to(victim)
    (tmp_path / "run" / "notes.yaml").symlink_to(victim)
    write_whole(tmp_path / "run" / "notes.yaml", "new")
    assert victim.read_text() == "mine"
    assert (tmp_path / "run" / "notes.yaml").read_text() == "new" and not (tmp_path / "run" / "notes.yaml").is_symlink()


def test_a_link_to_nothing_makes_no_file_elsewhere(tmp_path: Path) -> None:
    part_of(tmp_path / "a").symlink_to(tmp_path / "made")
    write_whole(tmp_path / "a", b"new")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a"]


def test_a_hard_link_keeps_its_content(tmp_path: Path) -> None:
    (tmp_path / "precious").write_text("mine")
    os.link(tmp_path / "precious", part_of(tmp_path / "a"))
    write_whole(tmp_path / "a", b"new")
    assert (tmp_path / "precious").read_text() == "mine"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="named pipes are POSIX's")
def test_a_planted_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(part_of(tmp_path / "a"))
    write_whole(tmp_path / "a", b"new")
    assert (tmp_path / "a").read_bytes() == b"new"


def test_a_planted_folder_is_one_sentence(tmp_path: Path) -> None:
    part_of(tmp_path / "a").mkdir()
    with pytest.raises(InputError, match="cannot be written"):
        write_whole(tmp_path / "a", b"new")


def test_a_new_file_is_only_ever_made_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "precious").write_text("mine")
    monkeypatch.setattr(Path, "unlink", lambda *_, **__: None)  # somebody puts a link there after it was removed
    (tmp_path / "a").symlink_to(tmp_path / "precious")
    with pytest.raises(FileExistsError):
        create_file(tmp_path / "a")
    assert (tmp_path / "precious").read_text() == "mine"


def test_a_folder_that_leads_elsewhere_is_refused(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "export").symlink_to(tmp_path)
    with pytest.raises(InputError, match="is a link"):
        require_no_links(tmp_path / "run", tmp_path / "run" / "export" / "tum" / "stereo.tum")
    (tmp_path / "other").symlink_to(tmp_path / "run")  # what the user names may be a link
    require_no_links(tmp_path / "other", tmp_path / "other" / "tum" / "stereo.tum")


def test_nothing_else_opens_a_file_to_write() -> None:
    writes = re.compile(r"""write_text\(|write_bytes\(|open\(\s*["'][rwax]b?\+|open\([^)\n]*["'][wax]b?["']|FileIO\(""")
    sources = [
        path for folder in ("ispom", "app") for path in (ROOT / folder).rglob("*.py") if "tests" not in path.parts[-2:]
    ]
    named = {path.relative_to(ROOT).as_posix() for path in sources if writes.search(path.read_text(encoding="utf-8"))}
    assert named <= OWN_WRITERS


def test_parts_are_written_one_after_the_other_and_a_fault_between_keeps_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "file"
    write_parts(path, iter(["a", b"b", "c"]))
    assert path.read_bytes() == b"abc"

    def broken() -> Iterator[str]:
        yield "x"
        raise OSError(28, "no space")

    with pytest.raises(InputError, match="no space"):
        write_parts(path, broken())
    assert path.read_bytes() == b"abc" and [p.name for p in tmp_path.iterdir()] == ["file"]
