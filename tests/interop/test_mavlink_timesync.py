"""TIMESYNC over a loopback, the other end computing its clock offset as PX4 does (its Timesync.cpp and .hpp)."""

import math
import socket
from contextlib import closing

import numpy as np
from pymavlink.dialects.v20 import common
from waiting import HANGS

from ortilo_drake.interop.mavlink import MavlinkBridge
from ortilo_drake.interop.mavlink_timesync import TimesyncThread


class Px4:
    """PX4's Timesync: offset of the companion's clock [us], by exponential smoothing with a skew."""

    def __init__(self) -> None:
        self.offset, self.skew, self.sequence = 0.0, 0.0, 0

    def update(self, now_us: int, tc1: int, ts1: int) -> None:
        assert tc1 > 0
        observed = (ts1 // 1000 + now_us - tc1 // 1000 * 2) // 2
        assert now_us - ts1 // 1000 < 10_000  # MAX_RTT_SAMPLE
        progress = self.sequence / 500
        p = 1.0 - math.exp(0.5 * (1.0 - 1.0 / (1.0 - progress))) if progress < 1.0 else 1.0
        gain = p * 0.003 + (1.0 - p) * 0.05
        before = self.offset
        if self.sequence == 0:
            self.offset = observed
        else:
            self.offset = gain * observed + (1.0 - gain) * (self.offset + self.skew)
            self.skew = gain * (self.offset - before) + (1.0 - gain) * self.skew
        self.sequence += 1

    def sync_stamp(self, usec: int, now_us: int) -> int:
        return usec + int(self.offset) if self.sequence >= 500 else now_us


def ask(sock: socket.socket, to: tuple, parser: common.MAVLink, tc1: int, ts1: int) -> None:
    sock.sendto(parser.timesync_encode(tc1, ts1).pack(parser), to)


def next_of(sock: socket.socket, kind: str) -> common.MAVLink_message:
    while True:
        message = common.MAVLink(None).parse_buffer(sock.recv(2000))[0]
        if message.get_type() == kind:
            return message


def test_px4_maps_the_stamp_of_an_estimate_to_when_it_was_measured() -> None:
    """Both clocks are the test's; theirs differ by 1.8e9 s and 20 ppm; each way takes 1 to 3 ms of them."""
    rng, px4, hrt = np.random.default_rng(2), Px4(), 5e6  # [us] since PX4's boot

    def companion() -> int:
        return int(1_800_000_000e9) + round(1e3 * hrt * (1.0 + 20e-6))

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        sock.settimeout(HANGS)
        url = f"udpout:127.0.0.1:{sock.getsockname()[1]}"
        with closing(MavlinkBridge(url)) as bridge, TimesyncThread(bridge, lambda _: None, companion) as answers:
            to = sock.recvfrom(2000)[1]  # of a heartbeat
            asking = common.MAVLink(None, srcSystem=1, srcComponent=1)
            answers.check_stamp(1e-9 * companion() - 0.1)  # of the same clock, so it is answered
            for _ in range(600):
                hrt += 100_000.0
                sent = int(hrt)
                hrt += rng.uniform(1e3, 3e3)
                ask(sock, to, asking, 0, 1000 * sent)
                reply = next_of(sock, "TIMESYNC")
                assert reply.ts1 == 1000 * sent
                assert reply.tc1 == companion()
                hrt += rng.uniform(1e3, 3e3)
                px4.update(int(hrt), reply.tc1, reply.ts1)
                if px4.sequence == 499:
                    assert px4.sync_stamp(0, int(hrt)) == int(hrt)  # not trusted yet: stamped when it comes
            measured, stamp = hrt, 1e-9 * companion()
            hrt += 120_000.0  # lag and filter
            bridge.send(stamp, np.zeros(15), np.eye(15))
            odometry = next_of(sock, "ODOMETRY")
    assert abs(px4.sync_stamp(odometry.time_usec, int(hrt)) - measured) < 1e3  # within a ms, of 120


def test_only_requests_are_answered_and_stamps_of_another_clock_end_that() -> None:
    """Stamps 1.33 s behind are those of a new process that catches up, unless they last."""
    said, now = list[str](), 1_800_000_000_000_000_000
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        sock.settimeout(HANGS)
        asking = common.MAVLink(None)
        with closing(MavlinkBridge(f"udpout:127.0.0.1:{sock.getsockname()[1]}")) as bridge:
            answers = TimesyncThread(bridge, said.append, lambda: now)
            request, reply = (asking.timesync_encode(tc1, 7).pack(asking) for tc1 in (0, 9))
            broken = bytearray(request)
            broken[-1] ^= 1  # of the checksum
            for packet in (reply, bytes(broken), request[:-4], b"\xfd" + bytes(300), request):
                answers.answer(packet)
            asked = now
            answers.check_stamp(-math.inf)
            answers.check_stamp(1e-9 * now - 1.33)
            now += 9_000_000_000
            answers.check_stamp(1e-9 * now - 1.33)
            now += 1_000_000_000
            answers.check_stamp(1e-9 * now - 0.9)
            for _ in range(2):  # a process that was stopped, and catches up
                now += 8_000_000_000
                answers.check_stamp(1e-9 * now - 1.54)
                answers.check_stamp(1e-9 * now - 0.02)
            answers.check_stamp(1e-9 * now - 86400.0)
            assert not said
            now += 10_000_000_000
            for stamp in (1e-9 * now - 86400.0, 1e-9 * now):
                answers.check_stamp(stamp)
                answers.answer(request)
            bridge.send_heartbeat()
            found = [common.MAVLink(None).parse_buffer(sock.recv(2000))[0] for _ in range(2)]
    assert [one.get_type() for one in found] == ["TIMESYNC", "HEARTBEAT"]
    assert (found[0].tc1, found[0].ts1) == (asked, 7)
    assert len(said) == 1
    assert said[0].startswith("warning  stamps are 8.64e+04 s behind this machine's clock: TIMESYNC is not answered")


def test_a_packet_of_a_stranger_is_not_received() -> None:
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as mine,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
    ):
        mine.bind(("127.0.0.1", 0))
        mine.settimeout(HANGS)
        with closing(MavlinkBridge(f"udpout:127.0.0.1:{mine.getsockname()[1]}")) as bridge:
            bridge.send_heartbeat()
            to = mine.recvfrom(2000)[1]
            other.sendto(b"x", to)
            mine.sendto(b"y", to)
            assert [bridge.receive(), bridge.receive()] == [None, b"y"]
