"""The rows of the runs table, as values."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from ispom_app.engine.verdict import Severity
from ispom_app.features.runs import table
from ispom_app.features.runs.table import Ate, Row, arranged, table_message

from ispom.methods import Config, method

OLD = Row("old", "run", "kitti/06", "old", when_s=1.0)
NEW = Row("new", "run", "kitti/06", "new", when_s=2.0)


def order(*rows: Row) -> list[tuple[str, int]]:
    return [(row.key, depth) for row, depth in arranged(rows)]


def test_the_newest_run_is_first_and_forks_follow_their_origin() -> None:
    fork = Row("fork", "run", "kitti/06", "fork", parent="old", when_s=3.0)
    live = Row("live:0", "live", "kitti/06", "first run")
    assert order(OLD, NEW, fork, live) == [("live:0", 0), ("new", 0), ("old", 0), ("fork", 1)]


def test_a_missing_origin_or_a_circle_of_origins_loses_no_row() -> None:
    orphan = Row("orphan", "run", "", "orphan", parent="gone", when_s=9.0)
    circle = [replace(OLD, parent="new"), replace(NEW, parent="old")]
    found = order(orphan, *circle)
    assert sorted(found) == [("new", 0), ("old", 0), ("orphan", 0)]


def test_settings_that_differ_from_the_defaults_are_listed_and_others_are_not() -> None:
    usual = method("stereo.paper").config()
    changed = replace(usual, max_tracks=7)  # type: ignore[type-var]
    options = {"seed": 3, "stereo_every": 1, "unknown": "<b>", "methods": ["stereo.paper"]}
    found = table.differing_settings(("stereo.paper",), Config({"stereo.paper": changed}), options)
    assert len(found) == 2 and "max-tracks" in found[0] and found[0].endswith("→ 7") and found[1] == "seed 3"
    assert table.differing_settings(("stereo.paper",), Config({"stereo.paper": usual}), {}) == ()


def test_errors_of_variants_share_a_column_that_names_its_only_alignment() -> None:
    errors = (Ate("monocular", 0.016, "sim3"), Ate("monocular.paper", 0.041, "sim3"), Ate("stereo", 0.02, "se3"))
    message = table_message([replace(OLD, errors=errors), replace(NEW, errors=(Ate("stereo", 1.5, "sim3"),))])
    assert [c["family"] for c in message["columns"]] == ["monocular", "stereo"]
    assert [c["alignment"] for c in message["columns"]] == ["Sim(3)", ""]
    new, old = message["rows"]
    assert [cell["variant"] for cell in old["ate"][0]] == ["", "2013"]
    assert new["ate"] == [[], [{"variant": "", "text": "1.50 m", "alignment": "Sim(3)", "best": False}]]


def test_the_located_frames_are_those_of_each_method_and_never_the_worst_ones() -> None:
    row = replace(NEW, located={"monocular": 48 / 51, "stereo": 1.0})
    entry = table_message([row])["rows"][0]
    assert entry["located"] == [["Monocular", round(48 / 51, 4)], ["Stereo", 1.0]]
    assert table_message([replace(NEW, located=None)])["rows"][0]["located"] == []


def test_the_share_is_of_the_frames_of_the_method_as_metrics_json_counts_them() -> None:
    report = {"methods": {"stereo": {"located": 8, "frames": 10}, "monocular": {"located": 3, "frames": 0}}}
    assert table.located(report, {"video": 12, "stereo": 12}) == {"stereo": 0.8, "monocular": 0.25}


def test_a_sweep_has_the_span_of_its_errors_and_its_worst_share() -> None:
    members = [
        replace(OLD, errors=(Ate("stereo", 0.01, "se3"),), located={"stereo": 0.5}, events={Severity.LOST: 1}),
        replace(NEW, errors=(Ate("stereo", 0.03, "se3"),), located={"stereo": 1.0}, events={Severity.WARNING: 2}),
    ]
    row = table.group("sweep-1", "sweep", "Sweep", members, 2.0)
    entry = table_message([row])["rows"][0]
    assert entry["located"] == [["Stereo", 0.5]] and entry["events"] == 3 and entry["worst"] == "lost"
    assert entry["ate"][0][0]["text"] == "10.0 – 30.0 mm" and entry["note"] is None


def test_what_a_strangers_metrics_say_is_taken_only_where_it_is_a_number() -> None:
    report = {
        "methods": {
            "stereo": {"ate_m": "12", "aligned": "se3", "located": 5},
            "monocular": {"ate_m": 0.5, "aligned": "sim3", "located": "all"},
            "<script>": {"ate_m": 1.0, "aligned": "se3", "located": 1},
            "integrated": [],
        }
    }
    assert table.ates(report) == (Ate("monocular", 0.5, "sim3"),)
    assert table.located(report, {"video": 10, "stereo": 10}) == {"stereo": 0.5}
    assert table.ates({"methods": []}) == () and table.located({}, {}) == {}


def test_the_best_of_the_errors_that_can_be_compared_is_marked() -> None:
    def errors(metres: float, alignment: str = "se3") -> tuple[Ate, ...]:
        return (Ate("stereo", metres, alignment),)

    rows = [
        replace(OLD, errors=errors(0.02)),
        replace(NEW, errors=errors(0.01)),
        Row("other", "run", "kitti/00", "other", errors=errors(0.001), when_s=3.0),
        Row("scaled", "run", "kitti/06", "scaled", errors=errors(0.001, "sim3"), when_s=4.0),
    ]
    found = {entry["key"]: entry["ate"][0][0]["best"] for entry in table_message(rows)["rows"]}
    assert found == {"old": False, "new": True, "other": False, "scaled": False}


def test_a_small_curve_has_the_largest_errors_of_its_parts() -> None:
    metres = np.zeros(1000)
    metres[357] = 2.0
    found = table.small_curve(metres)
    assert len(found) <= table.CURVE_POINTS and max(found) == 2.0 and table.small_curve(metres[:0]) == ()


def test_rows_beyond_the_limit_are_counted(monkeypatch) -> None:
    monkeypatch.setattr(table, "MOST", 1)
    message = table_message([OLD, NEW])
    assert [row["key"] for row in message["rows"]] == ["new"] and message["omitted"] == 1


def test_an_origin_is_known_by_the_name_of_its_folder() -> None:
    assert table.forked_parent("/somewhere/else/base", ("a/base", "b")) == "a/base"
    assert table.forked_parent("/somewhere/else/base", ("b",)) == "" and table.forked_parent("", ("a",)) == ""
