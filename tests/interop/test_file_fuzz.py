"""Spoilt files of every kind that is read: each is read, or refused in one line, in little memory and time.

ORTILO_FUZZ_CASES says how many. A case is a function of its number alone.
"""

import os
import resource
import shutil
import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from made_up_motion import ANCHORS, BAG_MAP, TABLE_MAP, as_map, made_up, write_bag, write_tables
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rosbags.rosbag1 import Writer as BagWriter

from ortilo_drake.interop.recorded.anchors import read_anchors
from ortilo_drake.interop.recorded.recording import read_recording
from ortilo_drake.model.input_error import LONGEST, InputError
from ortilo_drake.studies.maps.chunks import chunk_file, read_chunk, write_chunk

CASES = int(os.environ.get("ORTILO_FUZZ_CASES", "2000"))
BLOCK = 50  # cases of a test; the first two are not long
BLOCKS = max(1, CASES // BLOCK)
MEMORY = 2**30  # more than the tests before took [bytes]
ABSURD = (0, 1, 0x7F, 0x80, 0xFF, 0x7FFFFFFF, 0xFFFFFFFF, 2**63 - 1, 2**63, 2**64 - 1)
CONSOLE = "100.{k},DIST,3,AN0,0E15,3.4,0.9,0.3,3.62,AN1,1516,3.1,-3.2,2.6,4.58,AN2,41B1,0,0,1,1.{k}\n"


class Kind(NamedTuple):
    """A kind of file: how to read it, and the file in a folder of small valid ones that is spoilt."""

    file: str
    read: Callable[[Path], object]


def recording(text: str) -> Callable[[Path], object]:
    map_ = as_map(text)
    return lambda folder: read_recording(folder, map_)


def figures(folder: Path) -> object:
    return read_chunk(folder, range(20), ("mse", "nees"))


LEC = f"ranges: {{file: lec.txt, format: lec, names: [0E15, 1516, '41B1']}}\nanchors: {ANCHORS[:3].tolist()}"
KINDS = {
    **{name: Kind(f"{name}.bag", recording(BAG_MAP.replace("BAG", f"{name}.bag"))) for name in ("none", "bz2", "lz4")},
    **{
        name: Kind(f"{name}.mcap", recording(BAG_MAP.replace("BAG", f"{name}.mcap")))
        for name in ("m_none", "m_zstd", "m_lz4", "m_bare")
    },
    "db3": Kind("db3/db3.db3", recording(BAG_MAP.replace("BAG", "db3"))),
    "metadata": Kind("db3/metadata.yaml", recording(BAG_MAP.replace("BAG", "db3"))),
    "packed": Kind("packed/packed.db3", recording(BAG_MAP.replace("BAG", "packed"))),
    "file": Kind("file/file.mcap.zstd", recording(BAG_MAP.replace("BAG", "file"))),
    "ranges": Kind("ranges.csv", recording(TABLE_MAP)),
    "imu": Kind("imu.csv", recording(TABLE_MAP)),
    "truth": Kind("truth.csv", recording(TABLE_MAP)),
    "lec": Kind("lec.txt", recording(LEC)),
    "anchors": Kind("lec.txt", lambda folder: read_anchors(folder / "lec.txt")),
    "parquet": Kind("seeds_00000000_00000019.parquet", figures),
}


def again(path: Path, out: Path, compression: CompressionType, chunked: bool = True) -> None:
    """Write an MCAP file's messages to another, without checksums, so that what is spoilt comes to be decoded."""
    with path.open("rb") as file, out.open("wb") as target:
        writer = Writer(target, chunk_size=8192, compression=compression, use_chunking=chunked, enable_crcs=False)
        writer.start(profile="ros2")
        channels: dict[int, int] = {}
        for schema, channel, message in make_reader(file).iter_messages():
            if channel.id not in channels:
                known = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, known)
            writer.add_message(channels[channel.id], message.log_time, message.data, message.publish_time)
        writer.finish()


@cache
def whole(kind: str) -> bytes:
    return (FOLDER[0] / KINDS[kind].file).read_bytes()


FOLDER: list[Path] = []


@pytest.fixture(scope="module", autouse=True)
def _files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("valid") / "files"  # what is kept of a map knows the name of its folder
    folder.mkdir()
    motion = made_up(duration=1.0)
    write_tables(folder, motion)
    for name in ("none", "bz2", "lz4"):
        with pytest.MonkeyPatch.context() as patch:
            if name != "none":
                start = BagWriter.open
                packing = BagWriter.CompressionFormat[name.upper()]
                patch.setattr(BagWriter, "open", lambda w, s=start, p=packing: (w.set_compression(p), s(w)))
            write_bag(folder / f"{name}.bag", motion, "ros1")
    write_bag(folder / "db3", motion, "sqlite3")
    write_bag(folder / "packed", motion, "sqlite3", "message")
    write_bag(folder / "file", motion, "mcap", "file")
    plain = next(write_bag(folder / "plain", motion, "mcap").glob("*.mcap"))
    again(plain, folder / "m_none.mcap", CompressionType.NONE)
    again(plain, folder / "m_zstd.mcap", CompressionType.ZSTD)
    again(plain, folder / "m_lz4.mcap", CompressionType.LZ4)
    again(plain, folder / "m_bare.mcap", CompressionType.NONE, chunked=False)
    (folder / "lec.txt").write_text("".join(CONSOLE.format(k=k) for k in range(9)))
    write_chunk(folder, range(20), ("mse", "nees"), np.arange(40.0).reshape(20, 2))
    assert chunk_file(folder, range(20)).name == KINDS["parquet"].file
    FOLDER.append(folder)
    yield
    FOLDER.clear()
    whole.cache_clear()


def spoil(data: bytes, rng: np.random.Generator) -> bytes:
    """Return bytes with bits turned, a number made absurd, a part cut out, repeated or moved, or the end cut off."""
    found = bytearray(data)
    for _ in range(rng.integers(1, 4)):
        at = int(rng.integers(len(found))) if found else 0
        size = int(rng.integers(1, 1 + min(64, len(found)))) if rng.random() < 0.7 else len(found) // 3
        match rng.integers(6):
            case 0:
                for place in rng.integers(len(found), size=rng.integers(1, 8)) if found else ():
                    found[place] ^= 1 << rng.integers(8)
            case 1:
                width = int(rng.choice([1, 2, 4, 8]))
                value = ABSURD[rng.integers(len(ABSURD))] % 256**width
                found[at : at + width] = value.to_bytes(width, "little")
            case 2:
                del found[at : at + size]
            case 3:
                found[at:at] = found[at : at + size] * int(rng.integers(1, 20))
            case 4:
                found[at : at + size] = bytes(rng.choice([0, 255, 32, 57]) for _ in range(min(size, 64)))
            case 5:
                del found[at:]
    return bytes(found)


def run_case(number: int, place: Path) -> str:
    """Return what became of a case: refused, or read."""
    rng = np.random.default_rng([34, number])
    name = list(KINDS)[number % len(KINDS)]
    kind = KINDS[name]
    target = place / kind.file
    target.write_bytes(spoil(whole(name), rng))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            found = kind.read(place)
        return "refused" if found is None else "read"
    except InputError as error:
        line = str(error)
        assert line.isprintable()
        assert len(line) <= LONGEST
        return "refused"
    finally:
        target.write_bytes(whole(name))


@pytest.mark.long
@pytest.mark.timeout(600)
@pytest.mark.parametrize("block", [pytest.param(k, marks=[pytest.mark.long] * (k >= 2)) for k in range(BLOCKS)])
def test_a_spoilt_file_is_read_or_refused_in_one_line(block: int, tmp_path: Path) -> None:
    shutil.copytree(FOLDER[0], tmp_path / "files")
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    became: dict[str, int] = {"refused": 0, "read": 0}
    for number in range(block * BLOCK, (block + 1) * BLOCK):
        try:
            became[run_case(number, tmp_path / "files")] += 1
        except BaseException as error:
            error.add_note(f"case {number}: {list(KINDS)[number % len(KINDS)]}")
            raise
    assert became["refused"] > BLOCK / 5
    assert became["read"] > BLOCK / 20
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 - before < MEMORY


@pytest.mark.family
@pytest.mark.parametrize("kind", KINDS)
def test_the_whole_file_is_read(kind: str, tmp_path: Path) -> None:
    shutil.copytree(FOLDER[0], tmp_path / "files")
    assert KINDS[kind].read(tmp_path / "files") is not None
