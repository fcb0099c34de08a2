"""`ispom passport` on stand-ins for methods, whose poses are known."""

from __future__ import annotations

import hashlib
import json
import re
import shlex
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from random import Random
from typing import Any

import msgspec
import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from ispom_app.cli.main import main
from ispom_app.engine.outputs import MARKER
from ispom_app.features.passport.outputs import spread
from ispom_app.features.passport.readme import CITATION, README
from ispom_app.features.passport.written import PASSPORT, Passport

from ispom.ensemble import Ensemble
from ispom.geometry import Pose
from ispom.io.files import noted
from ispom.methods import Config
from ispom.types import Rig, Trajectory
from tests import doubles
from tests.app import helpers
from tests.app.strangers import killed_run
from tests.app.written import breaks_schema
from tests.fuzz.mutations import mutate
from tests.sequences.kitti_folder import make_drive
from tests.sequences.own_folders import make_images

ROOT = Path(__file__).parents[4]
FRAMES, SHIFT_M, TURN_DEG = 6, 0.25, 3.0
METHODS = ("stereo", "monocular")


class Shifted(doubles.FakeEstimator):
    """Its last final pose is beside the path, and turned: at half of the distance for the one before."""

    def finish(self, state: tuple[int, ...], asked: object = None) -> Trajectory:
        found = super().finish(state)
        for n, share in ((-1, 1.0), (-2, 0.5)):
            found.translations[n, 1] += share * SHIFT_M
            turn = Pose.from_rotvec(np.array([0, 0, np.radians(share * TURN_DEG)]), np.zeros(3))
            found.rotations[n] = found.rotations[n] @ turn.rotation
        return found


class Certain(doubles.FullEstimator):
    """States covariances."""


def shifted(config: Config, methods: tuple[str, ...], rig: Rig) -> Ensemble:
    return doubles.ensemble(methods, Shifted)


def certain(config: Config, methods: tuple[str, ...], rig: Rig) -> Ensemble:
    return doubles.ensemble(methods, Certain)


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without compiled code: the methods are stand-ins."""
    monkeypatch.setattr("ispom_app.features.headless.command.warmup.start", lambda *_: None)


def ispom(*words: object, builder: Callable = helpers.build) -> int:
    return main(list(map(str, words)), builder)


def run(source: Path | str, out: Path, *words: object, builder: Callable = helpers.build) -> Path:
    chosen = () if "--methods" in words else ("--methods", *METHODS)
    assert ispom("run", source, "--no-recording", "--out", out, *chosen, *words, builder=builder) == 0
    return out


def content(folder: Path) -> dict[str, Any]:
    return json.loads((folder / PASSPORT).read_text())


def changed(folder: Path, change: Callable[[dict[str, Any]], object]) -> None:
    values = content(folder)
    change(values)
    (folder / PASSPORT).write_text(json.dumps(values))


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    return make_drive(tmp_path / "kitti", FRAMES)


@pytest.fixture
def made(drive: Path, tmp_path: Path) -> Path:
    """A passport."""
    assert ispom("passport", run(drive, tmp_path / "run"), "--to", tmp_path / "passport") == 0
    return tmp_path / "passport"


def first_line(capsys: pytest.CaptureFixture[str]) -> str:
    return capsys.readouterr().out.splitlines()[0]


def test_a_passport_says_what_the_run_was_and_its_schema_describes_it(made: Path, drive: Path, tmp_path: Path) -> None:
    text = (made / PASSPORT).read_text()
    assert not breaks_schema("passport", text)
    found = msgspec.json.decode(text, type=Passport)
    names = {each.name: each for each in found.source.files}
    expected = {"calib.txt", "times.txt", "../../poses/07.txt"}
    expected |= {f"image_{side}/{i:06d}.png" for side in (0, 1) for i in range(FRAMES)}
    assert set(names) == expected
    for name, each in names.items():
        whole = (drive / name).read_bytes()
        assert (each.bytes, each.sha256) == (len(whole), hashlib.sha256(whole).hexdigest())
    assert {each.method for each in found.outputs} == set(METHODS) <= set(found.config)
    for each in found.outputs:
        poses = (made / f"{each.method}.tum").read_bytes()
        assert poses == (tmp_path / "run" / f"{each.method}.tum").read_bytes()
        assert each.poses_sha256 == hashlib.sha256(poses).hexdigest()
        assert each.figures["located"] == FRAMES and each.figures["ate_m"] is not None
    assert {"ispom", "python", "numpy", "opencv-python-headless", "rerun-sdk"} <= set(found.machine.versions)
    assert found.machine.platform and found.machine.processor
    assert str(tmp_path) not in (made / CITATION).read_text()
    assert "ispom passport --verify ." in (made / README).read_text()


def test_it_cites_as_the_project_does(made: Path) -> None:
    own, project = (yaml.safe_load((folder / CITATION).read_text()) for folder in (made, ROOT))
    assert own["cff-version"] == project["cff-version"] and own["authors"] == project["authors"]
    software, paper = own["references"]
    assert [paper] == project["references"]
    assert {key: project[key] for key in software} == software


def test_the_command_that_is_named_can_be_copied(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = tmp_path / "mein Pass"
    folder = run(drive, tmp_path / "run")
    capsys.readouterr()
    assert ispom("passport", folder, "--to", place) == 0
    (command,) = re.findall("`ispom (passport --verify .*)`", capsys.readouterr().out)
    assert shlex.split(command) == ["passport", "--verify", str(place)]


def test_the_same_run_gives_the_same_bytes(made: Path, drive: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert ispom("passport", "--verify", made) == 0
    assert capsys.readouterr().out.splitlines() == [
        "same bytes: " + ", ".join(e["method"] for e in content(made)["outputs"])
    ]
    elsewhere = shutil.copytree(drive.parents[1], made.parent / "copied") / "sequences" / "07"
    shutil.rmtree(drive.parents[1])
    assert ispom("passport", "--verify", made) == 2
    assert ispom("passport", "--verify", made, "--source", elsewhere) == 0


def test_two_passports_of_a_run_are_the_same_bytes(made: Path, tmp_path: Path) -> None:
    assert ispom("passport", tmp_path / "run", "--to", tmp_path / "again") == 0
    for path in made.iterdir():
        assert path.read_bytes() == (tmp_path / "again" / path.name).read_bytes(), path.name


def test_somebody_elses_passport_needs_a_named_source(made: Path, drive: Path) -> None:
    (made / MARKER).unlink()
    assert ispom("passport", "--verify", made) == 2
    assert ispom("passport", "--verify", made, "--source", drive) == 0


@pytest.mark.parametrize(
    ("name", "change", "word"),
    [
        ("image_0/000003.png", lambda p: p.write_bytes(p.read_bytes()[:-20] + b"x" + p.read_bytes()[-19:]), "differs"),
        ("image_1/000000.png", lambda p: p.write_bytes(p.read_bytes() + b"x"), "differs"),
        ("image_1/000002.png", Path.unlink, "is missing"),
        ("calib.txt", lambda p: p.write_text("P0: nothing\n"), "differs"),
        ("../../poses/07.txt", lambda p: p.write_text(p.read_text().replace("0.5", "0.6", 1)), "differs"),
        ("../../poses/07.txt", Path.unlink, "is missing"),
    ],
)
def test_a_file_that_is_not_the_runs_is_named(
    made: Path, drive: Path, name: str, change: Callable, word: str, capsys: pytest.CaptureFixture[str]
) -> None:
    change(drive / name)
    capsys.readouterr()
    assert ispom("passport", "--verify", made) == 2
    assert f"{name} {word}" in capsys.readouterr().err


def test_a_file_that_came_later_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drive = make_drive(tmp_path / "kitti", FRAMES, poses=False)
    assert ispom("passport", run(drive, tmp_path / "run"), "--to", tmp_path / "passport") == 0
    (drive.parents[1] / "poses").mkdir()
    rows = [f"1 0 0 0 0 1 0 0 0 0 1 {i}\n" for i in range(FRAMES)]
    (drive.parents[1] / "poses" / "07.txt").write_text("".join(rows))
    assert ispom("passport", "--verify", tmp_path / "passport") == 2
    assert "poses/07.txt is read, too" in capsys.readouterr().err


def test_more_images_than_the_run_had_are_another_source(tmp_path: Path) -> None:
    images, made = make_images(tmp_path / "data", FRAMES), tmp_path / "passport"
    assert ispom("passport", run(images, tmp_path / "run", "--methods", "monocular"), "--to", made) == 0
    last = max(images.glob("*.png"))
    shutil.copy(last, last.with_stem(f"{int(last.stem) + 1:0{len(last.stem)}d}"))
    assert ispom("passport", "--verify", made) == 2


def test_other_poses_give_their_distance(made: Path, drive: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert ispom("passport", "--verify", made, builder=shifted) == 1
    out = capsys.readouterr().out
    assert out.startswith("not the same bytes: ")
    (line,) = (each for each in out.splitlines() if each.startswith("stereo: "))
    assert f"at most {SHIFT_M:.3g} m (median 0)" in line and f"at most {TURN_DEG:.3g} deg" in line


def test_the_distance_stands_beside_what_the_run_says_of_itself(
    drive: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = tmp_path / "passport"
    assert ispom("passport", run(drive, tmp_path / "run", builder=certain), "--to", made) == 0
    (stereo,) = (each for each in content(made)["outputs"] if each["method"] == "stereo")
    middle = (FRAMES + 1) / 2  # the covariance grows with each frame
    assert stereo["sigma_position"] == pytest.approx(np.median(np.sqrt(0.03 * np.arange(1, FRAMES + 1))), rel=1e-6)
    assert stereo["sigma_deg"] == pytest.approx(np.degrees(1e-2 * np.sqrt(middle)), rel=0.05)
    capsys.readouterr()
    assert ispom("passport", "--verify", made, builder=shifted) == 1
    assert f"{stereo['sigma_position']:.3g} m" in capsys.readouterr().out


@pytest.mark.parametrize("key", ["poses_sha256", "steps_sha256"])
def test_another_digest_is_no_same_bytes(made: Path, drive: Path, key: str, capsys: pytest.CaptureFixture[str]) -> None:
    changed(made, lambda values: values["outputs"][0].update({key: "0" * 64}))
    name, other = (each["method"] for each in content(made)["outputs"])
    capsys.readouterr()
    assert ispom("passport", "--verify", made, "--source", drive) == 1
    said = capsys.readouterr().out.splitlines()
    assert said[:2] == [f"not the same bytes: {name}", f"same bytes: {other}"]
    assert ("at most 0 " in said[2]) == (key == "poses_sha256")


def test_what_differs_in_versions_and_processor_is_named(
    made: Path, drive: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    changed(made, lambda values: values["machine"].update({"processor": "abacus"}))
    changed(made, lambda values: values["machine"]["versions"].update({"numpy": "0.1"}))
    capsys.readouterr()
    assert ispom("passport", "--verify", made, "--source", drive) == 0
    said = capsys.readouterr().out
    assert said.startswith("same bytes") and "processor: abacus | " in said and "versions.numpy: 0.1 | " in said


def test_of_a_method_that_is_not_here_nobody_can_tell(
    made: Path, drive: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    changed(made, lambda values: values["outputs"][0].update(method="../away"))
    other = content(made)["outputs"][1]["method"]
    capsys.readouterr()
    assert ispom("passport", "--verify", made, "--source", drive) == 3
    assert capsys.readouterr().out.splitlines()[:2] == ["cannot tell: ../away", f"same bytes: {other}"]
    changed(made, lambda values: values["config"][other].update(surprise=1))
    assert ispom("passport", "--verify", made, "--source", drive) == 3
    assert first_line(capsys) == f"cannot tell: ../away, {other}"


def test_a_fork_and_a_run_that_was_stopped_are_repeated(drive: Path, tmp_path: Path) -> None:
    parent = run(drive, tmp_path / "run")
    words = ("--at", 3, "--methods", "stereo", "--stereo.max-tracks", 77, "--no-recording", "--out", tmp_path / "fork")
    assert ispom("fork", parent, *words) == 0
    assert ispom("passport", tmp_path / "fork", "--to", tmp_path / "of-fork") == 0
    assert content(tmp_path / "of-fork")["forked"][0]["at"] == 3
    stages = list[tuple[tuple[str, ...], int]]()

    def builder(config: Config, methods: tuple[str, ...], rig: Rig) -> Ensemble:
        stages.append((methods, config.of("stereo").max_tracks))
        return helpers.build(config, methods, rig)

    assert ispom("passport", "--verify", tmp_path / "of-fork", builder=builder) == 0
    assert (("stereo",), 77) in stages and any("monocular" in methods and most != 77 for methods, most in stages)
    stopped = run(drive, tmp_path / "stopped", "--until", "exposure >= 3")
    assert ispom("passport", stopped, "--to", tmp_path / "of-stopped") == 0
    assert sum(content(tmp_path / "of-stopped")["source"]["frames"].values()) == 4
    assert ispom("passport", "--verify", tmp_path / "of-stopped") == 0


def test_a_calibration_elsewhere_is_asked_for(tmp_path: Path) -> None:
    images, camera = make_images(tmp_path / "data", FRAMES), tmp_path / "lens" / "mine.yaml"
    camera.parent.mkdir()
    (images / "camera.yaml").rename(camera)
    made = tmp_path / "passport"
    out = run(images, tmp_path / "run", "--camera", camera, "--methods", "monocular")
    assert ispom("passport", out, "--to", made) == 0
    assert content(made)["options"]["camera"] == "mine.yaml"
    assert ("camera", "mine.yaml") in {(each["place"], each["name"]) for each in content(made)["source"]["files"]}
    assert ispom("passport", "--verify", made, "--source", images) == 2
    assert ispom("passport", "--verify", made, "--source", images, "--camera", camera) == 0
    camera.write_text(camera.read_text() + "# other\n")
    assert ispom("passport", "--verify", made, "--source", images, "--camera", camera) == 2
    camera.rename(images / "mine.yaml")
    assert ispom("passport", out, "--to", tmp_path / "b", "--source", images) == 2, "its calibration is gone"


def test_other_sensors_elsewhere_are_files_of_the_run(drive: Path, tmp_path: Path) -> None:
    place, made = tmp_path / "gnss", tmp_path / "passport"
    place.mkdir()
    (place / "fixes.csv").write_text("time_s,x,y,z\n" + "".join(f"{i / 10},0,0,{i}\n" for i in range(FRAMES)))
    mount = "rig_from_gnss: {translation_m: [0, 0, 0], rotation_xyzw: [0, 0, 0, 1]}"
    (place / "sensors.yaml").write_text(f"gnss: {{file: fixes.csv, sigma_m: 1, {mount}}}\n")
    out = run(drive, tmp_path / "run", "--sensors", place / "sensors.yaml")
    assert ispom("passport", out, "--to", made) == 0
    files = {(each["place"], each["name"]) for each in content(made)["source"]["files"]}
    assert {("sensors", "sensors.yaml"), ("sensors", "fixes.csv")} <= files
    assert ispom("passport", "--verify", made, "--source", drive) == 2
    assert ispom("passport", "--verify", made, "--source", drive, "--sensors", place / "sensors.yaml") == 0
    (place / "fixes.csv").write_text((place / "fixes.csv").read_text().replace("0.1,0", "0.1,5"))
    assert ispom("passport", "--verify", made, "--source", drive, "--sensors", place / "sensors.yaml") == 2


def test_a_simulation_needs_no_source(tmp_path: Path) -> None:
    out = run("sim:tiny", tmp_path / "run", "--max-exposures", 4)
    assert ispom("passport", out, "--to", tmp_path / "passport") == 0
    (tmp_path / "passport" / MARKER).unlink()
    assert content(tmp_path / "passport")["source"]["files"] == []
    assert ispom("passport", "--verify", tmp_path / "passport") == 0


def test_real_methods_give_the_same_bytes(tmp_path: Path) -> None:
    words = ("--max-exposures", 12, "--methods", "monocular.paper")
    assert main(["run", "sim:tiny", "--no-recording", "--out", str(tmp_path / "run"), *map(str, words)]) == 0
    assert main(["passport", str(tmp_path / "run"), "--to", str(tmp_path / "passport")]) == 0
    assert main(["passport", "--verify", str(tmp_path / "passport")]) == 0


def test_what_cannot_be_repeated_is_refused(made: Path, drive: Path, tmp_path: Path) -> None:
    (tmp_path / "killed").mkdir()
    (tmp_path / "page.rrd").write_bytes(b"RRF2")
    gone = run(drive, tmp_path / "gone")
    shutil.copytree(gone, tmp_path / "other")
    run_file = yaml.safe_load((tmp_path / "other" / "run.yaml").read_text())
    run_file["images_sha256"] = "0" * 64
    (tmp_path / "other" / "run.yaml").write_text(yaml.safe_dump(run_file))
    killed = killed_run(tmp_path / "killed", recording=False)
    for words in (
        (killed,),
        (tmp_path / "page.rrd",),
        (tmp_path / "nowhere",),
        (tmp_path / "other", "--source", drive),  # on other images
        (made,),
        (gone, "--camera", drive / "calib.txt"),
    ):
        assert ispom("passport", *words, "--to", tmp_path / "to") == 2, words
        assert not (tmp_path / "to").exists()
    assert ispom("repair", killed) == 0
    assert ispom("passport", killed, "--to", tmp_path / "to") == 2, "as far as it came, it had no digest of its images"
    for words in ((tmp_path / "nowhere",), (gone,), (made, "--sensors", drive / "calib.txt")):
        assert ispom("passport", "--verify", *words) == 2, words


def test_nothing_but_a_passport_is_written_over(made: Path, drive: Path, tmp_path: Path) -> None:
    full, gone = tmp_path / "full", tmp_path / "run"
    full.mkdir()
    (full / "stereo.tum").write_text("mine")
    (tmp_path / "link").symlink_to(full)
    for to in (full, tmp_path / "link", gone, full / "stereo.tum"):
        assert ispom("passport", gone, "--to", to) == 2, to
    assert [p.name for p in full.iterdir()] == ["stereo.tum"] and (full / "stereo.tum").read_text() == "mine"
    (made / "monocular.tum").unlink()
    (made / "monocular.tum").symlink_to(full / "stereo.tum")
    (made / README).unlink()
    (made / README).symlink_to(full / "stereo.tum")
    assert ispom("passport", run(drive, tmp_path / "one", "--methods", "stereo"), "--to", made) == 0
    assert (full / "stereo.tum").read_text() == "mine" and not (made / "monocular.tum").is_symlink()
    assert {p.name for p in made.iterdir()} == {PASSPORT, README, CITATION, MARKER, "stereo.tum"}


def test_a_strangers_passport_opens_nothing_but_the_named_source(made: Path, drive: Path, tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.mkdir()
    (secret / "key.yaml").write_text("width: 3")
    (secret / "key.png").write_bytes((drive / "image_0" / "000000.png").read_bytes())
    (secret / "stereo.tum").write_text("0 0 0 0 0 0 0 1\n")
    whole = content(made)
    entry = whole["source"]["files"][0]
    named = [{**entry, "name": name} for name in (str(secret / "key.png"), "../../../secret/key.png")]
    wrong: list[Callable[[dict[str, Any]], object]] = [
        lambda v: v["source"].update(files=named),
        lambda v: v["source"].update(address=str(secret)),
        lambda v: v["source"].update(address=f"sim:tiny?mesh={secret}/key.png"),
        lambda v: v["options"].update(camera="../../../secret/key.yaml"),
        lambda v: v["options"].update(camera=str(secret / "key.yaml")),
        lambda v: v["options"].update(sensors=str(secret / "key.yaml")),
        lambda v: v["outputs"][0].update(method=f"{secret}/stereo"),
    ]
    for change in wrong:
        for words in ((), ("--source", drive)):
            (made / PASSPORT).write_text(json.dumps(whole))
            changed(made, change)
            with noted() as read:
                ispom("passport", "--verify", made, *words)
            assert not [path for path in read if secret in path.resolve().parents], (change, words)
    (made / PASSPORT).write_text(json.dumps(whole))
    (made / "stereo.tum").unlink()
    (made / "stereo.tum").symlink_to(secret / "stereo.tum")
    assert ispom("passport", "--verify", made, "--source", drive, builder=shifted) in (1, 2)


PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=9) | st.just("../../etc/passwd"),
    lambda inner: st.lists(inner, max_size=2) | st.dictionaries(st.text(max_size=5), inner, max_size=2),
    max_leaves=4,
)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_mutated_value_is_one_sentence_or_an_answer(
    made: Path, drive: Path, data: st.DataObject, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whatever stands in the place of whichever value."""
    original = made.parent / "original.json"
    if not original.exists():
        original.write_bytes((made / PASSPORT).read_bytes())
    values = json.loads(original.read_text())
    place: Any = values
    key: Any = data.draw(st.sampled_from(sorted(place)))
    while isinstance(place[key], dict | list) and place[key] and data.draw(st.integers(0, 5)):
        place = place[key]
        key = data.draw(st.sampled_from(sorted(place) if isinstance(place, dict) else range(len(place))))
    place[key] = data.draw(PLAIN)
    (made / PASSPORT).write_text(json.dumps(values))
    require_an_answer(made, drive, capsys)


@pytest.mark.parametrize("number", range(20))
def test_a_mutated_file_is_one_sentence_or_an_answer(
    made: Path, drive: Path, number: int, capsys: pytest.CaptureFixture[str]
) -> None:
    random = Random(number)
    mutate(random.choice([made / PASSPORT, made / PASSPORT, made / "stereo.tum", made / MARKER]), random)
    require_an_answer(made, drive, capsys)


@pytest.mark.parametrize("number", [*range(20), 159])
def test_of_a_mutated_run_there_is_a_passport_or_one_sentence(
    drive: Path, tmp_path: Path, number: int, capsys: pytest.CaptureFixture[str]
) -> None:
    random, out = Random(number), run(drive, tmp_path / "run")
    files = ["run.yaml", "run.yaml", "run.yaml", "metrics.json", "steps.csv", "stereo.tum", "decisions.csv", "rig.yaml"]
    mutate(out / random.choice(files), random)
    capsys.readouterr()
    code = ispom("passport", out, "--source", drive, "--to", tmp_path / "to")
    said = capsys.readouterr()
    assert code == 0 or (code == 2 and said.err.startswith("ispom: ") and said.err.count("\n") == 1), said.err
    if code == 0:
        require_an_answer(tmp_path / "to", drive, capsys)


def require_an_answer(made: Path, drive: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    code = ispom("passport", "--verify", made, "--source", drive, builder=shifted)
    said = capsys.readouterr()
    assert code in (0, 1, 2, 3)
    if code == 2:
        assert said.err.startswith("ispom: ") and said.err.count("\n") == 1, said.err
    else:
        assert said.out.startswith(("same bytes", "not the same bytes", "cannot tell"))


def test_the_spread_is_exact_and_of_common_poses() -> None:
    times = np.arange(5, dtype=np.int64) * 10**9
    path = Trajectory.of([(t, doubles.pose_at(t)) for t in times.tolist()])
    assert spread(path, path) == spread(path, path) and spread(path, path).position == (0.0, 0.0)
    moved = replace(
        path, translations=path.translations + np.array([[0.0, 0, 0], [3, 4, 0], [0, 1, 0], [0, 0, 2], [0, 0, 0]])
    )
    turn = Pose.from_rotvec(np.array([0.0, np.radians(1e-6), 0.0]), np.zeros(3)).rotation
    moved = replace(moved, rotations=moved.rotations @ turn)
    found = spread(path, moved.select(slice(1, None)))
    assert (found.common, found.others) == (4, 1)
    assert found.position == pytest.approx((5.0, 1.5)) and found.rotation_deg == pytest.approx((1e-6, 1e-6), rel=1e-3)
    noise = np.random.default_rng(0).normal(0, 0.01, (5, 3))
    noisy = replace(path, translations=path.translations + noise)
    away = np.linalg.norm(noise, axis=1)
    assert spread(path, noisy).position == pytest.approx((away.max(), np.median(away)))
    assert spread(path, path.select(slice(0, 0))).common == 0
