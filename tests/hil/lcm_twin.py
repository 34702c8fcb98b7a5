"""LCM's own library, as Drake has it, and our bus on the same group; test_bus.py runs this in a network of its own.

Arguments: how long to wait for each message [s], then the sizes of the messages to send each way, one after the other.
"""

import sys
import time

from pydrake.lcm import DrakeLcm

from ortilo_drake.hil.wire.bus import open_bus

URL = "udpm://239.255.76.67:7667?ttl=0"


def verdict(came: list[bytes], sent: list[bytes]) -> str:
    return "all" if came == sent else "none" if not came else f"{len(came)} of {len(sent)}"


def main() -> None:
    wait, sent = float(sys.argv[1]), [bytes([size % 251]) * size for size in map(int, sys.argv[2:])]
    theirs, to_theirs, to_ours = DrakeLcm(URL), [], []  # type: ignore[var-annotated]
    with open_bus(URL) as ours:
        theirs.Subscribe("X", to_theirs.append)
        ours.subscribe("X", lambda data: None)
        for data in sent:  # one at a time: pydrake keeps one message a channel until it is handled
            ours.publish("X", data)
            until, before = time.monotonic() + wait, len(to_theirs)
            while len(to_theirs) == before and time.monotonic() < until:
                theirs.HandleSubscriptions(10)
        ours.handle()
        ours.subscribe("Y", to_ours.append)
        for data in sent:
            theirs.Publish("Y", data)
        until = time.monotonic() + wait
        while len(to_ours) < len(sent) and time.monotonic() < until:
            ours.handle(10)
    print(f"ours to theirs: {verdict(to_theirs, sent)}")
    print(f"theirs to ours: {verdict(to_ours, sent)}")


if __name__ == "__main__":
    main()
