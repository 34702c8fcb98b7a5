"""Addresses of buses, and which of them are open to other machines."""

import socket
from typing import Any

import pytest

from ortilo_drake.hil.wire.address import address, leaves_machine
from ortilo_drake.hil.wire.urls import DEFAULT_URL, ONBOARD_URL
from ortilo_drake.model.typed_yaml import InputError


@pytest.mark.parametrize(
    "url",
    [
        "", "tcp", "tcp://", "tcp://127.0.0.1", "tcp://127.0.0.1:0", "tcp://127.0.0.1:70000", "tcp://127.0.0.1:x",
        "tcp://:7667", "tcp://*:7667", "tcp://127.0.0.1:7667/x", "tcp://127.0.0.1:7667?x=1", "tcp://127.0.0.1:7667#x",
        "tcp://me@127.0.0.1:7667", "udp://127.0.0.1:7667", "udpm://239.255.76.67:7667?ttl=0", "ipc:///tmp/x",
        "tcp://[::1:7667", "tcp://nobody.invalid:7667", " tcp://127.0.0.1:7667", "TCP://127.0.0.1:7667",
    ],
)  # fmt: skip
def test_a_bad_url_is_refused_in_a_line(url: str) -> None:
    with pytest.raises(InputError, match=r"^url: ") as caught:
        address(url)
    assert repr(url) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("host", ["[fe80::1%lo]", "[fe80::1%1]", "127.0.0.1%lo"])
def test_a_host_of_one_interface_is_refused_in_a_line(host: str) -> None:
    """Only this machine knows its interfaces, and ZeroMQ writes them otherwise."""
    with pytest.raises(InputError, match=r"^url: '.*': host '.*' names an interface \(%\); give the host's .*$"):
        address(f"tcp://{host}:7667")


def test_only_the_loopback_interface_is_this_machines_alone() -> None:
    for here in (DEFAULT_URL, ONBOARD_URL, "tcp://127.1.2.3:1", "tcp://localhost:7667", "tcp://[::1]:7667"):
        assert not leaves_machine(here)
    for open_to_all in ("tcp://0.0.0.0:7667", "tcp://[::]:7667", "tcp://203.0.113.7:7667", "tcp://[2001:db8::1]:7667"):
        assert leaves_machine(open_to_all)


def test_who_joins_where_all_interfaces_are_served_does_so_on_this_machine() -> None:
    for url, served, joined in (
        ("tcp://0.0.0.0:7667", "tcp://0.0.0.0:7667", "tcp://127.0.0.1:7667"),
        ("tcp://[::]:7667", "tcp://[::]:7667", "tcp://[::1]:7667"),
        ("tcp://203.0.113.7:7667", "tcp://203.0.113.7:7667", "tcp://203.0.113.7:7667"),
    ):
        assert (address(url).endpoint(serves=True), address(url).endpoint(serves=False)) == (served, joined)


def test_a_name_is_its_ipv4_address_where_it_has_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Who serves tcp://0.0.0.0 does not serve IPv6, which a resolver names first (RFC 6724)."""
    six, four = (socket.AF_INET6, ("2001:db8::1", 7667, 0, 0)), (socket.AF_INET, ("192.0.2.1", 7667))

    def resolver(*found: tuple[int, tuple[Any, ...]]) -> Any:
        return lambda *args, **kwargs: [(family, socket.SOCK_STREAM, 6, "", at) for family, at in found]

    for found, host in (((six, four), "192.0.2.1"), ((four, six), "192.0.2.1"), ((six,), "2001:db8::1")):
        monkeypatch.setattr(socket, "getaddrinfo", resolver(*found))
        assert str(address("tcp://workstation:7667").host) == host
