"""Jobs for worker processes on this machine or on a scheduler's; cluster.py starts the processes."""

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from contextvars import ContextVar
from multiprocessing import current_process
from pathlib import Path
from typing import Any

from ortilo_drake.flight.processes.scheduler import gone, remote_client
from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.optional import is_installed, later
from ortilo_drake.model.parts import load_plugin, plugin_files

distributed = later("distributed")


class _Shared:
    """The worker processes that all calls of run_all within kept_workers share."""

    def __init__(self, stack: ExitStack):
        self.stack = stack
        self.client: Any = None


_shared: ContextVar[_Shared | None] = ContextVar("shared workers", default=None)


@contextmanager
def kept_workers() -> Iterator[None]:
    """Keep the processes that the first run_all in this context starts, for all later calls: a start takes seconds."""
    with ExitStack() as stack:
        token = _shared.set(_Shared(stack))
        try:
            yield
        finally:
            _shared.reset(token)


def run_all(
    function: Callable[..., Any],
    jobs: Sequence[tuple[Any, ...]],
    workers: int,
    take: Callable[[int, Any], None] = lambda number, result: None,
) -> None:
    """Call a function once for each job, on `workers` processes; a dead worker is replaced and its job done again.

    Within scheduler.on_scheduler all workers of that scheduler do the jobs. The function is importable; each job, a
    tuple of its arguments, and the result are plain data. With `workers` = 1, or without Dask (the extra `workers`),
    the jobs run in this process. `take` is called in this process with the number and result of each job as it ends, in
    any order. InputError if each process would run the calling script again, if a scheduler goes away, or if processes
    are killed while they start or at every try of a job.
    """
    if workers < 1:
        raise InputError(f"workers: {workers}: must be 1 or more")
    remote = remote_client()
    if remote is not None:
        with gone():
            _submit(remote, function, jobs, take)
        return
    if workers == 1 or len(jobs) < 2 or not is_installed("distributed"):
        for number, job in enumerate(jobs):
            take(number, function(*job))
        return
    _refuse_unguarded_script(workers)
    with ExitStack() as stack:
        _submit(_connect(workers, min(workers, len(jobs)), stack), function, jobs, take)


def _submit(
    client: Any, function: Callable[..., Any], jobs: Sequence[tuple[Any, ...]], take: Callable[[int, Any], None]
) -> None:
    files = plugin_files()
    futures = {
        client.submit(_with_plugins, files, function, *job, pure=False, retries=2): number
        for number, job in enumerate(jobs)
    }
    for future in distributed.as_completed(futures):
        try:
            result = future.result()
        except distributed.KilledWorker:
            raise InputError(
                "workers: a process was killed at its work, and each that took it over was too (out of memory?): must "
                "be fewer; what is finished is kept"
            ) from None
        take(futures[future], result)


def _refuse_unguarded_script(workers: int) -> None:
    """Refuse to start processes from a script that each process would run again when it imports the script.

    The text of the script must have a guard `__main__`; the process that imports it notices a call outside the guard.
    """
    script = getattr(sys.modules["__main__"], "__file__", None)
    imported_again = getattr(current_process(), "_inheriting", False)
    if imported_again or (script and "__main__" not in _text(script)):
        raise InputError(
            f"workers={workers}: {script or 'the script'}: each worker process imports it; put the call under "
            '`if __name__ == "__main__":`, or fly with workers=1'
        )


def _text(script: str) -> str:
    """Return the text of a script; the text of a guard if no file can be read, as for a notebook or <stdin>."""
    try:
        return Path(script).read_text(encoding="utf-8", errors="replace")
    except OSError:
        return "__main__"


def _with_plugins(files: tuple[str, ...], function: Callable[..., Any], *job: Any) -> Any:
    """Load the plugin files, which register parts, in this worker; then call the function."""
    for file in files:
        load_plugin(file)
    return function(*job)


def _connect(workers: int, needed: int, stack: ExitStack) -> Any:
    """Return a client of the kept workers, started if there are none; outside kept_workers of workers of the stack."""
    from ortilo_drake.flight.processes import cluster  # imported here, for it imports Dask

    shared = _shared.get()
    if shared is None:
        return stack.enter_context(distributed.Client(stack.enter_context(cluster.start_cluster(needed))))
    if shared.client is None:
        started = shared.stack.enter_context(cluster.start_cluster(workers))
        shared.client = shared.stack.enter_context(distributed.Client(started))
    return shared.client
