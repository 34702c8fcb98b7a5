"""A scheduler that runs already: who is refused, and what becomes of work when something dies."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from ortilo_drake.flight.processes import scheduler
from ortilo_drake.flight.processes.scheduler import check_address, on_scheduler
from ortilo_drake.flight.processes.workers import run_all
from ortilo_drake.model.input_error import InputError

DASK = [sys.executable, "-m", "dask"]


@pytest.mark.parametrize(
    "address",
    [
        "",
        "8786",
        "http://127.0.0.1:1",
        "tcp://127.0.0.1",
        "tcp://:8786",
        "tcp://a:b",
        "tls://a:\u0663",
        "tls://a:\u00b2",
        "tls://a:0",
        "tls://a:65536",
    ],
)
def test_what_is_no_address_is_refused(address: str) -> None:
    with pytest.raises(InputError, match="must be tcp://HOST:PORT or tls://HOST:PORT"):
        check_address(address)


@pytest.mark.parametrize("address", ["tcp://10.0.0.5:8786", "tcp://0.0.0.0:8786", "tcp://cluster:8786"])
def test_beyond_loopback_only_tls_will_do(address: str) -> None:
    with pytest.raises(InputError, match="must be tls://"):
        check_address(address)
    check_address(address.replace("tcp", "tls"))


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:8786", "tcp://localhost:8786", "tcp://[::1]:8786"])
def test_on_loopback_tcp_will_do(address: str) -> None:
    check_address(address)


def test_nobody_who_answers_is_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scheduler, "ANSWERS_WITHIN", 0.5)
    with socket.socket() as taken:  # bound, and listens to nobody
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match="does not answer"), on_scheduler(f"tcp://127.0.0.1:{port}"):
            pass


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[tuple[str, subprocess.Popen, list[subprocess.Popen]]]:
    """Yield a scheduler's address, its process, and those of two workers without nannies."""
    file, quiet = tmp_path / "scheduler.json", {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    words = ["scheduler", "--host", "tcp://127.0.0.1", "--port", "0", "--scheduler-file", str(file), "--no-dashboard"]
    head = subprocess.Popen([*DASK, *words], **quiet)
    words = ["worker", "--scheduler-file", str(file), "--nthreads", "1", "--no-dashboard", "--no-nanny"]
    try:
        while not file.exists():
            assert head.poll() is None
            time.sleep(0.05)
        hands = [subprocess.Popen([*DASK, *words], **quiet) for _ in range(2)]
        address = ""
        while not address:
            try:
                address = json.loads(file.read_text())["address"]
            except (ValueError, KeyError):
                time.sleep(0.05)
        yield address, head, hands
    finally:
        for process in (head, *hands):
            process.kill()
            process.wait()


@pytest.mark.processes
def test_work_is_done_also_where_a_worker_is_killed(
    cluster: tuple[str, subprocess.Popen, list[subprocess.Popen]],
) -> None:
    address, _, hands = cluster
    found: dict[int, int] = {}

    def take(number: int, result: int) -> None:
        found[number] = result
        if len(found) == 3:
            hands[0].send_signal(signal.SIGKILL)

    with on_scheduler(address):
        run_all(pow, [(k, 2) for k in range(20)], 1, take)
    assert found == {k: k**2 for k in range(20)}


def of_this_module() -> str:
    return "what no worker has"


@pytest.mark.processes
@pytest.mark.parametrize(
    ("digest", "said"), [(os.getpid, "has another version"), (of_this_module, "has no ortilo-drake")]
)
def test_a_worker_with_another_program_is_refused(
    digest: Callable[[], object],
    said: str,
    cluster: tuple[str, subprocess.Popen, list[subprocess.Popen]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(scheduler, "program_digest", digest)
    with pytest.raises(InputError, match=rf"worker tcp://.*: {said}"), on_scheduler(cluster[0]):
        pass


@pytest.mark.processes
def test_a_scheduler_that_dies_ends_it_with_a_line(
    cluster: tuple[str, subprocess.Popen, list[subprocess.Popen]],
) -> None:
    address, head, _ = cluster

    def take(number: int, result: int) -> None:
        head.send_signal(signal.SIGKILL)

    with pytest.raises(InputError, match="went away"), on_scheduler(address):
        run_all(time.sleep, [(0.1,)] * 50, 1, take)
