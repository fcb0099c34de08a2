"""`ispom report`: one file that tells what is in the folders, loads nothing, and trusts nothing in them."""

from __future__ import annotations

import html
import json
import os
import shutil
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path

import pytest
import yaml
from ispom_app.cli.main import main
from ispom_app.engine.run_folder.run_folder import MARKER

from tests.app import helpers
from tests.app.helpers import ran
from tests.sequences.kitti_folder import make_drive

ATTACK = "</script><script>alert(1)</script><img src=http://example.org/x>"


class Parsed(HTMLParser):
    """What a page refers to, the data that it carries, and whether every element is closed."""

    VOID = frozenset({"meta", "img", "br", "input", "link"})

    def __init__(self, page: str) -> None:
        super().__init__()
        self.references: list[str] = []
        self.open: list[tuple[str, dict[str, str | None]]] = []
        self.figures, self.words = "", ""
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.references += [value or "" for name, value in attrs if name in ("src", "href", "srcset", "data", "action")]
        if tag not in self.VOID:
            self.open.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop()[0] == tag

    def handle_data(self, data: str) -> None:
        tag, attributes = self.open[-1] if self.open else ("", {})
        if attributes.get("id") == "figures":
            self.figures += data
        elif tag not in ("script", "style"):
            self.words += data


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of stand-ins, with a recording."""
    folder = tmp_path_factory.mktemp("made")
    return ran(make_drive(folder / "kitti"), folder / "run", builder=helpers.build)


@pytest.fixture
def run(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "run"))


def report(out: Path, *runs: Path) -> str:
    assert main(["report", *map(str, runs), "--out", str(out)]) == 0
    assert out.stat().st_size < 6e6
    return out.read_text(encoding="utf-8")


def test_one_file_contains_everything_and_loads_nothing(run: Path, tmp_path: Path) -> None:
    page = report(tmp_path / "report.html", run)
    parsed = Parsed(page)
    assert not parsed.open and "default-src 'none'" in html.unescape(page)
    assert parsed.references and all(r.startswith(("#", "data:image/jpeg;base64,")) for r in parsed.references)
    run_file = yaml.safe_load((run / "run.yaml").read_text())
    for word in ("Emulated", "monocular.max_tracks", "500", run_file["versions"]["numpy"], "SHA-256", "run.rrd"):
        assert word in parsed.words
    for word in ("ATE (RMS) [", "keyframes", "off the epipolar line", "median [ms]", "parallax", "slowest"):
        assert word in parsed.words
    figures = json.loads(parsed.figures)
    titles = json.dumps([figure["layout"] for figure in figures])
    for title in ("x [m]", "distance from truth [m]", "estimated / true length [1]", "wall time per frame [ms]"):
        assert title in titles
    colours = {trace["name"]: trace["line"]["color"] for trace in figures[0]["traces"]}
    assert colours == {"truth": "#8a8a8a", "monocular": "#d55e00", "stereo": "#0072b2", "integrated": "#009e73"}


def test_a_folder_whose_name_is_no_text_is_reported_by_its_escapes(run: Path, tmp_path: Path) -> None:
    other = run.rename(tmp_path / os.fsdecode(b"caf\xe9"))
    assert "caf\\udce9" in Parsed(report(tmp_path / "report.html", other)).words


def test_the_same_runs_give_the_same_bytes(run: Path, tmp_path: Path) -> None:
    assert report(tmp_path / "a.html", run) == report(tmp_path / "b.html", run)


def test_several_runs_stand_side_by_side(run: Path, tmp_path: Path) -> None:
    other = Path(shutil.copytree(run, tmp_path / "other"))
    text = (other / "run.yaml").read_text().replace("max_tracks: 500", "max_tracks: 501")
    (other / "run.yaml").write_text(text)
    words = Parsed(report(tmp_path / "report.html", run, other)).words
    assert "2 runs: run, other" in words and "Differences" in words and "501" in words


def test_without_a_run_the_newest_is_suggested(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["report"]) == 2
    assert "no run" in capsys.readouterr().err
    for age_s, name in enumerate(("new", "old")):
        shutil.copytree(run, tmp_path / "recordings" / name)
        os.utime(tmp_path / "recordings" / name / "run.yaml", (1e9 - age_s, 1e9 - age_s))
    assert main(["report"]) == 2
    message = capsys.readouterr().err
    assert f"such as {Path('recordings') / 'new'}" in message and message.count("\n") == 1


def test_what_files_say_is_never_markup(run: Path, tmp_path: Path) -> None:
    run_file = yaml.safe_load((run / "run.yaml").read_text())
    run_file |= {"source": ATTACK, "sequence": ATTACK, "notes": [ATTACK]}
    run_file["config"]["monocular"][ATTACK] = run_file["versions"][ATTACK] = ATTACK
    (run / "run.yaml").write_text(yaml.safe_dump(run_file))
    for name in ("steps.csv", "decisions.csv"):
        text = (run / name).read_text()
        (run / name).write_text(text.replace("parallax", ATTACK).replace("track=", f"{ATTACK}="))
    evil = run.rename(tmp_path / "a<img src=x onerror=alert(1)>")
    parsed = Parsed(page := report(tmp_path / "report.html", evil))
    assert page.count("<script") == 3 and "example.org" not in str(parsed.references) and ATTACK in parsed.words
    assert "<img" not in json.dumps([trace["name"] for f in json.loads(parsed.figures) for trace in f["traces"]])


def test_a_folder_of_an_older_version_is_reported_as_far_as_it_goes(run: Path, tmp_path: Path) -> None:
    for name in ("steps.csv", "decisions.csv", "run.rrd", "truth.tum"):
        (run / name).unlink()
    words = Parsed(report(tmp_path / "report.html", run)).words
    assert "steps.csv is not" in words and "no ground truth" in words


def test_images_are_read_again_without_a_recording(run: Path, tmp_path: Path) -> None:
    (run / "run.rrd").write_bytes(b"no recording")
    parsed = Parsed(report(tmp_path / "report.html", run))
    assert "read again from" in parsed.words and any(r.startswith("data:image/jpeg") for r in parsed.references)
    run_file = (run / "run.yaml").read_text().replace(yaml.safe_load((run / "run.yaml").read_text())["source"], "/gone")
    (run / "run.yaml").write_text(run_file)
    assert "No images" in Parsed(report(tmp_path / "report.html", run)).words


def damage(name: str, old: str | None, new: str) -> Callable[[Path], None]:
    def do(run: Path) -> None:
        text = (run / name).read_text()
        assert old is None or old in text
        (run / name).write_text(new if old is None else text.replace(old, new, 1))

    return do


@pytest.mark.parametrize(
    ("harm", "said"),
    [
        (shutil.rmtree, "holds no run"),
        (lambda run: (shutil.rmtree(run), run.symlink_to("run")), "cannot be read"),
        (lambda run: (run / "run.yaml").unlink(), "holds no run"),
        (lambda run: (run / MARKER).write_text("Stopped by a signal.\n"), "not complete (Stopped by a signal.)"),
        (damage("run.yaml", "source:", "source: ["), "run.yaml line"),
        (damage("run.yaml", "config:", "konfig:"), "run.yaml has no config"),
        (damage("run.yaml", "frame: rig", "frame: [x]"), "the frame is"),
        (damage("run.yaml", None, "[1, 2]"), "run.yaml"),
        (damage("metrics.json", None, '{"methods": '), "metrics.json line 1 is not valid JSON"),
        (damage("metrics.json", None, "[" * 100_000), "metrics.json"),
        (damage("metrics.json", '"stereo"', '"magic"'), "'magic' is none of"),
        (lambda run: (run / "metrics.json").unlink(), "metrics.json is missing"),
        (lambda run: (run / "stereo.tum").unlink(), "stereo.tum is missing"),
        (damage("stereo.tum", None, "1 2 3\n"), "stereo.tum line 1"),
        (damage("stereo.tum", None, "0 1e300 0 0 0 0 0 1\n"), "too large"),
        (damage("steps.csv", "exposure,", "index,"), "steps.csv line 1"),
        (damage("steps.csv", ",tracking,", ",tracking,1,"), "steps.csv line 2"),
        (damage("steps.csv", "track=0.004", "track=nan"), "steps.csv line 2: stages"),
        (damage("steps.csv", "0,0,", "zero,0,"), "steps.csv line 2: exposure is 'zero'"),
        (damage("decisions.csv", ">=", "~"), "decisions.csv line 2: relation is '~'"),
        (lambda run: (run / "steps.csv").write_bytes(b"\xff\xfe\x00"), "not a text file"),
    ],
)
def test_a_bad_folder_is_reported_in_one_sentence(
    run: Path, tmp_path: Path, harm: Callable[[Path], None], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    harm(run)
    assert main(["report", str(run), "--out", str(tmp_path / "report.html")]) == 2
    message = capsys.readouterr().err
    assert said in message and message.startswith("ispom: ") and message.count("\n") == 1
    assert not (tmp_path / "report.html").exists()


@pytest.mark.parametrize("out", ["run/metrics.json", "report", "run"])
def test_only_a_page_is_overwritten(run: Path, tmp_path: Path, out: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", str(run), "--out", str(tmp_path / out)]) == 2
    assert "ends in .html" in capsys.readouterr().err


def test_a_page_of_somebody_else_stays(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "report.html").write_text("<!DOCTYPE html><title>Mine</title>")
    assert main(["report", str(run), "--out", str(tmp_path / "report.html")]) == 2
    assert "earlier output" in capsys.readouterr().err
    assert "Mine" in (tmp_path / "report.html").read_text()
    (tmp_path / "report.html").unlink()
    assert report(tmp_path / "report.html", run) == report(tmp_path / "report.html", run)


def test_a_run_of_the_papers_integration_together_with_the_modern_one(tmp_path: Path) -> None:
    methods = ["integrated", "integrated.paper"]
    arguments = ["run", str(make_drive(tmp_path / "kitti")), "--no-recording", "--methods", *methods]
    assert main([*arguments, "--out", str(tmp_path / "run")], helpers.build) == 0
    figures = json.loads(Parsed(report(tmp_path / "report.html", tmp_path / "run")).figures)
    lines = {trace["name"]: trace["line"]["color"] for trace in figures[0]["traces"]}
    assert lines["integrated"] != lines["integrated.paper"]
    assert [t["name"] for f in figures for t in f["traces"] if t["name"] == "integrated.paper: m per unit"]
