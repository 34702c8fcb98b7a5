"""A bus that is there or an error that mends it, of this machine alone, and understood by LCM's own library."""

import shutil
import socket
import struct
import subprocess
import sys
import time
from pathlib import Path

import pytest
from hil_link import open_bus
from waiting import HANGS

from ortilo_drake.hil.wire import bus as library
from ortilo_drake.hil.wire.bus import MEMORY_URL, Bus
from ortilo_drake.hil.wire.multicast import Multicast, address, is_local, leaves_machine
from ortilo_drake.hil.wire.udpm import encode
from ortilo_drake.model.typed_yaml import InputError

SIZES = (0, 1, 200, 65_496, 65_497, 65_498, 65_499, 150_000)  # on channel X the last but two are LCM's short ones


def heard(bus: Bus, channel: str) -> list[bytes]:
    came: list[bytes] = []
    bus.subscribe(channel, came.append)
    return came


def group_of(url: str) -> tuple[str, int]:
    group, port, _ = address(url)
    return group, port


@pytest.mark.parametrize(
    "url",
    [
        "", "lcm", "tcpq://127.0.0.1:7667", "udpm://", "udpm://nobody:7667", "udpm://10.0.0.1:7667", "udpm://239.255.76.67",
        "udpm://239.255.76.67:0", "udpm://239.255.76.67:70000", "udpm://239.255.76.67:7667/x",
        "udpm://239.255.76.67:7667?ttl=256", "udpm://239.255.76.67:7667?ttl=-1", "udpm://239.255.76.67:7667?ttl=x",
        "udpm://239.255.76.67:7667?tll=0", "udpm://239.255.76.67:7667?recv_buf_size=0", "udpm://[::1]:7667", "udpm://[:7667",
    ],
)  # fmt: skip
def test_a_bad_url_is_refused(url: str, capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(InputError, match=r"^url: ") as caught:
        library.open_bus(url)
    assert repr(url) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_only_a_ttl_leaves_the_machine() -> None:
    assert leaves_machine("udpm://239.255.76.67:7667?ttl=1")
    assert not leaves_machine("udpm://239.255.76.67:7667?ttl=0")
    assert not leaves_machine("udpm://239.255.76.67:7667")
    assert not leaves_machine(MEMORY_URL)


def test_a_port_that_nobody_shares_is_found_out(bus: str) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as another:
        another.bind(group_of(bus))
        with pytest.raises(InputError, match=r"^url: .*address already in use"):
            library.open_bus(bus)


def test_a_bus_that_hears_nothing_is_found_out(bus: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Multicast, "wait", lambda self, milliseconds: False)
    monkeypatch.setattr(Multicast, "receive", lambda self: [])
    with pytest.raises(InputError, match=r"^url: .*nothing sent there is heard"):
        library.open_bus(bus)


@pytest.mark.parametrize("url", ["of this test", MEMORY_URL])
def test_what_is_published_is_heard_whole_and_in_order(bus: str, url: str) -> None:
    a = open_bus(bus if url != MEMORY_URL else url)
    b = open_bus(bus) if url != MEMORY_URL else a
    came, other = heard(b, "X"), heard(b, "Y")
    sent = [bytes([size % 251]) * size for size in SIZES]
    for data in sent:
        a.publish("X", data)
    a.publish("Z", b"nobody listens")
    until = time.monotonic() + HANGS
    while len(came) < len(sent) and time.monotonic() < until:
        b.handle(10)
    assert came == sent
    assert other == []
    assert b.refused == {}


def test_another_port_is_another_bus(bus: str, other_bus: str) -> None:
    a, b, other = open_bus(bus), open_bus(bus), open_bus(other_bus)
    came, silent = heard(b, "X"), heard(other, "X")
    a.publish("X", b"here")
    assert b.handle(round(1e3 * HANGS)) == 1
    assert other.handle(20) == 0
    assert (came, silent) == ([b"here"], [])


def test_handle_waits_no_longer_than_told_whatever_else_comes(bus: str) -> None:
    a, b = open_bus(bus), open_bus(bus)
    for _ in range(100):
        a.publish("Y", b"for somebody else")
    assert b.handle(1) == 0
    assert b.handle() == 0


class Quiet:
    """A wire on which something comes at times, never for us."""

    def __init__(self, wakes: int):
        self.wakes, self.waited = wakes, list[int]()

    def send(self, datagram: bytes) -> None: ...

    def receive(self) -> list[tuple[tuple[str, int], bytes]]:
        return [(("127.0.0.1", 1), encode("Y", 0, b"")[0])]

    def wait(self, milliseconds: int) -> bool:
        self.waited.append(milliseconds)
        return len(self.waited) <= self.wakes

    def close(self) -> None: ...


def test_handle_waits_all_it_is_told_and_not_in_a_busy_loop() -> None:
    for wakes in (0, 3):
        wire = Quiet(wakes)
        assert Bus(wire, "").handle(10_000) == 0
        assert wire.waited[0] == 10_000
        assert len(wire.waited) == wakes + 1
    wire = Quiet(0)
    assert Bus(wire, "").handle(1) == 0
    assert wire.waited == [1]
    assert Bus(wire, "").handle() == 0
    assert wire.waited == [1]


def test_what_comes_from_elsewhere_is_not_heard(bus: str, monkeypatch: pytest.MonkeyPatch) -> None:
    joined = open_bus(bus)
    came = heard(joined, "X")
    datagram = encode("X", 0, b"data")[0]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.sendto(datagram, ("127.0.0.1", group_of(bus)[1]))  # to this machine, not to the group
        assert joined.handle(50) == 0
        sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
        sender.sendto(datagram, group_of(bus))
        assert joined.handle(round(1e3 * HANGS)) == 1
        # A sender is on this machine only if its address is: one of a network of documentation's is not.
        monkeypatch.setattr("ortilo_drake.hil.wire.multicast._LOOPBACK", "203.0.113.7")
        monkeypatch.setattr("ortilo_drake.hil.wire.multicast.is_local", lambda host: host == "203.0.113.7")
        sender.sendto(datagram, group_of(bus))
        assert joined.handle(50) == 0
    assert came == [b"data"]


def test_which_addresses_are_this_machines() -> None:
    assert is_local("127.0.0.1")
    assert is_local("127.1.2.3")
    assert not is_local("203.0.113.7")  # of a network kept for documentation, RFC 5737


# --- in a network of its own ---------------------------------------------------------------------------------------

TWIN = Path(__file__).with_name("lcm_twin.py")


def in_a_network(wait: float, sizes: tuple[int, ...], *commands: str) -> str:
    """Return what lcm_twin.py says in a network namespace with a loopback interface alone, after some commands."""
    if not shutil.which("unshare") or subprocess.run(["unshare", "-rn", "true"], capture_output=True).returncode:
        pytest.skip("`unshare -rn` is missing or not allowed: no network namespace to try in")
    if not shutil.which("ip"):
        pytest.skip("the command `ip` is missing (Debian: iproute2)")
    script = "; ".join(("ip link set lo up", *commands, 'exec "$@"'))
    command = ["unshare", "-rn", "sh", "-c", script, "sh", sys.executable, str(TWIN), *map(str, (wait, *sizes))]
    done = subprocess.run(command, capture_output=True, text=True, timeout=HANGS)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.processes
def test_lcms_own_library_hears_us_and_is_heard() -> None:
    said = in_a_network(60.0, SIZES, "ip route add 224.0.0.0/4 dev lo")
    assert said == "ours to theirs: all\ntheirs to ours: all\n"


@pytest.mark.processes
def test_what_comes_by_another_interface_is_not_heard() -> None:
    # As on a machine whose multicast goes by its default route: there LCM listens to the whole network.
    cable = ("link add cable type dummy", "address add 10.76.67.1/24 dev cable", "link set cable up")
    said = in_a_network(2.0, (200,), *(f"ip {words}" for words in (*cable, "route add default dev cable")))
    assert said == "ours to theirs: none\ntheirs to ours: none\n"


@pytest.mark.processes
def test_the_datagram_that_kills_lcms_own_library_does_not_kill_ours(bus: str) -> None:
    joined, came = open_bus(bus), []
    joined.subscribe("ORTILO_HELLO", came.append)
    killing = struct.pack(">IIIIHH", 0x4C433033, 1, 2**16, 2**31, 0, 2) + b"ORTILO_HELLO\0" + 50 * b"A"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
        sender.sendto(killing, group_of(bus))
        sender.sendto(encode("ORTILO_HELLO", 2, b"data")[0], group_of(bus))
    assert joined.handle(round(1e3 * HANGS)) == 1
    assert (came, joined.refused) == ([b"data"], {"fragment": 1})
