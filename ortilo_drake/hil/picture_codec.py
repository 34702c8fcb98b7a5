"""Pictures as PNG, without loss, and back with no trust in the sender."""

import struct
import zlib
from typing import Final

import cv2
import numpy as np

_SIGNATURE: Final = b"\x89PNG\r\n\x1a\n"
_RGBA: Final = (8, 6, 0, 0, 0)  # 8 bits, colour with alpha, deflate, the usual filters, not interlaced
_FAST: Final = 1  # compression level: 5 is half as large and takes three times as long


def encode_png(image: np.ndarray) -> bytes:
    """Return a picture (height, width, 4), uint8 RGBA, as PNG.

    Raises:
        ValueError: if the picture is of another kind.
    """
    if image.ndim != 3 or image.shape[2] != 4 or image.dtype != np.uint8:
        raise ValueError(f"a picture is (height, width, 4) of uint8, not {image.shape} of {image.dtype}")
    bgra = cv2.cvtColor(image, cv2.COLOR_RGBA2BGRA)
    return cv2.imencode(".png", bgra, [cv2.IMWRITE_PNG_COMPRESSION, _FAST])[1].tobytes()


def _compressed(data: bytes) -> bytes | None:
    """Return the content of all IDAT chunks, or None unless the chunks are IHDR, IDAT ..., IEND, undamaged."""
    at, kinds, parts = len(_SIGNATURE), [], []
    while at + 12 <= len(data):
        end = at + 12 + int.from_bytes(data[at : at + 4], "big")
        if end > len(data) or zlib.crc32(data[at + 4 : end - 4]) != int.from_bytes(data[end - 4 : end], "big"):
            return None
        kinds.append(data[at + 4 : at + 8])
        if kinds[-1] == b"IDAT":
            parts.append(data[at + 8 : end - 4])
        at = end
    known = kinds[:1] == [b"IHDR"] and kinds[-1:] == [b"IEND"] and set(kinds[1:-1]) == {b"IDAT"}
    return b"".join(parts) if known and at == len(data) else None


def _is_whole(compressed: bytes, height: int, width: int) -> bool:
    """Return whether zlib data are exactly the rows of a picture, each with a filter that PNG knows."""
    row = 1 + 4 * width
    unpacker = zlib.decompressobj()
    try:
        rows = unpacker.decompress(compressed, height * row + 1)  # one byte more than there should be
    except zlib.error:
        return False
    whole = unpacker.eof and not unpacker.unused_data and len(rows) == height * row
    return whole and max(rows[::row]) <= 4


def decode_png(data: bytes, shape: tuple[int, int]) -> np.ndarray | None:
    """Return the picture (height, width, 4), uint8, or None unless it is a PNG of this shape that encode_png may make.

    Size and kind are read from the header before anything is decompressed, and no more is decompressed than fits.

    Args:
        data: any bytes.
        shape: height and width [px].
    """
    height, width = shape
    header = struct.pack(">I4sII5B", 13, b"IHDR", width, height, *_RGBA)
    if data[:8] != _SIGNATURE or data[8 : 8 + len(header)] != header:
        return None
    compressed = _compressed(data)
    if compressed is None or not _is_whole(compressed, height, width):
        return None
    bgra = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    return None if bgra is None else cv2.cvtColor(bgra, cv2.COLOR_BGRA2RGBA)
