"""The process that keeps an onboard half in the air."""

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from waiting import wait_for

from ortilo_drake.hil.restart import keep_alive as module
from ortilo_drake.hil.restart.keep_alive import keep_alive
from ortilo_drake.model.typed_yaml import InputError

IN_FORK: list[Callable[[], None]] = []  # called inside os.fork in the parent, before there is a child
AFTER_FORK: list[Callable[[], None]] = []  # and once there is one
os.register_at_fork(  # which cannot be taken back
    before=lambda: [call() for call in IN_FORK], after_in_parent=lambda: [call() for call in AFTER_FORK]
)


@pytest.fixture(autouse=True)
def nothing_in_fork() -> Iterator[None]:
    yield
    IN_FORK.clear()
    AFTER_FORK.clear()


def test_a_process_that_dies_at_once_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "TOO_SOON", 600.0)  # however long a busy machine takes to kill it
    said: list[str] = []
    with pytest.raises(InputError, match="killed 3 times within 600 s of its start, by SIGKILL"):
        keep_alive(lambda killed: os.kill(os.getpid(), signal.SIGKILL), said.append)
    assert sum("was killed by SIGKILL" in line for line in said) == 3


def test_what_a_process_cannot_fly_is_told_in_one_line(capfd: pytest.CaptureFixture[str]) -> None:
    def refuse(killed: int) -> None:
        raise InputError("world: not heard")

    with pytest.raises(SystemExit) as ended:
        keep_alive(refuse, lambda line: print(line, file=sys.stderr))
    assert ended.value.code == 2
    started, refused = capfd.readouterr().err.splitlines()
    assert started.startswith("onboard half: process ")
    assert refused == "ortilo: world: not heard"


def is_ended_with(number: int, fly: Callable[[], None], pids: Path) -> None:
    """Assert that keep_alive raises what a signal asks for, and that the child it started is gone."""

    def fly_noted(killed: int) -> None:
        pids.write_text(str(os.getpid()))
        fly()

    error = KeyboardInterrupt if number == signal.SIGINT else SystemExit
    with pytest.raises(error) as ended:
        keep_alive(fly_noted, lambda line: None)
    if error is SystemExit:
        assert ended.value.code == 128 + number
    if pids.exists() and (child := pids.read_text()):  # it may have been killed between opening and writing
        with pytest.raises(ProcessLookupError):
            os.kill(int(child), 0)


def fly_a_minute() -> None:
    """Fly in short steps, as a flight does: a Ctrl-C right before a system call blocks is seen only after it."""
    for _ in range(6000):
        time.sleep(0.01)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_in_flight_ends_the_process_that_flies_too(number: int, tmp_path: Path) -> None:
    def fly_on() -> None:
        os.kill(os.getppid(), number)
        fly_a_minute()

    is_ended_with(number, fly_on, tmp_path / "child")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_that_another_thread_takes_ends_the_process_too(number: int, tmp_path: Path) -> None:
    child, slept = tmp_path / "child", tmp_path / "slept"

    def fly_to_the_end() -> None:
        fly_a_minute()
        slept.touch()

    def take() -> None:
        wait_for(child.exists, "the process that flies")
        signal.pthread_kill(threading.get_ident(), number)

    with ThreadPoolExecutor(1) as pool:
        taken = pool.submit(take)
        is_ended_with(number, fly_to_the_end, child)
        taken.result()
    assert not slept.exists()


@pytest.mark.family
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize("hooks", [IN_FORK, AFTER_FORK], ids=["before the child is there", "after"])
def test_a_signal_that_comes_inside_fork_is_not_lost(
    number: int, hooks: list[Callable[[], None]], tmp_path: Path
) -> None:
    hooks.append(lambda: os.kill(os.getpid(), number))
    is_ended_with(number, fly_a_minute, tmp_path / "child")


def test_a_signal_while_a_killed_process_is_spoken_of_is_not_lost(tmp_path: Path) -> None:
    def say(line: str) -> None:
        if "was killed" in line:
            os.kill(os.getpid(), signal.SIGTERM)

    def die_once(killed: int) -> None:
        if killed:
            fly_a_minute()
        os.kill(os.getpid(), signal.SIGKILL)

    with pytest.raises(SystemExit) as ended:
        keep_alive(die_once, say)
    assert ended.value.code == 128 + signal.SIGTERM


def test_the_handlers_and_the_mask_are_put_back() -> None:
    def state() -> tuple[object, ...]:
        handlers = [signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)]
        return (*handlers, signal.pthread_sigmask(signal.SIG_BLOCK, []))

    before = state()
    assert keep_alive(lambda killed: None, lambda line: None) == 0
    assert state() == before
