"""What happens to one file of an input. Every mutation follows from the random numbers it is given alone."""

from __future__ import annotations

import os
import socket
import struct
import zlib
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from random import Random

import numpy as np

TEXTS = {".txt", ".csv", ".yaml", ".tum", ".kitti", ".json", ".log", ".md", ".obj", ".mtl"}
WORDS = [
    "",
    "nan",
    "inf",
    "-1",
    "0",
    "1e400",
    "-1e300",
    "1e12",
    "30000",
    "4294967296",
    "9" * 30,
    "9" * 5000,
    "0x1F",
    "1_0",
]
WORDS += [
    "a: [",
    "- x",
    ":",
    ",",
    "#",
    "\r",
    "\0",
    "\x85",
    "\u2028",
    "\t",
    "é",
    "²",
    "[",
    "{",
    "*a",
    "&a [*a]",
    "!!int ''",
]
WORDS += [
    "~nobody",
    "/dev/zero",
    "../../../etc/passwd",
    "x" * 300,
    "\x1b[31m",
    "<iframe srcdoc=x>",
    "true",
    "null",
    "[]",
    "{}",
]


def mutate(path: Path, random: Random) -> str:
    """Changes a file; says how."""
    kinds: list[Callable[[Path, Random], str]] = [_bytes, _bytes, _place]
    if path.suffix in TEXTS or ".txt" in path.name:
        kinds += [_word] * 6 + [_lines] * 3 + [_encoding, _bomb]
    elif path.suffix == ".png":
        kinds += [_png] * 3
    elif path.suffix == ".npz":
        kinds += [_npz] * 6
    else:
        kinds += [_bytes] * 4
    return f"{path.name}: {random.choice(kinds)(path, random)}"


def _bytes(path: Path, random: Random) -> str:
    """Cut, changed, doubled or replaced by noise, somewhere; half of the time near the start, where headers are."""
    content = bytearray(path.read_bytes())
    reach = len(content) if random.random() < 0.5 else min(len(content), 200)
    start = random.randint(0, reach)
    match what := random.choice(["cut", "changed", "removed", "doubled", "noise", "empty"]):
        case "cut":
            del content[start:]
        case "changed":
            for _ in range(random.choice([1, 4, 30])):
                if reach:
                    content[random.randrange(reach)] = random.choice([0, 255, 127, 128, random.randrange(256)])
        case "removed":
            del content[start : start + random.choice([1, 4, 100])]
        case "doubled":
            content[start:start] = content[start : start + 500] * random.choice([1, 50])
        case "noise":
            content[start : start + 200] = random.randbytes(random.randint(0, 400))
        case "empty":
            content.clear()
    path.write_bytes(content)
    return f"bytes {what} at {start}"


def _place(path: Path, random: Random) -> str:
    """Something else is where the file was."""
    whole = path.read_bytes()
    path.unlink()
    match what := random.choice(
        ["nothing", "pipe", "folder", "dangling", "loop", "device", "socket", "endless", "text"]
    ):
        case "pipe":
            os.mkfifo(path)
        case "folder":
            path.mkdir()
        case "dangling":
            path.symlink_to("nowhere")
        case "loop":
            path.symlink_to(path.name)
        case "device":
            path.symlink_to(random.choice(["/dev/zero", "/dev/null", "/dev/full"]))
        case "socket":
            with socket.socket(socket.AF_UNIX) as made:
                made.bind(str(path)) if len(str(path)) < 100 else path.mkdir()
        case "endless":
            with path.open("wb") as file:
                file.write(whole[:100])
                file.truncate(1 << 40)
        case "text":
            path.write_text("what is this\n" * random.choice([1, 1000]))
    return what


def _word(path: Path, random: Random) -> str:
    """One of the words is another."""
    text = path.read_text(encoding="utf-8")
    starts = [i for i in range(len(text)) if not i or (text[i - 1] in " \t\n,:[{" and text[i] not in " \t\n")]
    if not starts:
        return "left as it is"
    start = random.choice(starts)
    end = next((i for i in range(start, len(text)) if text[i] in " \t\n,:]}"), len(text))
    word = random.choice(WORDS)
    path.write_text(text[:start] + word + text[end:], encoding="utf-8")
    return f"{text[start:end]!r} at {start} is {word[:20]!r}"


def _lines(path: Path, random: Random) -> str:
    lines = path.read_text(encoding="utf-8").splitlines()
    i, j = random.randrange(len(lines) + 1), random.randrange(len(lines) + 1)
    match what := random.choice(["removed", "doubled", "swapped", "joined", "long", "blank", "shuffled", "crlf"]):
        case "removed":
            del lines[min(i, j) : max(i, j)]
        case "doubled":
            lines[i:i] = lines[i : i + 1]
        case "swapped" if len(lines):
            i, j = i % len(lines), j % len(lines)
            lines[i], lines[j] = lines[j], lines[i]
        case "joined":
            lines[i : i + 2] = [" ".join(lines[i : i + 2])]
        case "long":
            lines.insert(i, "7 " * 100_000)
        case "blank":
            lines[i:i] = [""] * 50
        case "shuffled":
            random.shuffle(lines)
    path.write_text(("\r\n" if what == "crlf" else "\n").join([*lines, ""]), encoding="utf-8", newline="")
    return f"lines {what} at {i}"


def _encoding(path: Path, random: Random) -> str:
    encoding = random.choice(["utf-16", "utf-32", "utf-8-sig", "latin-1", "utf-7"])
    path.write_bytes(("é" * (encoding == "latin-1") + path.read_text(encoding="utf-8")).encode(encoding, "replace"))
    return encoding


def _bomb(path: Path, random: Random) -> str:
    """Little that stands for much."""
    nest = "l0: &l0 [x]\n" + "".join(f"l{i}: &l{i} [{', '.join([f'*l{i - 1}'] * 9)}]\n" for i in range(1, 12))
    name, text = random.choice(
        [("aliases", nest), ("deep", "[" * 5000), ("deep JSON", '{"a":' * 5000), ("digits", "9" * 100_000)]
    )
    path.write_text(random.choice(["", path.read_text(encoding="utf-8")]) + text, encoding="utf-8")
    return name


def _png(path: Path, random: Random) -> str:
    """A header that claims something else, with its right check sum; or a chunk that decoders have a word about."""
    content = path.read_bytes()
    if random.random() < 0.3:
        made = _chunk(
            random.choice([b"iCCP", b"gAMA", b"tRNS", b"PLTE", b"zTXt", b"IDAT", b"acTL"]),
            random.randbytes(random.choice([0, 4, 60])),
        )
        path.write_bytes(content[:33] + made + content[33:])
        return "a chunk"
    side, depth, colour = (
        random.choice([0, 1, 97, 8000, 30_000, 60_000, 2**31]),
        random.choice([1, 8, 16, 5]),
        random.choice([0, 2, 3, 6, 9]),
    )
    size = (side, 64) if random.random() < 0.3 else (side, side)
    path.write_bytes(
        content[:8] + _chunk(b"IHDR", struct.pack(">IIBBBBB", *size, depth, colour, 0, 0, 0)) + content[33:]
    )
    return f"claims {size[0]} x {size[1]}, {depth} bits, kind {colour}"


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def _npz(path: Path, random: Random) -> str:
    """One array of it is another."""
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    name = random.choice(sorted(arrays))
    array = arrays[name]
    match what := random.choice(
        ["nan", "inf", "zero", "huge", "shape", "dtype", "gone", "empty", "order", "object", "bomb"]
    ):
        case "nan" | "inf" | "huge":
            value = {"nan": np.nan, "inf": -np.inf, "huge": 1e30}[what]
            if array.dtype.kind == "f":
                arrays[name] = np.full(array.shape, value).astype(array.dtype)
            else:
                arrays[name] = array - min(10**6, np.iinfo(array.dtype).max)
        case "zero":
            arrays[name] = np.zeros_like(array)
        case "shape":
            arrays[name] = array.reshape(-1)[: random.randint(0, array.size)]
        case "dtype":
            arrays[name] = array.astype(random.choice(["f4", "i1", "c16", "S3", "M8[ns]"]))
        case "gone":
            del arrays[name]
        case "empty":
            arrays = {}
        case "order":
            arrays[name] = array[::-1]
        case "object":
            arrays[name] = np.array([{}], object)
        case "bomb":
            arrays[name] = np.zeros(1 << 27, np.uint8)
    out = BytesIO()
    np.savez_compressed(out, **arrays)  # type: ignore[arg-type]
    path.write_bytes(out.getvalue())
    return f"{name} {what}"
