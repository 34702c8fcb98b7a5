"""Worker processes: nobody gets in, a dead one is replaced, and Ctrl-C ends them without a word."""

import os
import signal
import socket
import ssl
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest
from distributed import Client, KilledWorker, Security, SpecCluster
from distributed.comm import CommClosedError
from distributed.process import AsyncProcess

from ortilo_drake.flight.processes import workers
from ortilo_drake.flight.processes.cluster import start_cluster
from ortilo_drake.flight.processes.workers import kept_workers, run_all
from ortilo_drake.model.input_error import InputError

pytestmark = pytest.mark.processes

LISTENS = "0A"  # the state of a TCP socket in /proc/net/tcp


@pytest.fixture(scope="module")
def others() -> set[tuple[str, int]]:
    """Where this process listens for another's sake: Drake's Meshcat goes on serving its page after a test of it."""
    return ports_open(os.getpid())


@pytest.fixture(scope="module")
def cluster(others: set[tuple[str, int]]) -> Iterator[SpecCluster]:
    with start_cluster(2) as cluster:
        yield cluster


def ports_open(pid: int) -> set[tuple[str, int]]:
    """Return where a process listens: addresses as the kernel writes them and ports."""
    sockets = set()
    for descriptor in Path(f"/proc/{pid}/fd").iterdir():
        try:
            sockets.add(str(descriptor.readlink()))
        except FileNotFoundError:  # closed meanwhile
            continue
    found = set()
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            columns = line.split()
            if columns[3] == LISTENS and f"socket:[{columns[9]}]" in sockets:
                address, port = columns[1].split(":")
                found.add((address, int(port, 16)))
    return found


def answer(port: int, context: ssl.SSLContext | None) -> bytes:
    """Return what a port says to a request for its pages, over TLS if there is a context; nothing if it hangs up."""
    with socket.create_connection(("127.0.0.1", port), timeout=60) as plain:
        try:
            with context.wrap_socket(plain) if context else plain as connection:
                connection.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")
                return connection.recv(1000)
        except (ssl.SSLError, ConnectionResetError):
            return b""


def test_who_has_no_certificate_is_refused_at_every_port(cluster: SpecCluster, others: set[tuple[str, int]]) -> None:
    with Client(cluster) as client:
        pids = [os.getpid(), *client.run(os.getpid).values()]
    assert len(set(pids)) == 3
    found = [ports_open(pid) - others for pid in pids]
    assert ("0100007F", int(cluster.scheduler_address.rpartition(":")[2])) in found[0]
    assert all(found)
    stranger = ssl.create_default_context()
    stranger.check_hostname, stranger.verify_mode = False, ssl.CERT_NONE
    for address, port in set.union(*found):
        assert address == "0100007F"  # 127.0.0.1, the lowest byte first
        assert answer(port, None) == b""
        assert answer(port, stranger) == b""


@pytest.mark.filterwarnings("ignore::ResourceWarning")  # what Dask leaves behind of a client that is refused
def test_a_client_without_the_clusters_own_certificate_is_refused(cluster: SpecCluster) -> None:
    address = cluster.scheduler_address
    assert address.startswith("tls://127.0.0.1:")
    with pytest.raises((CommClosedError, OSError)):
        Client(address.replace("tls", "tcp"), timeout=10)
    with pytest.raises((CommClosedError, OSError)):
        Client(address, security=Security.temporary(), timeout=10)


def die_once(mark: str, number: int) -> int:
    """Kill this process, the first time that it is called."""
    try:
        os.close(os.open(mark, os.O_CREAT | os.O_EXCL))
    except FileExistsError:
        return number
    os.kill(os.getpid(), signal.SIGKILL)
    return -1


def say(line: str) -> None:
    """Print a line in one piece, which two processes' lines cannot fall into."""
    os.write(1, f"{line}\n".encode())


def stay(*_: object) -> None:
    """Stay until Ctrl-C, in short steps: one that comes right before a system call blocks is seen only after it."""
    while True:
        time.sleep(0.01)


PROGRAM = """
import sys
sys.path.insert(0, sys.argv[1])
from test_workers import die_once, say, stay
from ortilo_drake.flight.processes.workers import run_all

found = {}
run_all(die_once, [(sys.argv[2], k) for k in range(4)], 2, found.__setitem__)
print(found == {k: k for k in range(4)}, flush=True)
try:
    run_all(say, [("at work",)] * 2, 2, stay)
except KeyboardInterrupt:
    print("interrupted")
"""


def test_of_a_worker_that_dies_and_of_ctrl_c_nothing_is_said(tmp_path: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, str(Path(__file__).parent), str(tmp_path / "mark")],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,  # a group of its own, as a terminal's Ctrl-C goes to all of it
    )
    assert process.stdout is not None
    lines = [process.stdout.readline() for _ in range(2)]
    os.killpg(process.pid, signal.SIGINT)
    rest, _ = process.communicate()
    assert lines[0] == "True\n"
    assert (tmp_path / "mark").exists()  # a worker did die
    assert (lines[1], rest.splitlines()[-1], process.returncode) == ("at work\n", "interrupted", 0), lines[1] + rest
    assert set(rest.splitlines()) <= {"at work", "interrupted"}


@pytest.mark.parametrize("killed", [1, 2])
def test_a_process_killed_while_it_starts_is_started_once_more(killed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    start, left = AsyncProcess.start, [killed]

    async def start_and_kill(process: AsyncProcess) -> None:
        await start(process)
        if left[0]:
            left[0] -= 1
            await process.kill()

    monkeypatch.setattr(AsyncProcess, "start", start_and_kill)
    if killed == 1:
        with start_cluster(1) as cluster:
            assert len(cluster.workers) == 1
        return
    with pytest.raises(InputError, match="workers=1: a process ended while it started, twice"):
        start_cluster(1)


def test_a_job_that_kills_every_process_is_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    class Killed:
        def result(self) -> None:
            raise KilledWorker("job", SimpleNamespace(address="tls://127.0.0.1:1"), 3)

    monkeypatch.setattr(workers, "remote_client", lambda: SimpleNamespace(submit=lambda *_, **__: Killed()))
    monkeypatch.setattr(workers.distributed, "as_completed", list)
    with pytest.raises(InputError, match="a process was killed at its work"):
        run_all(stay, [()], 1)


def test_kept_workers_are_the_same_in_every_call_and_end_with_the_context() -> None:
    found: set[int] = set()
    with kept_workers():
        for _ in range(2):
            run_all(os.getpid, [()] * 4, 2, lambda number, pid: found.add(pid))
    assert 0 < len(found) <= 2
    assert os.getpid() not in found
    for pid in found:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


@pytest.mark.parametrize(
    ("text", "refused"),
    [
        ("from ortilo_drake.flight.processes.workers import run_all\nrun_all(print, [('x',)] * 2, 2)\n", True),
        (
            "from ortilo_drake.flight.processes.workers import run_all\n"
            "if __name__ == '__main__':\n    run_all(print, [('x',)] * 2, 2)\n",
            False,
        ),
    ],
)
def test_a_script_that_its_workers_would_run_again_is_refused_before_one_starts(
    text: str, refused: bool, tmp_path: Path
) -> None:
    script = tmp_path / "mine.py"
    script.write_text(text)
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True)
    assert (done.returncode != 0) == refused
    assert (f"workers=2: {script}: each worker process imports it" in done.stderr) == refused
    assert ("failed to start" in done.stderr) is False
