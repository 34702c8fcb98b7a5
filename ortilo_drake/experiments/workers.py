"""Work for worker processes on this machine."""

from collections.abc import Callable, Sequence
from typing import Any

from distributed import Client, LocalCluster, as_completed


def run_all(
    function: Callable[..., Any],
    jobs: Sequence[tuple[Any, ...]],
    workers: int,
    take: Callable[[int, Any], None] = lambda number, result: None,
) -> None:
    """Call a function once for each job, on that many processes; a worker that dies is replaced and its job done again.

    Args:
        function: an importable function; arguments and result are plain data.
        jobs: its arguments.
        workers: processes; 1 works in this one.
        take: called here with each job's number and result as it comes in, in any order.
    """
    if workers == 1 or len(jobs) < 2:
        for number, job in enumerate(jobs):
            take(number, function(*job))
        return
    with _cluster(min(workers, len(jobs))) as client:
        futures = {client.submit(function, *job, pure=False, retries=2): number for number, job in enumerate(jobs)}
        for future in as_completed(futures):
            take(futures[future], future.result())


def _cluster(workers: int) -> Client:
    """Return a client of its own worker processes, reachable from this machine alone."""
    cluster = LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        processes=True,
        host="127.0.0.1",
        dashboard_address="127.0.0.1:0",
        worker_dashboard_address="127.0.0.1:0",
    )
    return _OwningClient(cluster)


class _OwningClient(Client):
    """A client that takes its cluster down with it."""

    def __exit__(self, *error: Any) -> None:
        cluster = self.cluster
        super().__exit__(*error)
        cluster.close()
