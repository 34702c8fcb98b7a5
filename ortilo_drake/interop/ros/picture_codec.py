"""Lossless encoding of pictures as PNG, and decoding, also of data from senders that are not trusted."""

import struct
import zlib
from typing import Final

import numpy as np

from ortilo_drake.model.optional import later

cv2 = later("cv2")

_SIGNATURE: Final = b"\x89PNG\r\n\x1a\n"
_KINDS: Final = {3: (8, 2, 0, 0, 0), 4: (8, 6, 0, 0, 0)}  # by channels: bits, colour, deflate, filters, not interlaced


def encode_png(image: np.ndarray) -> bytes:
    """Return a picture (height, width, 4), uint8 RGBA, as PNG; an opaque picture is written without alpha.

    All rendered pictures are opaque. OpenCV's default compression (run lengths of each row's differences) takes half
    the time of deflate's level 1 and is as small. ValueError if the picture is of another kind.
    """
    if image.ndim != 3 or image.shape[2] != 4 or image.dtype != np.uint8:
        raise ValueError(f"a picture is (height, width, 4) of uint8, not {image.shape} of {image.dtype}")
    opaque = bool((image[:, :, 3] == 255).all())
    done, data = cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGBA2BGR if opaque else cv2.COLOR_RGBA2BGRA))
    if not done:
        raise ValueError(f"a picture of {image.shape} cannot be encoded")
    return data.tobytes()


def decode_png(data: bytes) -> np.ndarray:
    """Return the picture (height, width, 4), uint8 RGBA, of a PNG that encode_png made; ValueError for other data."""
    pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None or pixels.dtype != np.uint8 or pixels.ndim != 3:
        raise ValueError("not a picture of 8 bits in colour")
    return cv2.cvtColor(pixels, cv2.COLOR_BGR2RGBA if pixels.shape[2] == 3 else cv2.COLOR_BGRA2RGBA)


def _compressed(data: bytes) -> bytes | None:
    """Return the content of all IDAT chunks; None unless the chunks are IHDR, IDAT ..., IEND, all undamaged."""
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


def _is_whole(compressed: bytes, height: int, row: int) -> bool:
    """Return whether zlib data hold exactly `height` rows of `row` bytes, each with a filter of PNG."""
    unpacker = zlib.decompressobj()
    try:
        rows = unpacker.decompress(compressed, height * row + 1)  # one byte more than there should be
    except zlib.error:
        return False
    whole = unpacker.eof and not unpacker.unused_data and len(rows) == height * row
    return whole and max(rows[::row]) <= 4


def decode_foreign_png(data: bytes, shape: tuple[int, int]) -> np.ndarray | None:
    """Return the picture (height, width, 4), uint8; None unless it is a PNG of this shape [px] and of our kind.

    Size and kind are read from the header before any decompression, and no more bytes are decompressed than fit.
    """
    height, width = shape
    for channels, kind in _KINDS.items():
        if data.startswith(_SIGNATURE + struct.pack(">I4sII5B", 13, b"IHDR", width, height, *kind)):
            compressed = _compressed(data)
            if compressed is not None and _is_whole(compressed, height, 1 + channels * width):
                return decode_png(data)
    return None
