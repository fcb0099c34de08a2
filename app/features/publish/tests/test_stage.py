"""The stage of a published page has what the recording shows of each frame, on one timeline."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from ispom_app.features.publish.images import BLOB, CHOICES, Images, estimated_bytes
from ispom_app.features.publish.stage import STEPS_PER_PX, UNSEEN, Stage, StageWriter, rounded
from ispom_app.views.rerun.parts import is_part
from ispom_app.views.rerun.rrd import HEADER, chunk_at, message_starts, messages, uncompressed
from rerun.chunk import RrdReader

from .read import chunks, pieces


@pytest.fixture(scope="module")
def recording(runs: tuple[Path, Path]) -> Path:
    return runs[0] / "run.rrd"


def rows(found: list) -> dict[tuple[str, int, str], object]:
    """By entity, frame and component: its value."""
    values = {}
    for chunk in found:
        batch = chunk.to_record_batch()
        if "exposure" in batch.schema.names:
            data = [f.name for f in batch.schema if (f.metadata or {}).get(b"rerun:kind") == b"data"]
            for row, frame in enumerate(batch.column("exposure").to_pylist()):
                values |= {(str(chunk.entity_path), frame, name): batch.column(name)[row].as_py() for name in data}
    return values


def drawn(recording: Path) -> dict[tuple[str, int, str], object]:
    found = rows(list(RrdReader(recording).stream().to_chunks()))
    return {k: v for k, v in found.items() if is_part(k[0]) and not UNSEEN.fullmatch(k[0]) and v is not None}


def test_every_value_of_the_recording_that_the_page_draws_is_there(recording: Path, tmp_path: Path) -> None:
    stage = StageWriter(recording).stage(Images())
    found = {key: value for key, value in rows(chunks(stage.content, tmp_path)).items() if value is not None}
    known = drawn(recording)
    assert found.keys() == known.keys()
    places = {key for key in found if not key[0].startswith("/world") and key[2].endswith(PLACES)}
    assert places and all(found[key] == known[key] for key in found.keys() - places)
    for key in places:
        assert flat(found[key]) == pytest.approx(flat(known[key]), abs=0.5 / STEPS_PER_PX, nan_ok=True)


PLACES = (":positions", ":strips")


def flat(value: object) -> list[float]:
    return [each for part in value for each in flat(part)] if isinstance(value, list) else [value]  # type: ignore[list-item]


def test_there_are_no_times_of_day(recording: Path, tmp_path: Path) -> None:
    stage = StageWriter(recording).stage(Images())
    timelines = {
        field.name
        for chunk in chunks(stage.content, tmp_path)
        for field in chunk.to_record_batch().schema
        if (field.metadata or {}).get(b"rerun:kind") == b"index"
    }
    assert timelines == {"exposure", "stage"}


def test_an_image_that_is_not_kept_is_empty_and_not_the_one_before(recording: Path, tmp_path: Path) -> None:
    found = rows(chunks(StageWriter(recording).stage(Images(every=2)).content, tmp_path))
    for camera in ("/left/image", "/right/image"):
        blobs = [value for (path, _, name), value in sorted(found.items()) if path == camera and name == BLOB]
        assert len(blobs) > 3 and all(bool(blob) == (i % 2 == 0) for i, blob in enumerate(blobs))


def test_of_the_images_that_fit_the_best_are_taken(recording: Path) -> None:
    writer = StageWriter(recording)
    sizes = [len(writer.stage(images).content) for images in (CHOICES[0], CHOICES[3], CHOICES[-1])]
    assert sizes == sorted(sizes, reverse=True)

    def said_of(stage: Stage) -> int:
        return 40 + 7 * len(str(stage.images))

    def fitting(most_bytes: float) -> Stage:
        found = writer.fitting(most_bytes, said_of)
        assert len(found.content) + said_of(found) <= most_bytes
        return found

    assert fitting(1.1 * sizes[0] + 1000).images == CHOICES[0]
    assert fitting(0.95 * sizes[0] + 1000).images != CHOICES[0]
    assert fitting(1.01 * sizes[-1] + 1000).images == CHOICES[-1]


def test_messages_without_their_compression_are_the_same(recording: Path, tmp_path: Path) -> None:
    plain = tmp_path / "plain.rrd"
    plain.write_bytes(HEADER + uncompressed(messages(recording.read_bytes())))
    with recording.open("rb") as a, plain.open("rb") as b:
        starts = [[at for at, kind in message_starts(file) if kind == 2] for file in (a, b)]
        assert len(starts[0]) == len(starts[1]) > 10
        for x, y in zip(*starts, strict=True):
            assert chunk_at(a, x).equals(chunk_at(b, y))


def test_places_are_rounded_in_any_slice_of_them() -> None:
    values = [[[[0.03, 1.0], [2.51, float("nan")]]], [], None, [[[5.0, 6.04]], []]]
    kind = pa.list_(pa.list_(pa.list_(pa.float32(), 2)))
    whole = rounded(pa.array(values, kind)).to_pylist()
    assert whole[1:] == [[], None, [[[5.0, 6.0625]], []]]
    assert whole[0][0][0] == [0.0, 1.0] and whole[0][0][1][0] == 2.5 and np.isnan(whole[0][0][1][1])
    assert rounded(pa.array(values, kind).slice(3, 1)).to_pylist() == whole[3:]


def test_each_piece_is_a_stream_of_its_own(recording: Path) -> None:
    stage = StageWriter(recording).stage(Images())
    found = list(pieces(stage.content))
    assert all(piece.startswith(HEADER) for piece in found) and len(found) == len(stage.frames) + 1


def test_the_size_of_images_is_estimated_from_them() -> None:
    noise = np.random.default_rng(1).integers(0, 256, 5000, np.uint8)
    schema = pa.schema([pa.field(BLOB, pa.list_(pa.list_(pa.uint8())))])
    columns = pa.record_batch([pa.array([[noise]], type=schema.field(0).type)], schema)
    entities = [("/left/image", columns)] * 4 + [("/right/image", columns)] * 4
    whole = estimated_bytes(entities, Images())
    assert whole == pytest.approx(8 * 5000, rel=0.01)
    assert estimated_bytes(entities, Images(right=False)) == pytest.approx(whole / 2, rel=0.01)
    assert estimated_bytes(entities, Images(every=2)) == pytest.approx(whole / 2, rel=0.01)
    assert estimated_bytes(entities, Images(every=0)) == 0
