"""A user's own recordings: their clocks, what goes with what, and every way to get the small files wrong."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ispom.errors import InputError, UnreadableImage
from ispom.geometry import Pose
from ispom.io.rig import rig_text
from ispom.sequences import open_sequence
from ispom.types import Camera, LensSigma, PairSigma, Rig, is_stereo, is_video
from tests.sequences import own_folders
from tests.sequences.folders import HEIGHT, WIDTH, images
from tests.sequences.own_folders import (
    CAMERA,
    make_described,
    make_images,
    make_video,
    pair_folder,
    write_images,
    write_uneven_video,
    write_video,
)


def test_images_are_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    folder = make_images(tmp_path, frames=12)
    (folder / "._3.png").write_bytes(b"left here by another system")
    sequence = open_sequence(str(folder))
    for i, image in enumerate(images(12, 0)):
        exposure = sequence[i]
        assert is_video(exposure) and np.array_equal(exposure.image, image)
    assert sequence.times_ns.tolist() == [i * 50_000_000 for i in range(12)]


def test_of_a_folder_around_a_recording_the_recording_is_named(tmp_path: Path) -> None:
    inner = make_images(tmp_path / "walk")
    (inner.parent / "camera.yaml").write_text(CAMERA)
    with pytest.raises(InputError, match=re.escape(str(inner))):
        open_sequence(str(inner.parent))


@pytest.mark.parametrize("calibration", ["film.yaml", "camera.yaml", None])
def test_a_folder_of_one_video_is_opened_as_that_video(calibration: str | None, tmp_path: Path) -> None:
    film = make_video(tmp_path)
    film.with_suffix(".yaml").unlink()
    if calibration is not None:
        (tmp_path / calibration).write_text(CAMERA)
    for beside in ("rig.yaml", "notes.txt", "._film.avi"):
        (tmp_path / beside).touch()
    (tmp_path / "gone").symlink_to("/nowhere")
    given, meant = open_sequence(str(tmp_path)), open_sequence(str(film))
    assert (given.name, given.notes, given.guess) == (meant.name, meant.notes, meant.guess)
    assert given.rig.video == meant.rig.video and given.rig.video is not None
    assert given.times_ns.tolist() == meant.times_ns.tolist() and (given.guess is None) == (calibration is not None)
    seen, filmed = given[5], meant[5]
    assert is_video(seen) and is_video(filmed)
    np.testing.assert_array_equal(seen.image, filmed.image)


def test_a_folder_of_one_video_takes_the_calibration_that_is_named(tmp_path: Path) -> None:
    make_video(tmp_path / "walk")
    (tmp_path / "own.yaml").write_text(CAMERA.replace("fx: 80", "fx: 90"))
    camera = open_sequence(str(tmp_path / "walk"), camera=tmp_path / "own.yaml").rig.video
    assert camera is not None and camera.fx == 90


def bag_beside(root: Path) -> None:
    (root / "walk.bag").touch()


@pytest.mark.parametrize("beside", [make_images, lambda root: make_video(root, name="second.mkv"), bag_beside])
def test_of_a_folder_with_more_than_a_video_one_is_named(beside: Callable[[Path], object], tmp_path: Path) -> None:
    make_video(tmp_path)
    beside(tmp_path)
    with pytest.raises(InputError, match=re.escape(str(tmp_path / "film.avi"))):
        open_sequence(str(tmp_path))


def test_images_next_to_a_video_are_the_recording(tmp_path: Path) -> None:
    folder = make_images(tmp_path)
    make_video(folder)
    assert open_sequence(str(folder)).name == "images shots"
    inner = folder.rename(tmp_path / "images")
    assert open_sequence(str(inner)).name == f"images {tmp_path.name}"


def test_of_a_folder_with_colours_and_depths_the_colours_are_opened(tmp_path: Path) -> None:
    for name in ("depth", "rgb"):
        write_images(tmp_path / name, images(4, 0))
    opened = open_sequence(str(tmp_path / "rgb"))
    assert open_sequence(str(tmp_path)).times_ns.tolist() == opened.times_ns.tolist()
    assert any(str(tmp_path / "depth") in note for note in opened.notes)


@pytest.mark.parametrize("beside", [True, False])
def test_images_may_lie_in_a_folder_images(beside: bool, tmp_path: Path) -> None:
    folder = make_images(tmp_path / "walk", beside=beside)
    folder.rename(folder.with_name("images"))
    sequence = open_sequence(str(folder.parent))
    assert sequence.name == "images walk" and len(sequence) == 6 and sequence.times_ns[1] == 50_000_000


def test_a_file_of_times_counts_more_than_the_rate(tmp_path: Path) -> None:
    folder = make_images(tmp_path)
    (folder / "times.txt").write_text("1.5\n1.6\n1.75\n2\n3\n4.000000001\n")
    assert open_sequence(str(folder)).times_ns[[0, 2, 5]].tolist() == [1_500_000_000, 1_750_000_000, 4_000_000_001]


def test_times_that_are_hardly_seconds_are_reported(tmp_path: Path) -> None:
    folder = make_images(tmp_path)
    for interval, reported in ((33.3, True), (0.0333, False)):
        (folder / "times.txt").write_text("".join(f"{interval * i:.4f}\n" for i in range(6)))
        assert (
            any("33.3 s apart: are these times in seconds?" in n for n in open_sequence(str(folder)).notes) == reported
        )


def test_without_times_a_rate_is_assumed_and_reported(tmp_path: Path) -> None:
    folder = make_images(tmp_path)
    camera = folder / "camera.yaml"
    camera.write_text(camera.read_text().replace("rate_hz: 20\n", ""))
    sequence = open_sequence(str(folder))
    assert "30 images per second" in sequence.notes[0] and sequence.times_ns[3] == 100_000_000


@pytest.mark.parametrize("make", [make_images, make_video])
def test_entries_of_a_camera_that_are_not_known_are_reported(make: Callable[[Path], Path], tmp_path: Path) -> None:
    path = make(tmp_path)
    camera = path / "camera.yaml" if path.is_dir() else path.with_suffix(".yaml")
    assert not any("skipped" in note for note in open_sequence(str(path)).notes)
    camera.write_text(camera.read_text().replace("distortion", "distorsion") + "fps: 20\n")
    assert open_sequence(str(path)).notes[0].startswith(f"{camera}: distorsion, fps skipped")


@pytest.mark.parametrize(("name", "codec"), [("a.avi", "MJPG"), ("a.mp4", "mp4v"), ("a.mkv", "mp4v")])
def test_a_jump_in_a_video_gives_the_image_that_reading_on_gives(name: str, codec: str, tmp_path: Path) -> None:
    sequence = open_sequence(str(make_video(tmp_path, 90, name, codec)))
    in_order = [sequence[i] for i in range(len(sequence))]
    for i in np.random.default_rng(3).permutation(len(sequence))[:25].tolist():
        jumped, read = sequence[i], in_order[i]
        assert is_video(jumped) and is_video(read)
        np.testing.assert_array_equal(jumped.image, read.image)


@pytest.mark.parametrize("name", ["a.mkv", "a.mov"])
def test_a_video_of_a_variable_rate_keeps_each_images_own_time(name: str, tmp_path: Path) -> None:
    ticks = [*range(20), *range(28, 60), *range(61, 79, 2)]  # eight images missing, then half the rate
    stream = images(len(ticks), 0)
    path = write_uneven_video(tmp_path / name, stream, ticks)
    path.with_suffix(".yaml").write_text(CAMERA.replace("rate_hz: 20\n", ""))
    sequence = open_sequence(str(path))
    assert sequence.times_ns.tolist() == [50_000_000 * tick for tick in ticks]
    assert "a variable rate" in sequence.notes[0] and "50 to 450 ms" in sequence.notes[0]
    for i in (len(ticks) - 1, 3, 40, 21):
        exposure = sequence[i]
        assert is_video(exposure)
        seen = exposure.image.astype(int).mean(2)
        assert min(range(len(ticks)), key=lambda k: np.abs(seen - stream[k]).mean()) == i


def test_a_cut_video_gives_what_can_be_decoded(tmp_path: Path) -> None:
    path = make_video(tmp_path, 30)
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 6 // 10])
    sequence = open_sequence(str(path))
    assert 3 <= len(sequence) < 30 and "can be decoded" in sequence.notes[0]
    for i in range(len(sequence)):
        sequence[i]


def test_pairs_are_of_one_time_and_those_without_partner_are_reported(tmp_path: Path) -> None:
    root = make_described(tmp_path / "x", frames=12)
    (root / "right" / "5.png").unlink()
    sequence = open_sequence(str(root))
    assert sequence.kinds.count("stereo") == 5 and "1 of 6" in sequence.notes[0] and "0 of 5" in sequence.notes[0]
    assert sequence.times_ns[:4].tolist() == [0, 10_000_000, 50_000_000, 100_000_000]
    assert sequence.truth is not None and sequence.truth.frame == "rig"


def test_pairs_of_folders_without_times_are_those_of_one_number(tmp_path: Path) -> None:
    """An image that one camera lacks moved all later ones of it to the next image of the other."""
    folder = pair_folder(tmp_path / "flight", frames=8)
    (folder / "right" / "2.png").unlink()
    (folder / "left" / "5.png").unlink()
    sequence = open_sequence(str(folder))
    pairs = [e for i in range(len(sequence)) if is_stereo(e := sequence[i])]
    complete = open_sequence(str(pair_folder(tmp_path / "complete", frames=8)))
    pairs_by_time = {e.time_ns: e for i in range(len(complete)) if is_stereo(e := complete[i])}
    assert len(pairs) == 6 and any(note.count("1 of 7") == 2 for note in sequence.notes)
    for pair in pairs:
        np.testing.assert_array_equal(pair.left, pairs_by_time[pair.time_ns].left)
        np.testing.assert_array_equal(pair.right, pairs_by_time[pair.time_ns].right)


def test_pairs_of_folders_without_times_or_numbers_are_as_many_of_each(tmp_path: Path) -> None:
    folder = pair_folder(tmp_path / "flight")
    for i, path in enumerate(sorted((folder / "right").iterdir())):
        path.rename(path.with_name(f"{'abcdef'[i]}.png"))
    assert open_sequence(str(folder)).kinds.count("stereo") == 6
    (folder / "right" / "c.png").unlink()
    with pytest.raises(InputError, match="6 left and 5 right"):
        open_sequence(str(folder))


@pytest.mark.parametrize("video", [True, False])
def test_names_that_are_times_put_images_in_pairs(video: bool, tmp_path: Path) -> None:
    """Beside a film, whose times count from its first image, so do they."""
    folder = make_described(tmp_path / "flight", frames=12, video=video)
    text = "left: left\nright: right\n" + ("video: video.avi\n" if video else "")
    (folder / "sequence.yaml").write_text(text)
    since = 1_700_000_000_000_000_000
    for side, late in (("left", 0), ("right", 90_000)):
        for path in (folder / side).iterdir():
            path.rename(path.with_name(f"{since + int(path.stem) * 100_000_000 + late}.png"))
    (folder / "left" / f"{since + 200_000_000}.png").unlink()
    sequence = open_sequence(str(folder))
    times_ns = [int(t) for t, kind in zip(sequence.times_ns, sequence.kinds, strict=True) if kind == "stereo"]
    first = 0 if video else since
    assert [t - first for t in times_ns[:4]] == [0, 100_000_000, 300_000_000, 400_000_000]
    assert any("in the names" in note for note in sequence.notes)


def test_a_missing_number_is_a_gap_in_time(tmp_path: Path) -> None:
    folder = make_images(tmp_path, frames=8)
    (folder / "3.png").unlink()
    sequence = open_sequence(str(folder))
    assert (sequence.times_ns // 50_000_000).tolist() == [0, 1, 2, 4, 5, 6, 7]
    assert any("1 number is missing" in note for note in sequence.notes)


def test_names_without_numbers_are_reported(tmp_path: Path) -> None:
    folder = make_images(tmp_path)
    assert open_sequence(str(folder)).notes == ()
    for i in range(6):
        (folder / f"{i}.png").rename(folder / f"{'fdbace'[i]}.png")
    sequence = open_sequence(str(folder))
    assert any("alphabetical order" in note for note in sequence.notes)


def test_images_that_are_not_read_are_noted_and_their_numbers_are_gaps(tmp_path: Path) -> None:
    folder = make_images(tmp_path, frames=8)
    for i in (1, 2, 4, 6):
        (folder / f"{i}.png").rename(folder / f"{i}.HEIC")
    sequence = open_sequence(str(folder))
    assert (sequence.times_ns // 50_000_000).tolist() == [0, 3, 5, 7]
    assert any("4 images" in note and ".heic" in note for note in sequence.notes)


def test_raw_copies_of_images_are_no_gaps(tmp_path: Path) -> None:
    folder = make_images(tmp_path)
    for i in range(6):
        (folder / f"{i}.NEF").touch()
    sequence = open_sequence(str(folder))
    assert (np.diff(sequence.times_ns) == 50_000_000).all() and "6 copies" in sequence.notes[0]


def test_names_that_are_decimal_seconds_are_times(tmp_path: Path) -> None:
    folder = make_images(tmp_path, frames=12)
    camera = folder / "camera.yaml"
    camera.write_text(camera.read_text().replace("rate_hz: 20\n", ""))
    for i in range(12):
        (folder / f"{i}.png").rename(folder / f"frame_{i / 8}.png")
    sequence = open_sequence(str(folder))
    assert sequence.times_ns.tolist() == [i * 125_000_000 for i in range(12)]
    for i, image in enumerate(images(12, 0)):
        exposure = sequence[i]
        assert is_video(exposure)
        np.testing.assert_array_equal(exposure.image, image)


def test_a_counter_that_starts_again_is_no_gap(tmp_path: Path) -> None:
    folder = make_images(tmp_path, frames=8)
    for i in range(8):
        (folder / f"{i}.png").rename(folder / f"DSC_{(9995 + i) % 9999 + 1:04d}.png")
    sequence = open_sequence(str(folder))
    assert (np.diff(sequence.times_ns) == 50_000_000).all()
    assert any("starts again after 9999" in note for note in sequence.notes)
    exposure = sequence[5]
    assert is_video(exposure)
    np.testing.assert_array_equal(exposure.image, images(8, 0)[5])


def test_a_pair_of_which_one_camera_s_names_are_times_is_refused(tmp_path: Path) -> None:
    folder = pair_folder(tmp_path / "flight")
    for i in range(6):
        (folder / "right" / f"{i}.png").rename(folder / "right" / f"{i / 8}.png")
    with pytest.raises(InputError, match="one of left and right"):
        open_sequence(str(folder))


def test_one_image_of_another_size_is_left_out_of_a_run(tmp_path: Path) -> None:
    """Such as one photo among the frames: it ended the run, as if it were all of them."""
    folder = make_images(tmp_path)
    cv2.imwrite(str(folder / "3.png"), np.zeros((20, 30), np.uint8))
    sequence = open_sequence(str(folder))
    with pytest.raises(UnreadableImage, match="30 x 20, not 96 x 64"):
        sequence[3]


def test_photos_of_two_sizes_are_those_of_the_larger_group(tmp_path: Path) -> None:
    folder = make_images(tmp_path)
    (folder / "camera.yaml").unlink()
    size = (96, 64)
    for i in (0, 3):
        cv2.imwrite(str(folder / f"{i}.png"), np.zeros(size, np.uint8))
    sequence = open_sequence(str(folder))
    first, last = sequence[0], sequence[len(sequence) - 1]
    assert is_video(first) and is_video(last)
    assert first.image.shape == last.image.shape == size[::-1]
    assert len(sequence) == len(list(folder.glob("*.png"))) - 2
    assert len(set(np.diff(sequence.times_ns))) == 2  # the number that is skipped is a gap in time
    assert any("2 of 64 x 96" in note for note in sequence.notes)


def test_a_folder_of_two_cameras_is_distinguished_from_one(tmp_path: Path) -> None:
    folder = make_images(tmp_path)
    for path in sorted(folder.glob("*.png")):
        write = path.read_bytes()
        path.rename(path.with_name(f"left_{path.name}"))
        path.with_name(f"right_{path.name}").write_bytes(write)
    with pytest.raises(InputError, match=r"shots: .*left_0.png and right_0.png"):
        open_sequence(str(folder))


def test_a_raw_rig_is_rectified_and_keeps_its_place(tmp_path: Path) -> None:
    """A point in the rig is seen on one row of both cameras, at the disparity of the baseline."""
    rig = open_sequence(str(make_described(tmp_path / "x"))).rig
    point = np.array([[0.3, 0.2, 5.0]])
    left, right = (rig.camera(name).project(rig.rig_from(name).inverse().apply(point))[0] for name in ("left", "right"))
    assert rig.left == rig.right and not rig.camera("left").distortion
    depth = rig.rig_from_left.inverse().apply(point)[0, 2]
    np.testing.assert_allclose(left - right, [rig.camera("left").fx * rig.baseline_m / depth, 0], atol=1e-9)
    np.testing.assert_array_equal(rig.rig_from_video.matrix, own_folders.RIG.rig_from_video.matrix)


def test_without_a_video_the_left_images_are_the_video(tmp_path: Path) -> None:
    sequence = open_sequence(str(make_described(tmp_path / "x", video=False)), stereo_every=2)
    assert sequence.kinds[:4] == ("stereo", "video", "video", "stereo") and "Emulated" in sequence.notes[0]


def test_left_and_right_folders_with_a_rig_need_no_sequence_yaml(tmp_path: Path) -> None:
    folder = make_described(tmp_path / "flight", video=False)
    described = open_sequence(str(folder))
    (folder / "sequence.yaml").unlink()
    alone = open_sequence(str(folder))
    assert alone.kinds == described.kinds and alone.rig.has_stereo
    assert any("images per second" in note for note in alone.notes)
    (folder / "times.txt").write_text("".join(f"{i / 4}\n" for i in range(6)))
    assert open_sequence(str(folder)).times_ns[-1] == 1_250_000_000
    (folder / "rig.yaml").unlink()
    with pytest.raises(InputError, match="no rig"):
        open_sequence(str(folder))


@pytest.mark.parametrize(("halves", "axis"), [(("left", "right"), 1), (("top", "bottom"), 0)])
@pytest.mark.parametrize("film", [False, True])
def test_two_cameras_in_one_image_are_a_pair(halves: tuple[str, str], axis: int, film: bool, tmp_path: Path) -> None:
    left, right = images(6, 8), images(6, 0)
    both = [np.concatenate(pair, axis) for pair in zip(left, right, strict=True)]
    source = write_video(tmp_path / "both.avi", both) if film else write_images(tmp_path / "both", both)
    camera = Camera(WIDTH, HEIGHT, 80.0, 80.0, 47.5, 31.5)
    rig = Rig.of(left=camera, right=camera, rig_from_right=Pose(translation=np.array([0.3, 0.0, 0.0])))
    (tmp_path / "rig.yaml").write_text(rig_text(rig))
    described = "".join(
        f"{side}: {{source: {source.name}, half: {half}}}\n"
        for side, half in zip(("left", "right"), halves, strict=True)
    )
    (tmp_path / "sequence.yaml").write_text(described)
    opened = open_sequence(str(tmp_path), stereo_every=1)
    pairs = [frame for frame in (opened[i] for i in range(len(opened))) if is_stereo(frame)]
    assert len(pairs) == 6 and opened.rig.baseline_m == pytest.approx(0.3)
    for i, pair in enumerate(pairs):
        for image, expected in ((pair.left, left[i]), (pair.right, right[i])):
            grey = image[..., 0] if image.ndim == 3 else image
            assert np.abs(grey.astype(int) - expected).mean() < (4 if film else 1e-9)
    (tmp_path / "sequence.yaml").write_text(described.replace(f"half: {halves[1]}", "half: middle"))
    with pytest.raises(InputError, match=r"right\.half is middle"):
        open_sequence(str(tmp_path))


def test_the_examples_of_the_documentation_open(tmp_path: Path) -> None:
    start = Path(__file__).parents[3] / "docs" / "start"
    text = "".join((start / name).read_text(encoding="utf-8") for name in ("own_video.md", "own_rig.md"))
    found = dict(re.findall(r"```yaml\n# (\w+\.yaml): (.*?)```", text, re.DOTALL))
    assert found.keys() == {"camera.yaml", "sequence.yaml", "rig.yaml"}
    for name, text in found.items():
        (tmp_path / name).write_text(f"# {text}")
    blank = [np.zeros((480, 640), np.uint8)] * 4
    write_video(tmp_path / "video.mp4", blank, codec="mp4v")
    for side in ("left", "right"):
        write_images(tmp_path / side, [np.zeros((960, 1280), np.uint8)] * 2)
        (tmp_path / f"{side}.txt").write_text("0.0\n0.1\n")
    (tmp_path / "truth.tum").write_text("0 0 0 0 0 0 0 1\n0.1 1 0 0 0 0 0 1\n")
    sequence = open_sequence(str(tmp_path))
    assert sequence.name == "roof, second flight" and sequence.rig.baseline_m == pytest.approx(0.4)
    assert [sequence[i].time_ns for i in range(len(sequence))] == sequence.times_ns.tolist()
    shots = write_images(tmp_path / "shots", [np.zeros((480, 752), np.uint8)] * 3)
    (tmp_path / "camera.yaml").rename(shots / "camera.yaml")
    assert len(open_sequence(str(shots))) == 3


def written(root: Path, name: str, text: str) -> None:
    (root / name).write_bytes(text.encode("utf-8", "surrogatepass"))


ALPHABET = "01259.-+eE:[]{},'\"#&*!|>?@%\n\t naninf_~<=/\\é\x00\ud800"


@st.composite
def mutated(draw: st.DrawFn, text: str) -> str:
    """The text with a few pieces cut out, doubled, or replaced."""
    for _ in range(draw(st.integers(1, 3))):
        start = draw(st.integers(0, len(text)))
        end = min(len(text), start + draw(st.integers(0, 12)))
        text = text[:start] + draw(st.one_of(st.text(ALPHABET, max_size=8), st.just(text[start:end] * 2))) + text[end:]
    return text


def check_only_input_errors(path: Path) -> None:
    try:
        sequence = open_sequence(str(path))
        for i in (0, len(sequence) - 1):
            sequence[i]
    except InputError as error:
        assert str(error).count("\n") == 0 or "\n" in str(path)


STEADY = settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
FILES: dict[str, tuple[Callable[[Path], Path], str]] = {
    "camera": (make_images, "shots/camera.yaml"),
    "times": (lambda root: with_times(make_images(root)), "shots/times.txt"),
    "sequence": (make_described, "sequence.yaml"),
    "rig": (make_described, "rig.yaml"),
    "times of a stream": (make_described, "left.txt"),
    "truth": (make_described, "truth.tum"),
}


def with_times(folder: Path) -> Path:
    (folder / "times.txt").write_text("".join(f"{1.7e9 + i / 20:.6f}\n" for i in range(6)))
    return folder


@pytest.mark.parametrize("name", FILES)
def test_no_change_of_a_small_file_is_more_than_an_input_error(name: str, tmp_path: Path) -> None:
    make, file = FILES[name]
    path = make(tmp_path / "x")
    text = (tmp_path / "x" / file).read_text()

    @STEADY
    @given(st.data())
    def fuzz(data: st.DataObject) -> None:
        written(tmp_path / "x", file, data.draw(mutated(text)))
        check_only_input_errors(path)

    fuzz()


@pytest.mark.parametrize("without", ["nothing", "video", "left"])
def test_a_rig_stays_as_sure_as_its_file_says(without: str, tmp_path: Path) -> None:
    root = make_described(tmp_path / "roof", video=without != "video")
    described = (root / "sequence.yaml").read_text().splitlines()
    if without == "left":
        described = [line for line in described if not line.startswith(("left", "right"))]
    (root / "sequence.yaml").write_text("\n".join(described))
    sigmas = {"video_sigma": LensSigma(1e-3, 2e-3), "pair_sigma": PairSigma(0.1, 0.2, 0.03, 0.04, 0.05, 0.06)}
    with (root / "rig.yaml").open("a") as file:
        file.write(yaml.safe_dump({name: asdict(sigma) for name, sigma in sigmas.items()}))
    rig = open_sequence(str(root)).rig
    assert {name: getattr(rig, name) for name in sigmas} == sigmas


def test_a_laser_keeps_its_place_among_the_cameras(tmp_path: Path) -> None:
    """Also where the pair is rectified, and where the rig is made anew because no video is named."""
    seen = []
    for video in (True, False):
        root = make_described(tmp_path / str(video), video=video)
        pose = "{translation_m: [0.1, -0.2, 0.3], rotation_xyzw: [0, 0.6, 0, 0.8]}"
        with (root / "rig.yaml").open("a") as file:
            file.write(f"laser: {{rig_from_laser: {pose}}}\n")
        rig = open_sequence(str(root)).rig
        assert rig.rig_from_laser is not None
        seen.append((rig.rig_from_left.inverse() @ rig.rig_from_laser).matrix)
    np.testing.assert_allclose(seen[0], seen[1], atol=1e-9)
    given = own_folders.RIG.rig_from_left.translation - (0.1, -0.2, 0.3)
    assert np.linalg.norm(seen[0][:3, 3]) == pytest.approx(np.linalg.norm(given))


def test_a_folder_of_images_that_are_not_read_says_so(tmp_path: Path) -> None:
    for i in range(5):
        (tmp_path / f"IMG_{i}.HEIC").write_bytes(b"ftypheic")
    with pytest.raises(InputError, match=r"5 images .*\.heic"):
        open_sequence(str(tmp_path))
