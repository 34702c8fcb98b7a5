"""Worker processes on this machine; only the process that started them can reach them.

Dask runs any code that is sent to it, and any user of the machine can connect to a port on loopback. So every
connection of a cluster uses TLS with authentication on both sides. The certificate is made for this cluster, and only
its own processes know it. No process serves HTTP. This module imports Dask: import it only where processes start.
"""

import logging
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker
from typing import Any

from distributed import Nanny, Scheduler, Security, SpecCluster, Worker

from ortilo_drake.model.input_error import InputError

LOOPBACK = "127.0.0.1"


def start_cluster(workers: int) -> SpecCluster:
    """Return a cluster of `workers` processes on this machine; its context manager ends them.

    InputError if a process ends while it starts, at the first and at a second try.
    """
    try:
        return _start_cluster(workers)
    except RuntimeError:  # Dask's: a process was killed before it was a worker
        pass
    try:
        return _start_cluster(workers)
    except RuntimeError:
        raise InputError(
            f"workers={workers}: a process ended while it started, twice (out of memory?): must be fewer, or 1 to work "
            "in this process; what is finished is kept"
        ) from None


def _start_cluster(workers: int) -> SpecCluster:
    security = Security.temporary()
    options = {"host": LOOPBACK, "protocol": "tls://", "security": security, "dashboard": False}
    worker = {"cls": _Nanny, "options": options | {"nthreads": 1, "memory_limit": None, "silence_logs": _SILENT}}
    with _without_ctrl_c():
        return SpecCluster(
            scheduler={"cls": _Scheduler, "options": options},
            workers=dict.fromkeys(range(workers), worker),
            security=security,
            silence_logs=_SILENT,
        )


_SILENT = logging.CRITICAL  # a dead worker is replaced; the error of a job that fails for good is raised here


@contextmanager
def _without_ctrl_c() -> Iterator[None]:
    """Block Ctrl-C while processes and threads start; they inherit the block, so none prints a traceback on Ctrl-C.

    This thread alone handles Ctrl-C and ends them. It handles a Ctrl-C that comes meanwhile at the end.
    """
    resource_tracker.ensure_running()  # started later, it would unblock Ctrl-C
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _WithoutHttp:
    """A mixin that keeps a Dask process from serving HTTP, which Dask does without TLS, even without a dashboard."""

    def start_http_server(self, *_: Any, **__: Any) -> None:
        """Start nothing."""


class _Scheduler(_WithoutHttp, Scheduler):
    pass


class _Worker(_WithoutHttp, Worker):
    pass


class _Nanny(Nanny):
    """A process that starts a worker process and replaces it when it dies."""

    def __init__(self, *arguments: Any, **options: Any):
        super().__init__(*arguments, worker_class=_Worker, **options)
