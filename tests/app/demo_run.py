"""Makes the run whose beginning `ispom demo` shows at once: `python -m tests.app.demo_run`. It takes some minutes.

It is to be made again where the methods compute something else by now: tests/app/session/test_beginning.py says so.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
import pyarrow as pa
from ispom_app.engine.run_folder.run_folder import DECISIONS, RECORDING, RIG, RUN, STEPS, TRUTH
from ispom_app.engine.run_folder.run_folder import trajectory_file as trajectory
from ispom_app.features.page.command import DEMO, RECORDED
from ispom_app.views.rerun.parts import is_part
from ispom_app.views.rerun.streams import APPLICATION
from rerun.chunk import Chunk, OptimizationProfile, RrdReader

FRAMES = 211
"""Seven seconds."""
QUALITY = 35
"""Of its images, as WebP: a simulated image has noise, which takes most of a better one."""
IMAGE, TRAIL = "EncodedImage", "LineStrips2D"
LEFT_OUT = ("coloured", "plots", "log", "decisions", "final")
"""Names in the paths of what the page draws by itself, or only if asked to."""


def make(folder: Path, frames: int = FRAMES) -> None:
    """Runs the default methods over the first frames of the demo, and keeps what the page needs of them."""
    with TemporaryDirectory() as place:
        run = Path(place) / "demo"
        command = [sys.executable, "-m", "ispom_app", "run", DEMO, "--max-exposures", str(frames), "--out", str(run)]
        subprocess.run(command, check=True)
        pack(run, folder)


def pack(run: Path, folder: Path) -> None:
    """Copies a run's numbers, and its recording without what is drawn rarely, with smaller images."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    methods = [path.stem for path in run.glob("*.tum") if path.name != TRUTH]
    for name in (RUN, RIG, TRUTH, STEPS, DECISIONS, *map(trajectory, methods)):
        shutil.copy(run / name, folder / name)
    # Whoever gets it did not write it: see app/engine/run_folder/own.py.
    text = (folder / RUN).read_text()
    (folder / RUN).write_text(text[: text.rfind("# Written on this machine")])
    reader = RrdReader(run / RECORDING)
    (store,) = [each for each in reader.recordings() if each.application_id == APPLICATION]
    found = reader.store().stream().flat_map(packed).collect(optimize=OptimizationProfile.OBJECT_STORE)
    found.write_rrd(folder / RECORDING, application_id=APPLICATION, recording_id=store.recording_id)


def packed(chunk: Chunk) -> list[Chunk]:
    """What is kept of a chunk."""
    path = chunk.entity_path
    if not chunk.is_static and (not is_part(path) or set(LEFT_OUT) & set(path.split("/"))):
        return []
    batch = chunk.to_record_batch()
    columns = {name: batch.column(name) for name in batch.schema.names}
    if f"{IMAGE}:blob" in columns:
        columns |= _smaller_images(columns)
    if path.endswith("/trails"):
        columns |= _newest_parts(columns)
    return list(Chunk.from_record_batch(pa.record_batch(list(columns.values()), batch.schema)))


def _smaller_images(columns: dict[str, pa.Array]) -> dict[str, pa.Array]:
    blob, kind = f"{IMAGE}:blob", f"{IMAGE}:media_type"
    images = [None if row is None else [_webp(image) for image in row] for row in columns[blob].to_pylist()]
    kinds = [None if row is None else ["image/webp"] for row in columns[kind].to_pylist()]
    return {blob: pa.array(images, columns[blob].type), kind: pa.array(kinds, columns[kind].type)}


def _webp(content: bytes) -> bytes:
    image = cv2.imdecode(np.asarray(content, np.uint8), cv2.IMREAD_UNCHANGED)
    return cv2.imencode(".webp", image, [cv2.IMWRITE_WEBP_QUALITY, QUALITY])[1].tobytes()


def _newest_parts(columns: dict[str, pa.Array]) -> dict[str, pa.Array]:
    """Of trails, whose older parts are fainter and thinner, those of the last frames."""
    names = [f"{TRAIL}:{name}" for name in ("strips", "colors", "radii")]
    rows = zip(*(columns[name].to_pylist() for name in names), strict=True)
    found = []
    for strips, colours, radii in rows:
        newest = [i for i, radius in enumerate(radii or ()) if radius == radii[0]]
        found.append([None if each is None else [each[i] for i in newest] for each in (strips, colours, radii)])
    return {name: pa.array([row[i] for row in found], columns[name].type) for i, name in enumerate(names)}


if __name__ == "__main__":
    make(RECORDED)
