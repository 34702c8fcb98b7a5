"""Compressed parts of recorded files, unpacked piece by piece within limits.

A few kB of zstd, lz4 or bz2 may unpack to gigabytes, and the size that a file states may be wrong. So the limits apply
to the bytes that come out, not to the stated size.
"""

from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, Final

from ortilo_drake.model.input_files import DATA_LIMIT, MIB
from ortilo_drake.model.optional import later
from ortilo_drake.model.typed_yaml import InputError

zstandard = later("zstandard")

CHUNK_LIMIT: Final = 128 * MIB  # largest part; recorders write chunks of 1 to 8 MiB, a large point cloud takes 30 MiB
FILE_LIMIT: Final = DATA_LIMIT  # limit of all parts of a file together, the same as for a file without compression
PIECE: Final = MIB


def _open(kind: str, packed: BinaryIO) -> Any:
    if kind == "zstd":
        return zstandard.ZstdDecompressor(max_window_size=CHUNK_LIMIT).stream_reader(packed, read_across_frames=True)
    if kind == "lz4":
        from lz4.frame import LZ4FrameFile  # type: ignore[import-untyped]  # imported only when needed

        return LZ4FrameFile(packed)
    if kind == "bz2":
        from bz2 import BZ2File

        return BZ2File(packed)
    raise InputError(f"compression '{kind}': zstd, lz4 and bz2 are read")


class Unpacker:
    """An unpacker of the parts of one file. Errors name `path`; the parts may still unpack to `left` bytes in all."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.left = FILE_LIMIT

    def pieces(self, kind: str, packed: BinaryIO, limit: int, what: str) -> Iterator[bytes]:
        """Yield the unpacked bytes of a part packed with `kind` (zstd, lz4 or bz2), at most PIECE bytes at a time.

        `what` is the name of the part in errors. InputError if the part is damaged, if it unpacks to more than `limit`
        bytes, or if all parts of the file together unpack to more than FILE_LIMIT.
        """
        size = 0
        try:
            reader = _open(kind, packed)
            while piece := reader.read(PIECE):
                size += len(piece)
                self.left -= len(piece)
                if size > limit:
                    raise InputError(f"{what} unpacks to more than {limit / MIB:g} MiB, the most that is read")
                if self.left < 0:
                    raise InputError(f"unpacks to more than {FILE_LIMIT / MIB:g} MiB, the most that is read of a file")
                yield piece
        except InputError as error:
            raise InputError(f"{self.path}: {error}") from None
        except ImportError:
            raise InputError(f"{self.path}: {what} is packed with {kind}, whose library is not installed") from None
        except (zstandard.ZstdError, RuntimeError, OSError, ValueError, EOFError, MemoryError) as error:
            line = " ".join(str(error).split()) or type(error).__name__
            raise InputError(f"{self.path}: {what} is damaged: {kind}: {line}") from None

    def unpack(self, kind: str, packed: bytes, what: str) -> bytes:
        """Return the unpacked bytes of a part, at most CHUNK_LIMIT; errors as in pieces."""
        return b"".join(self.pieces(kind, BytesIO(packed), CHUNK_LIMIT, what))
