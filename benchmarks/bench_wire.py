"""The cost of a packet by our encrypted bus, beside LCM's own library as Drake has it.

    python benchmarks/bench_wire.py               # some seconds
    python benchmarks/bench_wire.py --smoke       # a moment, for continuous integration

One thread publishes a packet and waits until it has it again. Both take turns in blocks, so that a slow moment of the
machine hits both alike; what counts is the ratio. Without a multicast route LCM's library needs one:
`ip route add 224.0.0.0/4 dev lo`.
"""

import argparse
import json
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from pydrake.lcm import DrakeLcm

from ortilo_drake.hil.wire.bus import Bus
from ortilo_drake.hil.wire.key_file import new_key

OURS, THEIRS = "tcp://127.0.0.1:{}", "udpm://239.255.76.67:7699?ttl=0"
SIZES = {"imu (11 numbers)": 116, "telemetry (288 numbers)": 2328, "picture (120 kB)": 120_000}


def ours(size: int) -> Callable[[], None]:
    """Return a trip of a packet on our bus, from who serves it to who joins."""
    key, body, url = new_key(), bytes(size), OURS.format(7698 + size % 100)
    here, there = Bus(url, key, serves=True), Bus(url, key)
    came: list[bytes] = []
    there.subscribe("ORTILO_IMU", came.append)

    def trip() -> None:
        came.clear()
        here.publish("ORTILO_IMU", body)
        while not came:
            there.handle(1000)

    while not came:  # until it has joined
        here.publish("ORTILO_IMU", body)
        here.handle(10)
        there.handle(10)
    while there.handle(100):
        pass
    return trip


def theirs(size: int) -> Callable[[], None]:
    """Return a trip of a bare packet on Drake's."""
    here, there, body = DrakeLcm(THEIRS), DrakeLcm(THEIRS), bytes(size)
    came: list[bytes] = []
    there.Subscribe("ORTILO_IMU", came.append)

    def trip() -> None:
        came.clear()
        here.Publish("ORTILO_IMU", body)
        while not came:
            there.HandleSubscriptions(1000)

    return trip


def microseconds(trip: Callable[[], None], trips: int) -> np.ndarray:
    """Return how long each of so many trips took [us]."""
    times = np.empty(trips)
    for i in range(trips):
        begin = time.perf_counter()
        trip()
        times[i] = time.perf_counter() - begin
    return 1e6 * times


def compare(size: int, blocks: int, trips: int) -> dict[str, Any]:
    """Return medians and 99th percentiles [us] of both, and their ratios, ours by theirs."""
    both = {"ours": ours(size), "theirs": theirs(size)}
    times: dict[str, list[np.ndarray]] = {name: [] for name in both}
    for _ in range(blocks):
        for name, trip in both.items():
            times[name].append(microseconds(trip, trips))
    found: dict[str, Any] = {}
    for label, q in (("median", 0.5), ("p99", 0.99)):
        values = {name: float(np.quantile(np.concatenate(blocks_of), q)) for name, blocks_of in times.items()}
        found |= {f"{label}_us": values, f"{label}_ratio": values["ours"] / values["theirs"]}
    return found


def main() -> None:
    """Compare and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--smoke", action="store_true")
    blocks, trips = (2, 50) if parser.parse_args().smoke else (20, 500)
    print(json.dumps({name: compare(size, blocks, trips) for name, size in SIZES.items()}, indent=2))


if __name__ == "__main__":
    main()
