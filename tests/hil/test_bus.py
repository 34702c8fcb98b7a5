"""A bus on which those who have the key hear each other; whoever has not is kept out, whatever it tries."""

import errno
import hashlib
import hmac
import secrets
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress

import pytest
import zmq
from curve25519 import public_key
from hil_link import KEY, greeting, open_bus, own_bus, refuses, settle
from waiting import HANGS, wait_for
from zmq.utils import z85

from ortilo_drake.hil.wire.bus import AT_ONCE, LARGEST, Bus, curve_keys
from ortilo_drake.model.typed_yaml import InputError

STRANGER = 32 * b"s"
SIZES = (0, 1, 200, 65_499, 150_000, 1_000_000)
ONCE = 2000 * b"o"
SECRET = b"thrust 14.7 N, and where the vehicle is"


def heard(bus: Bus, channel: str) -> list[bytes]:
    came: list[bytes] = []
    bus.subscribe(channel, came.append)
    return came


def until(done: Callable[[], bool], *buses: Bus) -> None:
    """Handle what comes on the buses until something is so."""

    def turn() -> bool:
        for bus in buses:
            bus.handle(5)
        return done()

    wait_for(turn, "messages")


def port_of(url: str) -> int:
    return int(url.rpartition(":")[2])


# --- who has the key -----------------------------------------------------------------------------------------------


def test_what_is_published_is_heard_by_all_others_whole_and_in_order(bus: str) -> None:
    server, a, b = open_bus(bus, serves=True), open_bus(bus), open_bus(bus)
    settle(server, a, b)
    came = {end: heard(end, "X") for end in (server, a, b)}
    other = [heard(end, "Y") for end in (server, a, b)]
    sent = [bytes([size % 251]) * size for size in SIZES]
    for source in (server, a):
        for data in sent:
            source.publish("X", data)
        source.publish("Z", b"nobody listens")
    until(lambda: len(came[b]) == 2 * len(sent) and len(came[a]) == len(came[server]) == len(sent), server, a, b)
    assert came[a] == came[server] == sent  # each the other's, and none its own
    assert sorted(came[b]) == sorted(2 * sent)
    assert other == [[], [], []]
    assert server.refused == a.refused == b.refused == {}


def test_another_port_is_another_bus(bus: str, other_bus: str) -> None:
    server, a, other = open_bus(bus, serves=True), open_bus(bus), open_bus(other_bus, serves=True)
    settle(server, a)
    came, silent = heard(a, "X"), heard(other, "X")
    server.publish("X", b"here")
    assert a.handle(round(1e3 * HANGS)) == 1
    assert other.handle(20) == 0
    assert (came, silent) == ([b"here"], [])


def test_who_does_not_hear_is_sent_nothing_and_is_heard(bus: str) -> None:
    server, a = open_bus(bus, serves=True), open_bus(bus)
    settle(server, a)
    came, there = heard(server, "X"), heard(a, "X")
    with Bus(bus, KEY, hears=False) as deaf:
        silent = heard(deaf, "X")

        def speak() -> bool:
            deaf.publish("X", b"data")
            server.publish("X", b"of the server")
            return b"data" in came and b"data" in there

        until(speak, server, a)
        assert deaf.handle(50) == 0
        assert silent == []


def test_handle_waits_no_longer_than_told_whatever_else_comes(bus: str) -> None:
    server, a = open_bus(bus, serves=True), open_bus(bus)
    settle(server, a)
    for _ in range(100):
        a.publish("Y", b"for somebody else")
    assert server.handle(1) == 0
    assert server.handle() == 0


def test_handle_takes_a_limited_number_at_once(bus: str) -> None:
    server, a = open_bus(bus, serves=True), open_bus(bus)
    settle(server, a)
    came = heard(server, "X")
    for _ in range(AT_ONCE + 10):
        a.publish("X", b"")
    time.sleep(0.2)
    assert server.handle(round(1e3 * HANGS)) <= AT_ONCE
    until(lambda: len(came) == AT_ONCE + 10, server)


def test_who_joins_finds_a_server_that_comes_later_and_one_that_comes_again(bus: str) -> None:
    a = open_bus(bus)
    came = heard(a, "X")
    for turn in (b"1", b"2"):
        a.publish("X", turn)
        with Bus(bus, KEY, serves=True) as server:
            its = heard(server, "X")
            settle(server, a)
            server.publish("X", b"here")
            until(lambda: came == [b"here"], a)
            assert its == [turn]
        came.clear()


def test_what_was_published_before_closing_arrives(bus: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ortilo_drake.hil.wire.bus._FLUSH", round(1e3 * HANGS))  # however long it takes
    a = open_bus(bus)
    came = heard(a, "X")
    with Bus(bus, KEY, serves=True) as server:
        settle(server, a)
        for i in range(50):
            server.publish("X", bytes([i]))
    until(lambda: len(came) == 50, a)
    assert came == [bytes([i]) for i in range(50)]


def test_who_is_gone_costs_the_others_nothing(bus: str) -> None:
    server, a = open_bus(bus, serves=True), open_bus(bus)
    with Bus(bus, KEY) as b:
        settle(server, a, b)
    came = heard(a, "X")
    for _ in range(100):
        server.publish("X", b"data")
        server.handle(1)
    until(lambda: len(came) == 100, a)
    assert len(server._others) == 1


def test_two_servers_are_one_too_many(bus: str) -> None:
    open_bus(bus, serves=True)
    with pytest.raises(InputError, match=r"^url: '.*': another process serves it; end that one, or give .* another --"):
        Bus(bus, KEY, serves=True)


def test_an_address_of_another_machine_is_not_served() -> None:
    with pytest.raises(InputError, match=r"^url: .* must be an address of this machine"):
        Bus("tcp://203.0.113.7:7667", KEY, serves=True)  # kept for documentation, RFC 5737


def test_on_the_loopback_interface_no_other_interface_listens(bus: str) -> None:
    open_bus(bus, serves=True)
    with socket.socket() as probe:  # another address of this machine, on which nobody listens
        assert probe.connect_ex(("127.0.0.2", port_of(bus))) == errno.ECONNREFUSED


def test_the_keys_are_the_hmac_of_rfc_2104_and_curve25519() -> None:
    """Against HMAC written out, and RFC 7748's ladder."""
    padded = KEY + bytes(32)
    inner, outer = bytes(k ^ 0x36 for k in padded), bytes(k ^ 0x5C for k in padded)
    for whose in ("server", "joins"):
        text = f"ortilo {whose}".encode()
        secret = hashlib.sha256(outer + hashlib.sha256(inner + text).digest()).digest()
        assert secret == hmac.digest(KEY, text, "sha256")
        public, private = curve_keys(KEY, whose)
        assert (z85.decode(private), z85.decode(public)) == (secret, public_key(secret))
    assert curve_keys(KEY, "server") != curve_keys(KEY, "joins") != curve_keys(STRANGER, "joins")


# --- who has not ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("key", [STRANGER, bytes(32), KEY[:-1] + b"x"])
def test_with_another_key_nobody_says_or_hears_anything(bus: str, key: bytes) -> None:
    server, a, stranger = open_bus(bus, serves=True), open_bus(bus), open_bus(bus, key=key)
    settle(server, a)
    came, there, stolen = heard(server, "X"), heard(a, "X"), heard(stranger, "X")

    def speak() -> bool:
        for end in (stranger, server):
            end.publish("X", b"data of " + str(id(end)).encode())
        return server.refused["key"] >= 3 and stranger.refused["key"] >= 3

    until(speak, server, a, stranger)
    until(lambda: bool(there), a)
    assert came == stolen == []
    assert {*there} == {b"data of " + str(id(server)).encode()}


@contextmanager
def raw(kind: int, url: str, **options: object) -> Iterator["zmq.Socket[bytes]"]:
    """Connect a socket of ZeroMQ's own with some options."""
    with zmq.Context() as context, context.socket(kind) as end:
        end.linger = 0
        for name, value in options.items():
            setattr(end, name, value)
        end.connect(url)
        yield end


def test_with_half_of_the_keys_nobody_comes_in(bus: str) -> None:
    server, a = open_bus(bus, serves=True), open_bus(bus)
    settle(server, a)
    came = heard(server, "X")
    ours, theirs = curve_keys(KEY, "server")[0], curve_keys(STRANGER, "joins")
    any_server = dict(zip(("curve_publickey", "curve_secretkey"), curve_keys(KEY, "joins"), strict=True))
    attempts = (
        {"curve_serverkey": ours, "curve_publickey": theirs[0], "curve_secretkey": theirs[1]},  # who knows the server's
        any_server | {"curve_serverkey": curve_keys(STRANGER, "server")[0]},  # and who knows the other pair
        {},  # without encryption
        {"plain_username": b"admin", "plain_password": b"admin"},
    )
    for options in attempts:
        before = server.refused["key"]
        with raw(zmq.DEALER, bus, probe_router=1, **options) as end:
            end.send_multipart([b"X", b"data"])
            until(lambda before=before: server.refused["key"] > before, server)
            server.publish("X", SECRET)
            server.handle(50)
            assert not end.poll(50)
    assert came == []


def test_bytes_that_are_no_zeromq_are_refused(bus: str) -> None:
    server, a = open_bus(bus, serves=True), open_bus(bus)
    settle(server, a)
    came = heard(server, "X")
    garbage = [b"", b"GET / HTTP/1.1\r\n\r\n", secrets.token_bytes(3000), 100 * b"\xff", bytes(4096)]
    garbage += [greeting(b"NULL"), greeting(b"CURVE")[:32] + secrets.token_bytes(500)]
    garbage += [b"\x01\x00\x04\x00X\x01data", b"LC02" + struct.pack(">I", 1) + b"X\0data"]  # ZMTP 1.0; the wire before
    for data in garbage:
        with socket.create_connection(("127.0.0.1", port_of(bus))) as end:
            end.sendall(data)
            server.handle(20)
    a.publish("X", b"data")
    until(lambda: bool(came), server)
    assert came == [b"data"]


def test_a_message_of_another_form_is_refused_and_one_too_large_ends_its_connection(bus: str) -> None:
    server, a = open_bus(bus, serves=True), open_bus(bus)
    settle(server, a)
    came, there = heard(server, "X"), heard(a, "X")
    for frames in ([b"X"], [b"X", b"a", b"b"], [b"", b"", b""], 40 * [b""]):
        a._socket.send_multipart(frames)
    a._socket.send_multipart([b"\xff\x00", b"a channel that is no text"])
    until(lambda: server.refused["frames"] == 4, server)
    a.publish("X", bytes(LARGEST + 1))
    a.publish("X", b"data")
    server.handle(50)
    assert bytes(LARGEST + 1) not in came
    settle(server, a)  # it is back
    server.publish("X", b"again")
    until(lambda: b"again" in there, server, a)


# --- who stands between --------------------------------------------------------------------------------------------


class Between:
    """A process between a server and those who join it: it hands on, records and changes what is sent."""

    def __init__(self, target: int, change: Callable[[bytes, int], bytes] = lambda data, n: data):
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"tcp://127.0.0.1:{self._listener.getsockname()[1]}"
        self._target, self._change = target, change
        self.to_server: list[bytearray] = []  # of each connection
        self.to_others = bytearray()
        self._ends: list[socket.socket] = [self._listener]
        self._start(self._accept)

    def _start(self, work: Callable[..., None], *args: object) -> None:
        threading.Thread(target=work, args=args, daemon=True).start()

    def _accept(self) -> None:
        while True:
            try:
                end, _ = self._listener.accept()
                there = socket.create_connection(("127.0.0.1", self._target))
            except OSError:
                return
            self._ends += [end, there]
            self.to_server.append(bytearray())
            self._start(self._pass, end, there, self.to_server[-1], True)
            self._start(self._pass, there, end, self.to_others, False)

    def _pass(self, source: socket.socket, target: socket.socket, tape: bytearray, changes: bool) -> None:
        n = 0
        try:
            while data := source.recv(65536):
                tape += data
                target.sendall(self._change(data, n) if changes else data)
                n += 1
        except OSError:
            pass
        for end in (source, target):
            end.close()

    def close(self) -> None:
        for end in self._ends:
            end.close()


def test_who_reads_what_is_sent_learns_nothing(bus: str) -> None:
    server = open_bus(bus, serves=True)
    with ExitStack() as stack:
        between = Between(port_of(bus))
        stack.callback(between.close)
        a = stack.enter_context(Bus(between.url, KEY))
        settle(server, a)
        came, there = heard(server, "ORTILO_COMMAND"), heard(a, "ORTILO_IMU")
        for _ in range(3):
            a.publish("ORTILO_COMMAND", SECRET)
            server.publish("ORTILO_IMU", SECRET)
        until(lambda: len(came) == len(there) == 3, server, a)
        sent = b"".join(between.to_server) + between.to_others
    assert len(sent) > 6 * len(SECRET)
    for word in (SECRET, b"thrust", b"ORTILO", b"SETTLE", KEY, *curve_keys(KEY, "server"), *curve_keys(KEY, "joins")):
        assert word not in sent


def test_a_recorded_connection_is_not_taken_again(bus: str) -> None:
    server = open_bus(bus, serves=True)
    came = heard(server, "X")
    with ExitStack() as stack:
        between = Between(port_of(bus))
        stack.callback(between.close)
        a = stack.enter_context(Bus(between.url, KEY))
        settle(server, a)
        a.publish("X", b"once")
        until(lambda: came == [b"once"], server)
        tape = between.to_server[-1]  # before it the machine may have been too slow for a handshake
        for _ in range(3):  # all at once, and as it was sent
            for cuts in ([bytes(tape)], [bytes(tape[i : i + 64]) for i in range(0, len(tape), 64)]):
                with socket.create_connection(("127.0.0.1", port_of(bus))) as end:
                    for data in cuts:
                        try:
                            end.sendall(data)
                        except OSError:
                            break  # the server has closed it
                        server.handle(1)
                    until(lambda: True, server)
        server.handle(100)
    assert came == [b"once"]


@pytest.mark.parametrize("attack", ["repeat", "flip"])
def test_a_message_repeated_or_changed_on_its_way_is_not_taken(bus: str, attack: str) -> None:
    server, attacks = open_bus(bus, serves=True), threading.Event()

    def change(data: bytes, n: int) -> bytes:
        if not attacks.is_set() or len(data) < len(ONCE):  # signs of life are shorter
            return data
        attacks.clear()
        return data + data if attack == "repeat" else data[:-1] + bytes([data[-1] ^ 1])

    came = heard(server, "X")
    with ExitStack() as stack:
        between = Between(port_of(bus), change)
        stack.callback(between.close)
        a = stack.enter_context(Bus(between.url, KEY))
        settle(server, a)
        before = len(between.to_server)
        attacks.set()
        a.publish("X", ONCE)
        wait_for(lambda: not attacks.is_set(), "the attack")

        def joined_again() -> bool:  # the connection is ended, and made anew
            return len(between.to_server) > before

        until(joined_again, server, a)
        assert came == ([ONCE] if attack == "repeat" else [])
        settle(server, a)
        came.clear()
        a.publish("X", b"twice")
        until(lambda: came == [b"twice"], server)


def test_a_flood_of_strangers_keeps_nobody_from_talking(bus: str) -> None:
    server, a, over = open_bus(bus, serves=True), open_bus(bus), threading.Event()
    settle(server, a)
    came, there, opened = heard(server, "X"), heard(a, "X"), [0]

    def flood() -> None:
        while not over.is_set():
            with socket.socket() as end:
                end.settimeout(1.0)
                try:
                    end.connect(("127.0.0.1", port_of(bus)))
                    end.sendall(secrets.token_bytes(2000))
                except OSError:
                    continue
                opened[0] += 1

    thread = threading.Thread(target=flood, daemon=True)
    thread.start()
    try:
        wait_for(lambda: opened[0] > 20, "a flood")
        for k in range(300):
            a.publish("X", b"up %d" % k)
            server.publish("X", b"down %d" % k)
            server.handle(1)
            a.handle(1)
        until(lambda: len(came) == len(there) == 300, server, a)
    finally:
        over.set()
        thread.join(HANGS)
    assert came == [b"up %d" % k for k in range(300)]
    assert there == [b"down %d" % k for k in range(300)]


def test_strangers_who_are_refused_while_nobody_looks_hold_nobody_up(bus: str) -> None:
    """A queue of ZeroMQ's holds 1000 at each end; one that is full holds up who fills it."""
    server, many, refused = open_bus(bus, serves=True), 2500, 0
    try:
        while refused < many:
            with socket.create_connection(("127.0.0.1", port_of(bus)), timeout=HANGS) as end:
                end.sendall(greeting(b"NULL"))
                with suppress(ConnectionError):
                    while end.recv(100):
                        pass
                refused += 1
    except TimeoutError:
        pass
    server.handle()
    assert server.refused["key"] <= AT_ONCE  # a flood is not all looked at in one tick
    until(lambda: server.refused["key"] >= refused, server)
    assert refused == many


def test_a_stranger_fills_no_more_memory_than_the_largest_message(bus: str) -> None:
    with Bus(bus, KEY, serves=True, largest=2**16):
        assert refuses(bus, 2**16 + 100)
        assert not refuses(bus, 2**16)


def test_the_largest_message_is_taken_and_none_larger(bus: str) -> None:
    with Bus(bus, KEY, serves=True, largest=2000) as server:
        a = open_bus(bus)
        settle(server, a)
        came = heard(server, "X")
        a.publish("X", bytes(2000))
        until(lambda: bool(came), server)
        a.publish("X", bytes(2001))
        settle(server, a)  # it is back
    assert came == [bytes(2000)]


def test_a_connection_that_says_nothing_is_closed_in_seconds(bus: str) -> None:
    """ZeroMQ keeps the time: its own default is half a minute."""
    server = open_bus(bus, serves=True)
    assert 0 < server._socket.get(zmq.HANDSHAKE_IVL) <= 5_000
    with socket.create_connection(("127.0.0.1", port_of(bus)), timeout=HANGS) as end:
        while end.recv(100):
            pass


def test_own_buses_are_the_tests_alone() -> None:
    with own_bus() as a, own_bus() as b:
        assert a != b
        with Bus(a, KEY, serves=True), pytest.raises(InputError):
            Bus(a, KEY, serves=True)
