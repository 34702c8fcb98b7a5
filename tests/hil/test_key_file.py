"""A key that only its owner has; whatever else is at its place is refused in one line."""

import io
import os
import stat
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from ortilo_drake.hil.wire import key_file
from ortilo_drake.hil.wire.key_file import NO_SECRET, choose_key, default_file, own_key, read_key, write_key
from ortilo_drake.model.typed_yaml import InputError

HERE, BEYOND = "tcp://127.0.0.1:7667", "tcp://0.0.0.0:7667"


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    return tmp_path


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def test_a_key_comes_back_and_nobody_else_may_read_it(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        write_key(tmp_path / "new" / "a")
    finally:
        os.umask(before)
    write_key(tmp_path / "b")
    a, b = read_key(tmp_path / "new" / "a"), read_key(tmp_path / "b")
    assert len(a) == len(b) == 32
    assert a != b
    assert (mode(tmp_path / "new" / "a"), mode(tmp_path / "new")) == (0o600, 0o700)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["b", "new"]


def test_a_key_is_never_overwritten(tmp_path: Path) -> None:
    for there in (lambda path: path.write_text("mine"), lambda path: path.symlink_to(tmp_path / "elsewhere")):
        path = tmp_path / "key"
        there(path)
        with pytest.raises(InputError, match=r"key: cannot be written: file exists$"):
            write_key(path)
        assert [file.name for file in tmp_path.iterdir()] == ["key"]
        path.unlink()


def a_link(path: Path) -> None:
    write_key(path.with_name("target"))
    path.symlink_to(path.with_name("target"))


def with_text(text: str) -> Callable[[Path], None]:
    def make(path: Path) -> None:
        path.touch(0o600)
        path.write_text(text)

    return make


def with_mode(bits: int) -> Callable[[Path], None]:
    def make(path: Path) -> None:
        write_key(path)
        path.chmod(bits)

    return make


@pytest.mark.parametrize(
    ("make", "why"),
    [
        (lambda path: None, "no key file: no such file or directory"),
        (a_link, "no key file: too many levels of symbolic links"),
        (lambda path: path.mkdir(), "no key file: must be a regular file"),
        (lambda path: os.mkfifo(path, 0o600), "no key file: must be a regular file"),
        (with_mode(0o640), "others may read or write it: chmod 600 .*, or make a new one"),
        (with_mode(0o604), "others may read or write it: .*"),
        (with_mode(0o620), "others may read or write it: .*"),
        *[
            (with_text(text), "no key: must be 64 hexadecimal digits, as `ortilo hil key FILE` makes them")
            for text in ("", 63 * "a", 65 * "a", 64 * "g", 64 * "A", 32 * "a " + 32 * "b", 64 * "a" + "\nb", 64 * "ä")
        ],
    ],
)
def test_whatever_else_is_there_is_refused(tmp_path: Path, make: Callable[[Path], None], why: str) -> None:
    make(tmp_path / "key")
    with pytest.raises(InputError, match=rf"^{tmp_path}/key: {why}$"):
        read_key(tmp_path / "key")


def test_the_key_of_another_user_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_key(tmp_path / "key")
    monkeypatch.setattr(os, "geteuid", lambda: (tmp_path / "key").stat().st_uid + 1)
    with pytest.raises(InputError, match=r"belongs to user \d+: a key must be your own$"):
        read_key(tmp_path / "key")


def test_the_halves_of_a_user_share_a_key_whoever_is_first(home: Path) -> None:
    found: list[bytes] = []
    halves = [threading.Thread(target=lambda: found.append(own_key())) for _ in range(16)]
    for half in halves:
        half.start()
    for half in halves:
        half.join()
    assert len(found) == 16
    assert set(found) == {read_key(default_file())}
    assert default_file() == home / "config" / "ortilo" / "key"
    assert [file.name for file in default_file().parent.iterdir()] == ["key"]


def test_without_a_place_for_settings_it_is_below_home(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("XDG_CONFIG_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert default_file() == tmp_path / ".config" / "ortilo" / "key"


def test_a_bus_of_this_machine_takes_ones_own_key(home: Path) -> None:
    assert choose_key(HERE) == choose_key(HERE) == read_key(default_file())


def test_what_is_open_to_other_machines_needs_a_key_or_a_word(home: Path) -> None:
    with pytest.raises(InputError, match=r"^url: .* is open to other machines: give both halves the same --key FILE"):
        choose_key(BEYOND)
    assert not default_file().exists()
    write_key(home / "key")
    assert choose_key(BEYOND, str(home / "key")) == read_key(home / "key")
    assert choose_key(BEYOND, insecure=True) == NO_SECRET
    with pytest.raises(InputError, match="--insecure: cannot be combined with --key"):
        choose_key(BEYOND, str(home / "key"), insecure=True)


def test_a_key_may_come_on_stdin(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(key_file.sys, "stdin", io.StringIO(32 * "0a" + "\n"))
    assert choose_key(HERE, "-") == 32 * b"\n"
    monkeypatch.setattr(key_file.sys, "stdin", io.StringIO("a key\n"))
    with pytest.raises(InputError, match=r"^stdin: no key"):
        choose_key(HERE, "-")
