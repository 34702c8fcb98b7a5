"""The folder of a ROS 2 bag: the files that its metadata.yaml names, each checked and, if packed, unpacked.

A recorder writes metadata.yaml at its end. Without it, as after a loss of power, all bag files of the folder are read.
"""

import re
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path, PurePath
from typing import Final
from urllib.parse import quote

from ortilo_drake.interop.unpack import CHUNK_LIMIT, FILE_LIMIT, Unpacker
from ortilo_drake.model.input_files import MIB, check_file, exists, open_file, read_text, reason
from ortilo_drake.model.typed_yaml import InputError, parse_yaml

MOST: Final = 4096  # most files of a bag
PACKED: Final = ".zstd"
STORAGES: Final = {"mcap": ".mcap", "sqlite3": ".db3"}


def _metadata(path: Path) -> tuple[list[str], str, str]:
    """Return the names of a bag's files, the suffix of their kind, and what is packed: 'file', 'message' or ''."""
    found = parse_yaml(read_text(path), str(path))
    try:
        found = found["rosbag2_bagfile_information"]
        names = [PurePath(name).name for name in found["relative_file_paths"]]
        storage, mode = found["storage_identifier"], (found.get("compression_mode") or "").lower()
        kind = found.get("compression_format") or ""
        if not all(isinstance(text, str) for text in (storage, kind)):
            raise TypeError
    except (ValueError, TypeError, LookupError, AttributeError):
        raise InputError(f"{path}: is no rosbag2_bagfile_information with files and storage_identifier") from None
    if storage not in STORAGES:
        raise InputError(f"{path}: storage_identifier: '{storage}': must be {' or '.join(STORAGES)}")
    mode = "" if mode == "none" else mode
    if mode not in ("", "file", "message") or (mode and kind != "zstd"):
        raise InputError(f"{path}: compression: '{kind}' of '{mode}': must be zstd of file or message, or none")
    if not 1 <= len(names) <= MOST:
        raise InputError(f"{path}: relative_file_paths: {len(names)} files, must be 1 to {MOST}")
    return names, STORAGES[storage], mode


def _unlisted(folder: Path) -> tuple[list[str], str, str]:
    """Return the same as _metadata for a folder without metadata.yaml, from the names of its files."""
    for suffix in STORAGES.values():
        for mode, end in (("", suffix), ("file", suffix + PACKED)):
            if names := sorted((path.name for path in folder.glob(f"*{end}")), key=natural):
                return names, suffix, mode
    raise InputError(f"{folder}: a folder without metadata.yaml and without .db3 or .mcap files is no ROS 2 bag")


def natural(name: str) -> list[tuple[int, str]]:
    """Return a sort key with which bag_2 comes before bag_10."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", name)]


@contextmanager
def files_of_bag(bag: Path) -> Iterator[list[Path]]:
    """Yield the files (mcap or db3) of a ROS 2 bag, which is a folder or one packed file.

    Files packed as a whole are unpacked to a temporary folder. InputError if metadata.yaml is wrong, if a named file is
    missing, not regular or too large, or if all files together unpack to more than the limit.
    """
    folder = bag if bag.is_dir() else bag.parent
    if bag != folder:
        names, suffix, mode = [bag.name], Path(bag.stem).suffix, "file"
    elif exists(folder / "metadata.yaml"):
        names, suffix, mode = _metadata(folder / "metadata.yaml")
    else:
        names, suffix, mode = _unlisted(folder)
    paths = [folder / name for name in names]
    for path in paths:
        check_file(path)
    if mode != "file":
        yield paths
        return
    tried, unpacker = Unpacker(folder), Unpacker(folder)
    with tempfile.TemporaryDirectory(prefix="ortilo-") as place:
        unpacked = []
        for i, path in enumerate(paths):
            unpacked.append(Path(place) / f"{i}{suffix}")
            with open_file(path) as packed:
                for _ in tried.pieces("zstd", packed, FILE_LIMIT, path.name):
                    pass  # a trial, so that a file that is too large leaves nothing on the disk
            with open_file(path) as packed, unpacked[-1].open("wb") as file:
                for piece in unpacker.pieces("zstd", packed, FILE_LIMIT, path.name):
                    file.write(piece)
        yield unpacked


def check_database(path: Path) -> None:
    """Refuse a database with views or generated columns, whose computation may never end.

    InputError for such a database, a file that is no database, or a message of more than CHUNK_LIMIT.
    """
    try:
        with closing(sqlite3.connect(f"file:{quote(str(path))}?mode=ro&immutable=1", uri=True)) as database:
            database.execute("PRAGMA trusted_schema = OFF")
            query = "SELECT name FROM sqlite_master WHERE type = 'table' AND rootpage > 0"
            tables = {name for (name,) in database.execute(query)}
            known = {"topics", "messages", "schema", "metadata", "message_definitions"}
            odd = {name for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'view'")} & known
            for name in tables & known:
                columns = database.execute(f"PRAGMA table_xinfo({name})").fetchall()
                odd |= {f"{name}.{column[1]}" for column in columns if column[6]}
            if odd or not {"topics", "messages"} <= tables:
                missing = f"{', '.join(sorted(odd))} is computed" if odd else "has no tables topics and messages"
                raise InputError(f"{path}: no ROS 2 bag: {missing}")
            (largest,) = database.execute("SELECT max(length(data)) FROM messages").fetchone()
    except (sqlite3.Error, OverflowError) as error:
        raise InputError(f"{path}: cannot be read as a bag (cut short?): {reason(error)}") from None
    if (largest or 0) > CHUNK_LIMIT:
        raise InputError(f"{path}: a message of {largest / MIB:.4g} MiB; at most {CHUNK_LIMIT / MIB:g} MiB are read")
