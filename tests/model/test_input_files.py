"""Files that a user names: what is no regular file, or too large, is refused at once and in one line."""

import os
import socket
from pathlib import Path

import pytest

from ortilo_drake.model.input_error import LONGEST, InputError, one_line
from ortilo_drake.model.input_files import MIB, TEXT_LIMIT, check_file, exists, open_file, read_bytes, read_text


def refusal(path: Path, limit: int = TEXT_LIMIT) -> str:
    """Return the line that refuses a file, the same for all ways to read it."""
    lines = set()
    for read in (open_file, check_file, read_bytes):
        with pytest.raises(InputError) as error:
            read(path, limit)
        lines.add(str(error.value))
    (line,) = lines
    return line


def test_a_regular_file_is_read_and_a_link_followed(tmp_path: Path) -> None:
    file, link = tmp_path / "file", tmp_path / "link"
    file.write_bytes("Müll\r\n\n".encode())
    link.symlink_to(file)
    for path in (file, link):
        assert read_bytes(path) == "Müll\r\n\n".encode()
        assert read_text(path) == "Müll\n\n"
        check_file(path)
        assert exists(path)


def test_what_is_no_regular_file_is_refused_without_waiting_for_it(tmp_path: Path) -> None:
    fifo, link, bound = tmp_path / "fifo", tmp_path / "zero", tmp_path / "socket"
    os.mkfifo(fifo)  # which nobody ever writes to
    link.symlink_to("/dev/zero")  # has no end
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(bound))
        assert refusal(fifo) == f"{fifo}: cannot be read: is no regular file"
        assert refusal(link) == f"{link}: cannot be read: is no regular file"
        assert refusal(bound).startswith(f"{bound}: cannot be read: ")
    assert refusal(tmp_path) == f"{tmp_path}: cannot be read: Is a directory"


def test_no_more_is_read_than_the_limit(tmp_path: Path) -> None:
    file = tmp_path / "large"
    with file.open("wb") as sparse:
        sparse.truncate(1024 * 1024 * MIB)
    assert refusal(file) == f"{file}: cannot be read: 1.049e+06 MiB, at most 4 MiB are read"
    os.truncate(file, TEXT_LIMIT)
    assert len(read_bytes(file, TEXT_LIMIT)) == TEXT_LIMIT
    os.truncate(file, TEXT_LIMIT + 1)
    assert "at most 4 MiB" in refusal(file)


def test_a_file_that_does_not_tell_its_size_is_read_to_the_limit() -> None:
    told = Path("/proc/self/environ")
    if not told.exists():
        pytest.skip("no /proc here, whose files say that they are empty")
    assert told.stat().st_size == 0
    assert read_bytes(told, 10 * MIB)
    with pytest.raises(InputError, match=r"at most 9\.5"):
        read_bytes(told, 1)


@pytest.mark.parametrize(
    ("name", "why"),
    [("nul\0byte", "embedded null"), ("x" * 300, "File name too long"), ("x/" * 3000, "File name too long")],
)
def test_a_name_that_no_file_can_have(tmp_path: Path, name: str, why: str) -> None:
    assert why in refusal(tmp_path / name)
    assert not exists(tmp_path / name)


def test_a_link_to_itself(tmp_path: Path) -> None:
    (tmp_path / "loop").symlink_to("loop")
    assert "symbolic links" in refusal(tmp_path / "loop")


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("plain ä 🛸 text", "plain ä 🛸 text"),
        ("two\nlines\r\n", "two\\nlines\\r\\n"),
        ("\x1b[2J\x9b1m\x07", "\\x1b[2J\\x9b1m\\x07"),
        ("a\u202eb\u2028c\udcff", "a\\u202eb\\u2028c\\udcff"),
    ],
)
def test_an_error_is_one_line_that_no_terminal_obeys(text: str, line: str) -> None:
    assert str(InputError(text)) == line
    assert one_line(line) == line


@pytest.mark.parametrize("letter", ["x", "\x1b", "\U0001f6f8", "\udcff"])
def test_a_long_line_loses_its_middle(letter: str) -> None:
    line = str(InputError("file.yaml: " + letter * 5000 + ": must be short"))
    assert len(line) <= LONGEST
    assert line.isprintable()
    assert line.startswith("file.yaml: ")
    assert line.endswith(": must be short")
    assert " ... " in line
