"""Output files: whole or not at all, through links, with their mode, straight into pipes; nothing left behind."""

import os
import re
import socket
import stat
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from ortilo_drake.flight.files import check_output, remove_stale, write_bytes, write_text
from ortilo_drake.model.typed_yaml import InputError

IMPORT = """
import os, resource, sys, time
from pathlib import Path
from ortilo_drake.flight.files import check_output, write_bytes, write_text
from ortilo_drake.model.typed_yaml import InputError
"""


def python(script: str, *words: object) -> subprocess.Popen[str]:
    """Start a Python process with the writer at hand."""
    command = (sys.executable, "-c", IMPORT + script, *map(str, words))
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def said_by(script: str, *words: object) -> str:
    process = python(script, *words)
    out, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    return out


@pytest.fixture
def umask() -> Iterator[None]:
    old = os.umask(0o027)
    yield
    os.umask(old)


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def test_a_new_file_has_the_mode_of_any_new_file_and_its_folders_are_made(tmp_path: Path, umask: None) -> None:
    path = tmp_path / "deep" / "down" / "new.txt"
    check_output(path)
    assert list(tmp_path.iterdir()) == []
    write_text(path, "µ\n")
    assert path.read_bytes() == b"\xc2\xb5\n"
    assert mode(path) == 0o640
    assert mode(path.parent) == 0o750
    assert [p.name for p in path.parent.iterdir()] == ["new.txt"]


@pytest.mark.parametrize("kept", [0o600, 0o640, 0o666, 0o755])
def test_a_file_that_is_there_keeps_its_mode(tmp_path: Path, umask: None, kept: int) -> None:
    path = tmp_path / "a.json"
    path.write_text("old")
    path.chmod(kept)
    write_text(path, "new")
    assert (path.read_text(), mode(path)) == ("new", kept)


@pytest.mark.parametrize("there", [True, False])
@pytest.mark.parametrize("relative", [True, False])
def test_a_link_stays_and_what_it_points_to_is_written(tmp_path: Path, there: bool, relative: bool) -> None:
    target, middle, link = tmp_path / "far" / "target.json", tmp_path / "middle.json", tmp_path / "link.json"
    target.parent.mkdir()
    if there:
        target.write_text("old")
        target.chmod(0o640)
    middle.symlink_to("far/target.json" if relative else target)
    link.symlink_to("middle.json" if relative else middle)
    check_output(link)
    write_text(link, "new")
    assert link.is_symlink()
    assert middle.is_symlink()
    assert target.read_text() == "new"
    if there:
        assert mode(target) == 0o640
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["far", "link.json", "middle.json", "target.json"]


def test_a_link_in_a_circle_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a").symlink_to("b")
    (tmp_path / "b").symlink_to("a")
    for write in (check_output, lambda path: write_bytes(path, b"")):
        with pytest.raises(InputError, match="a: cannot be written: Too many levels of symbolic links"):
            write(tmp_path / "a")


def test_a_pipe_is_written_to_and_stays(tmp_path: Path) -> None:
    pipe, data, read = tmp_path / "pipe", bytes(range(256)) * 1024, []  # more than a pipe holds
    os.mkfifo(pipe)
    end = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    held = os.open(pipe, os.O_WRONLY | os.O_NONBLOCK)  # until it is closed, the reader sees no end
    os.set_blocking(end, True)
    with open(end, "rb") as file:
        reader = threading.Thread(target=lambda: read.append(file.read()))
        reader.start()
        try:
            check_output(pipe)
            write_bytes(pipe, data)
        finally:
            os.close(held)
            reader.join()
    assert read == [data]
    assert stat.S_ISFIFO(pipe.lstat().st_mode)
    assert list(tmp_path.iterdir()) == [pipe]


def test_a_character_device_is_written_to_and_stays(tmp_path: Path) -> None:
    ours, theirs = os.openpty()
    try:
        link = tmp_path / "terminal"
        link.symlink_to(os.ttyname(theirs))
        check_output(link)
        write_text(link, "to the terminal")
        assert os.read(ours, 100) == b"to the terminal"
        assert stat.S_ISCHR(os.stat(link).st_mode)
    finally:
        os.close(ours)
        os.close(theirs)


@pytest.mark.processes
def test_what_is_printed_and_a_result_on_stdout_both_reach_the_file(tmp_path: Path) -> None:
    script = "print('first'); write_text(Path('/dev/stdout'), 'second'); print('third')"
    with (tmp_path / "both.txt").open("w") as file:
        command = (sys.executable, "-c", IMPORT + script)
        subprocess.run(command, stdout=file, check=True, timeout=120)
    assert (tmp_path / "both.txt").read_text() == "first\nsecondthird\n"
    assert said_by(script) == "first\nsecondthird\n"  # a pipe


@pytest.mark.parametrize("write", [check_output, lambda path: write_bytes(path, b"")], ids=["checked", "written"])
@pytest.mark.parametrize(
    ("where", "reason"),
    [
        ("folder", "is a folder"),
        ("link to folder", "is a folder"),
        ("socket", "is a socket"),
        ("file/below", "Not a directory"),
        ("n" * 256, "File name too long"),
        ("p/" * 2100 + "x", "File name too long"),
        ("nul\0", "embedded null"),  # byte, or from Python 3.13 character
    ],
)
def test_what_is_never_written(tmp_path: Path, where: str, reason: str, write: Callable[[Path], None]) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "link to folder").symlink_to("folder")
    (tmp_path / "file").write_text("in the way")
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(tmp_path / "socket"))
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(InputError) as refused:
        write(tmp_path / where)
    assert str(refused.value).startswith(str(tmp_path / where)[:60])
    assert re.search(f": cannot be written: (stat: )?{reason}( byte| character in path)?$", str(refused.value))
    assert sorted(tmp_path.rglob("*")) == before


def test_a_name_as_long_as_names_may_be(tmp_path: Path) -> None:
    path = tmp_path / ("n" * 250 + ".json")
    check_output(path)
    write_text(path, "x")
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


AS_NOBODY = """
folder = Path(sys.argv[1])
if os.geteuid() == 0:
    os.setgroups([]), os.setgid(65534), os.setuid(65534)
for name in ("closed/new.txt", "open/read-only.txt", "closed/deep/new.txt"):
    for write in (check_output, lambda path: write_text(path, "new")):
        try:
            write(folder / name)
        except InputError as error:
            print(error)
"""


@pytest.fixture
def reached_by_all() -> Iterator[Path]:
    """Return a folder that every user reaches, as tmp_path is not."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        yield Path(folder)


@pytest.mark.processes
def test_without_permission_nothing_is_written(reached_by_all: Path) -> None:
    for name, allowed in (("closed", 0o555), ("open", 0o777)):
        (reached_by_all / name).mkdir()
        (reached_by_all / name).chmod(allowed)
    (reached_by_all / "open" / "read-only.txt").write_text("old")
    (reached_by_all / "open" / "read-only.txt").chmod(0o444)
    lines = said_by(AS_NOBODY, reached_by_all).splitlines()
    assert [line.split(": cannot be written: ")[0] for line in lines] == [
        f"{reached_by_all}/{name}"
        for name in ("closed/new.txt", "open/read-only.txt", "closed/deep/new.txt")
        for _ in range(2)
    ]
    assert (reached_by_all / "open" / "read-only.txt").read_text() == "old"
    assert sorted(p.name for p in reached_by_all.rglob("*")) == ["closed", "open", "read-only.txt"]


FULL = """
resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000))
for name in sys.argv[1:]:
    try:
        write_bytes(Path(name), bytes(20_000))
    except InputError as error:
        print(error)
"""


@pytest.mark.processes
def test_a_full_disk_leaves_the_old_file_and_no_part_of_the_new(tmp_path: Path) -> None:
    old = tmp_path / "old.nc"
    old.write_text("old")
    assert said_by(FULL, old, tmp_path / "new.nc").splitlines() == [
        f"{tmp_path}/{name}.nc: cannot be written: File too large" for name in ("old", "new")
    ]
    assert old.read_text() == "old"
    assert list(tmp_path.iterdir()) == [old]


@pytest.mark.parametrize("start", [check_output, lambda path: remove_stale(path.parent)], ids=["command", "flights"])
def test_only_what_a_dead_process_left_is_removed(tmp_path: Path, start: Callable[[Path], None]) -> None:
    """A process that was killed two days ago is dead; one that writes now may be alive."""
    (tmp_path / ".ortilo-folder.partial").mkdir()
    (tmp_path / ".ortilo-link.partial").symlink_to("elsewhere")
    (tmp_path / "mine.partial").write_text("not ours")
    (tmp_path / ".ortilo-new.partial").write_text("of a living process")
    stay = {*tmp_path.iterdir()}
    (tmp_path / ".ortilo-old.partial").write_text("of a dead one")
    for path in tmp_path.iterdir():
        if path.name != ".ortilo-new.partial":
            os.utime(path, (time.time() - 2 * 86400,) * 2, follow_symlinks=False)
    start(tmp_path / "flight.nc")
    assert {*tmp_path.iterdir()} == stay


def test_an_interruption_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_text(tmp_path / "a.json", "new")
    assert list(tmp_path.iterdir()) == []


def test_a_file_is_on_the_disk_before_its_name_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[str] = []
    for name in ("fsync", "replace"):
        real = getattr(os, name)
        monkeypatch.setattr(os, name, lambda *words, real=real, name=name: (calls.append(name), real(*words))[1])
    write_text(tmp_path / "a.json", "new")
    write_bytes(tmp_path / "checkpoint", b"new", sync=False)
    assert calls == ["fsync", "replace", "replace"]


def test_half_a_surrogate_pair_is_not_written(tmp_path: Path) -> None:
    (tmp_path / "kept.json").write_text("before")
    with pytest.raises(InputError, match=r"kept\.json: cannot be written: holds text that is no Unicode"):
        write_text(tmp_path / "kept.json", "\ud800")
    assert (tmp_path / "kept.json").read_text() == "before"
