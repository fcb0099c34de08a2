"""The audit in `ispom evaluate`: what it prints and writes, and that its options correct what it names."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ispom_app.cli.main import main
from ispom_app.features.evaluation.audit import odd_one, option_words
from ispom_app.features.evaluation.values import delta_of, spans_of

from ispom.errors import InputError
from ispom.evaluation.audit.correction import Correction, undone
from ispom.evaluation.audit.finding import Finding
from ispom.evaluation.comparison import Delta
from ispom.geometry import Pose
from ispom.io.trajectories import tum_text
from ispom.types import Trajectory
from tests.app.written import breaks_schema, kitti_text
from tests.evaluation.audit.made_paths import noisy, path

START_NS = 1_660_000_100 * 10**9
TRUTH = replace(path(), times_ns=path().times_ns + START_NS)
ESTIMATE = noisy(TRUTH)
OPENGL = Pose(np.diag([1.0, -1, -1]), np.zeros(3))


def evaluated(folder: Path, estimate: Trajectory, *options: str, truth: Trajectory = TRUTH) -> dict:
    """What the JSON says about one estimate."""
    (folder / "truth.tum").write_text(tum_text(truth))
    (folder / "estimate.tum").write_text(tum_text(estimate))
    out = folder / "out.json"
    arguments = [str(folder / "truth.tum"), str(folder / "estimate.tum"), *options, "--json", str(out)]
    assert main(["evaluate", *arguments]) == 0
    assert not breaks_schema("evaluate", out.read_text())
    (found,) = json.loads(out.read_text())["estimates"]
    return found


PLANTED = {
    "offset": replace(ESTIMATE, times_ns=ESTIMATE.times_ns + 250_000_000),
    "inverse": undone(ESTIMATE, ("inverse",)),
    "w-first": undone(ESTIMATE, ("w-last",)),
    "mirrored": undone(ESTIMATE, ("mirrored-z",)),
    "axes": ESTIMATE.moved(right=OPENGL),
    "lever_arm": ESTIMATE.moved(right=Pose(np.eye(3), np.array([0.3, 0.1, 0]))),
    "scale": replace(ESTIMATE, translations=0.2 * ESTIMATE.translations),
}


@pytest.mark.parametrize("key", PLANTED)
def test_the_option_of_a_finding_gives_the_errors_that_it_states(key: str, tmp_path: Path) -> None:
    wrong = evaluated(tmp_path, PLANTED[key])
    (finding,) = wrong["audit"]
    assert finding["key"] == key and wrong["ate_rmse_m"] == pytest.approx(finding["before"]["ate_m"])
    right = evaluated(tmp_path, PLANTED[key], *finding["option"].split())
    assert right["ate_rmse_m"] == pytest.approx(finding["after"]["ate_m"], rel=1e-2)
    assert right["ate_rmse_deg"] == pytest.approx(finding["after"]["ate_deg"], rel=1e-2)
    assert right["audit"] == []


def test_nothing_is_corrected_unasked_and_nothing_audited_without_audit(tmp_path: Path, capsys) -> None:
    audited = evaluated(tmp_path, PLANTED["offset"])
    assert "--offset -0.25" in capsys.readouterr().out
    plain = evaluated(tmp_path, PLANTED["offset"], "--no-audit")
    assert plain.pop("audit") is None and audited.pop("audit") and plain == audited
    assert "audit" not in capsys.readouterr().out


def test_without_common_times_the_refusal_has_the_offset(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "truth.tum").write_text(tum_text(TRUTH))
    (tmp_path / "later.tum").write_text(tum_text(replace(ESTIMATE, times_ns=ESTIMATE.times_ns + 3600 * 10**9)))
    assert main(["evaluate", str(tmp_path / "truth.tum"), str(tmp_path / "later.tum")]) == 2
    printed = capsys.readouterr().err
    assert "--offset -3600" in printed and printed.count("\n") == 1


def test_rows_of_files_of_different_length_are_shifted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "truth.txt").write_text(kitti_text(TRUTH))
    (tmp_path / "late.txt").write_text(kitti_text(ESTIMATE.select(slice(20, None))))
    arguments = ["evaluate", str(tmp_path / "truth.txt"), str(tmp_path / "late.txt")]
    assert main(arguments) == 2
    assert "--offset 20" in capsys.readouterr().err
    assert main([*arguments, "--offset", "20", "--json", str(tmp_path / "a.json")]) == 0
    (found,) = json.loads((tmp_path / "a.json").read_text())["estimates"]
    assert found["poses_given"] == 580 and found["audit"] == []


def test_stretches_are_excluded(tmp_path: Path) -> None:
    held = np.arange(len(TRUTH))
    held[200:260] = 199
    frozen = replace(TRUTH, rotations=TRUTH.rotations[held], translations=TRUTH.translations[held])
    (finding,) = evaluated(tmp_path, ESTIMATE, truth=frozen)["audit"]
    assert finding["key"] == "frozen" and finding["poses"] == [[200, 260]]
    right = evaluated(tmp_path, ESTIMATE, *finding["option"].split(), truth=frozen)
    assert right["ate_rmse_m"] == pytest.approx(finding["after"]["ate_m"]) and right["audit"] == []


def test_the_odd_one_of_three_is_found_from_pairs(tmp_path: Path) -> None:
    texts = {"truth.tum": PLANTED["offset"], "a.tum": ESTIMATE, "b.tum": noisy(TRUTH, 3)}
    for name, trajectory in texts.items():
        (tmp_path / name).write_text(tum_text(trajectory))
    out = tmp_path / "out.json"
    assert main(["evaluate", *(str(tmp_path / name) for name in texts), "--json", str(out)]) == 0
    last = json.loads(out.read_text())["notes"][-1]
    assert "truth.tum is the odd one" in last


def test_which_one_is_odd_needs_pairs_that_agree() -> None:
    wrong = (Finding("offset"),)
    assert "b is the odd" in odd_one("abc", {(0, 1): wrong, (0, 2): (), (1, 2): wrong})
    assert "cannot tell" in odd_one("abc", {(0, 1): wrong, (0, 2): wrong, (1, 2): wrong})
    assert odd_one("abc", {(0, 1): (), (0, 2): wrong, (1, 2): ()}) == ""


def test_positions_only_and_the_first_poses_of_an_alignment(tmp_path: Path) -> None:
    whole = evaluated(tmp_path, ESTIMATE)
    bare = evaluated(tmp_path, ESTIMATE, "--positions-only")
    assert bare["ate_rmse_m"] == whole["ate_rmse_m"] and bare["ate_rmse_deg"] is None and bare["rpe_rmse_m"] is None
    assert evaluated(tmp_path, ESTIMATE, "--align-first", "100")["ate_rmse_m"] > whole["ate_rmse_m"]
    assert evaluated(tmp_path, ESTIMATE, "--align-first", "600")["ate_rmse_m"] == whole["ate_rmse_m"]


def test_relative_errors_over_time_and_length_need_no_common_rate(tmp_path: Path) -> None:
    """A keyframe trajectory has other motions from pose to pose, and the same over a second."""
    keyframes = ESTIMATE.select(slice(None, None, 5))
    (tmp_path / "truth.tum").write_text(tum_text(TRUTH))
    (tmp_path / "full.tum").write_text(tum_text(ESTIMATE))
    (tmp_path / "keyframes.tum").write_text(tum_text(keyframes))
    files = [str(tmp_path / name) for name in ("truth.tum", "full.tum", "keyframes.tum")]
    found = {}
    for delta in ("1", "1s", "2m"):
        out = tmp_path / f"{delta}.json"
        assert main(["evaluate", *files, "--delta", delta, "--json", str(out)]) == 0
        found[delta] = json.loads(out.read_text())["estimates"]
    assert found["1"][1]["rpe_interval_s"] == pytest.approx(5 * found["1"][0]["rpe_interval_s"])
    for delta in ("1s", "2m"):
        full, few = found[delta]
        assert few["rpe_rmse_m"] == pytest.approx(full["rpe_rmse_m"], rel=0.25)
    assert [each["rpe_interval_s"] for each in found["1s"]] == pytest.approx([1.0, 1.0])


def test_a_keyframe_trajectory_has_its_own_rows_of_relative_errors(tmp_path: Path, capsys) -> None:
    (tmp_path / "truth.tum").write_text(tum_text(TRUTH))
    (tmp_path / "full.tum").write_text(tum_text(ESTIMATE))
    (tmp_path / "few.tum").write_text(tum_text(ESTIMATE.select(slice(None, None, 5))))
    files = [str(tmp_path / name) for name in ("truth.tum", "full.tum", "few.tum")]
    assert main(["evaluate", *files]) == 0
    printed = capsys.readouterr().out
    rows = [line for line in printed.splitlines() if "RPE over" in line]
    assert len(rows) == 2 and all(row.split("│")[2:4].count(" " * len(row.split("│")[2])) == 0 for row in rows)
    assert [sum(cell.strip() == "-" for cell in row.split("│")) for row in rows] == [1, 1]
    assert main(["evaluate", *files, "--delta", "1s"]) == 0
    assert "RPE over" not in capsys.readouterr().out


def test_values_of_options() -> None:
    assert (delta_of("10"), delta_of("1m"), delta_of("0.5s")) == (Delta(10), Delta(1.0, "m"), Delta(0.5, "s"))
    assert spans_of(("1:2", ":3", "4:")) == ((1.0, 2.0), (-np.inf, 3.0), (4.0, np.inf))
    for text in ("0", "-1", "1.5", "1km", "nan", ""):
        with pytest.raises(InputError):
            delta_of(text)
    for text in ("1", "2:1", "a:b", "1:2:3", "nan:1"):
        with pytest.raises(InputError):
            spans_of((text,))
    words = option_words(Correction(offset_s=-0.25, clock_rate=1.00002, with_scale=True), "none")
    assert words == "--offset -0.25 --clock-rate 1.00002 --alignment scale"


@pytest.mark.parametrize(
    "words",
    [
        ("--offset", "nan"),
        ("--clock-rate", "0"),
        ("--align-first", "0"),
        ("--exclude", "2:1"),
        ("--exclude", ":"),
        ("--delta", "1 km"),
    ],
)
def test_a_wrong_value_is_one_sentence(words: tuple[str, ...], tmp_path: Path, capsys) -> None:
    (tmp_path / "a.tum").write_text(tum_text(TRUTH))
    assert main(["evaluate", *[str(tmp_path / "a.tum")] * 2, *words]) == 2
    printed = capsys.readouterr().err
    assert printed.startswith("ispom: ") and printed.count("\n") == 1
