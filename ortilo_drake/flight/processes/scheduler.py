"""Workers of a Dask scheduler that already runs, on this machine or another: `ortilo --scheduler ADDRESS ...`.

Dask runs any code that its client sends. So addresses beyond loopback must use TLS, with the certificates of Dask's own
configuration (distributed.comm.tls). The workers must have this very program: other sources fly other flights.
"""

import asyncio
import ipaddress
import logging
from collections.abc import Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from typing import Any, Final

from ortilo_drake.flight.processes.program import program_digest
from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.inputs.numbers import is_port
from ortilo_drake.model.optional import check_installed, later

distributed = later("distributed")

ANSWERS_WITHIN: Final = 10.0  # longest wait for a scheduler's answer, and for its first worker [s]

_remote: ContextVar[tuple[str, Any] | None] = ContextVar("scheduler", default=None)


def remote_client() -> Any:
    """Return the client of the scheduler that the enclosing on_scheduler connected to; None outside of on_scheduler."""
    found = _remote.get()
    return None if found is None else found[1]


@contextmanager
def on_scheduler(address: str) -> Iterator[None]:
    """Have run_all, in this context, use the workers of a scheduler, at tcp://127.0.0.1:8786 or tls://10.0.0.5:8786.

    InputError if the address is invalid, nobody answers, there is no worker, or a worker has another program.
    """
    check_address(address)
    check_installed("distributed", "workers")
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # a lost scheduler gets one line, from `gone`
    try:
        client = distributed.Client(address, timeout=ANSWERS_WITHIN)
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        raise InputError(f"--scheduler {address}: does not answer: {_line(error)}") from None
    try:
        _check_workers(client, address)
        token = _remote.set((address, client))
        try:
            yield
        finally:
            _remote.reset(token)
    finally:
        with suppress(OSError, RuntimeError, asyncio.CancelledError, TimeoutError):
            client.close(timeout=2.0)


@contextmanager
def gone() -> Iterator[None]:
    """Turn the errors of a scheduler that went away into an InputError of one line."""
    try:
        yield
    except (CancelledError, asyncio.CancelledError, distributed.comm.core.CommClosedError, TimeoutError) as error:
        address = found[0] if (found := _remote.get()) else ""
        raise InputError(
            f"--scheduler {address}: went away ({_line(error)}); what is finished is kept: run it again"
        ) from None


def check_address(address: str) -> None:
    """Refuse an invalid scheduler address, and an address beyond loopback without TLS; see on_scheduler."""
    scheme, _, rest = address.partition("://")
    host, _, port = rest.rpartition(":")
    if scheme not in ("tcp", "tls") or not host or not is_port(port):
        raise InputError(f"--scheduler {address}: must be tcp://HOST:PORT or tls://HOST:PORT, with PORT in 1 to 65535")
    if scheme == "tcp" and not _is_loopback(host.strip("[]")):
        raise InputError(
            f"--scheduler {address}: is beyond loopback: must be tls://, with certificates in Dask's configuration "
            "(docs/cluster.md)"
        )


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _check_workers(client: Any, address: str) -> None:
    try:
        client.wait_for_workers(1, timeout=ANSWERS_WITHIN)
    except TimeoutError:
        raise InputError(f"--scheduler {address}: has no worker after {ANSWERS_WITHIN:g} s") from None
    own = program_digest()
    found: dict[str, Any] = client.run(program_digest, on_error="return")
    for worker, digest in found.items():
        if isinstance(digest, Exception):
            raise InputError(f"--scheduler {address}: worker {worker}: has no ortilo-drake: {_line(digest)}")
        if digest != own:
            raise InputError(
                f"--scheduler {address}: worker {worker}: has another version of ortilo-drake; install this one"
            )


def _line(error: BaseException) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__
