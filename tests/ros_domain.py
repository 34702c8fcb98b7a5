"""A domain of ROS 2 that only one run of these tests on this machine has."""

import contextlib
import socket
from collections.abc import Iterator

import pytest


@contextlib.contextmanager
def own_domain() -> Iterator[int]:
    """Keep ROS, in every process that is started meanwhile, on this machine and in a domain of its own; yield it.

    Holding a TCP port reserves the domain.
    """
    for domain in range(1, 100):
        with socket.socket() as held, pytest.MonkeyPatch.context() as patch:
            try:
                held.bind(("127.0.0.1", 19_800 + domain))
            except OSError:
                continue
            patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
            patch.setenv("ROS_DOMAIN_ID", str(domain))
            yield domain
            return
    raise AssertionError("no ROS domain is free")
