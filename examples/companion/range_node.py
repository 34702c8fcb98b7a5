"""Ranges of a DWM1001 tag at a serial port, as topics of ROS 2 for `ortilo hil bridge --from ros2`.

    python examples/companion/range_node.py MAP.yaml /dev/ttyACM0

The map's `ranges.topics` end with the anchors' names, /uwb/a0CA8 (ROS allows no name that begins with a digit). A range
is stamped when the first byte of its line arrives. For another tag replace BAUD, `ranges_in` and `ask_for_ranges`.
"""

import math
import os
import select
import sys
import termios
import time
import tty
from collections.abc import Iterator

import yaml

from ortilo_drake.interop.recorded import lec_console

BAUD = 115200  # of a DWM1001; its USB port takes any


def ranges_in(line: str) -> list[tuple[str, float]]:
    """Return anchor's name and range [m] of each range in a tag's line; ValueError if the line is cut short."""
    return [(anchor, r) for anchor, _, r in lec_console.ranges_in(line)[1]]


def ask_for_ranges(port: int) -> None:
    """Send what makes a DWM1001 print ranges: two returns open its shell, `lec` starts them, and would stop them."""
    os.write(port, b"\r\r")
    time.sleep(1.0)
    os.write(port, b"lec\r")


SILENT = 3.0  # without a range, the tag is asked for them [s]


def open_port(name: str) -> int:
    """Return a descriptor of a serial port that gives bytes as they come."""
    port = os.open(name, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(port)
    *flags, _, _, characters = termios.tcgetattr(port)
    speed = getattr(termios, f"B{BAUD}")
    termios.tcsetattr(port, termios.TCSANOW, [*flags, speed, speed, characters])
    return port


class Lines:
    """Lines cut from bytes as they come, each with the time at which its first byte came [ns].

    One read gives what has come since the last, several lines where this process had to wait. The last byte came then,
    those before it one after the other at BAUD, or sooner if that began before the last read.
    """

    def __init__(self) -> None:
        self._rest, self._since, self._read = b"", 0, 0

    def add(self, now: int, data: bytes) -> Iterator[tuple[int, str]]:
        """Yield time and text of each line that these bytes, received now [ns], end."""
        step = min(10 * 10**9 // BAUD, (now - self._read) // max(1, len(data)))  # a byte has ten bits on the line
        *ended, rest = (self._rest + data).split(b"\n")
        begin = now - step * len(data)
        since, at = (self._since, begin - step * len(self._rest)) if self._rest else (begin, begin)
        for line in ended:
            yield since, line.decode("ascii", "replace").strip()
            at += step * (len(line) + 1)
            since = at
        self._rest, self._since, self._read = rest, since, now


def ranges_of(port: int) -> Iterator[tuple[int, str, float]]:
    """Yield time of arrival [ns], anchor's name and range [m] of each range, until the port is closed.

    One line tells of the first line that cannot be read, one of lines without ranges.
    """
    lines, heard, last, told = Lines(), time.monotonic(), "", set[str]()

    def tell(what: str) -> None:
        if what not in told:
            told.add(what)
            print(f"{what}: {last!r} (told once)", flush=True)

    while True:
        if time.monotonic() - heard > SILENT:
            if last:
                tell(f"no range for {SILENT:g} s, the last line")
            ask_for_ranges(port)
            heard = time.monotonic()
        if not select.select([port], [], [], 0.5)[0]:
            continue
        data = os.read(port, 4096)
        if not data:
            return
        for since, line in lines.add(time.time_ns(), data):
            last = line or last
            try:
                found = ranges_in(line)
            except ValueError as error:
                tell(f"a line that cannot be read, {error}")
                continue
            for anchor, r in found:
                heard = time.monotonic()
                if math.isfinite(r) and r > 0.0:
                    yield since, anchor, r


def topics_of(topics: list[str]) -> dict[str, str]:
    """Return which topic is whose: by the last part of its name, with and without what all the last parts begin with.

    The anchors' names are in capitals; where two topics could have one name, the one with less left out has it.
    """
    parts = [topic.rsplit("/", 1)[-1].upper() for topic in topics]
    found: dict[str, str] = {}
    for k in range(max(map(len, parts))):
        if len({part[:k] for part in parts}) == 1:
            for part, topic in zip(parts, topics, strict=True):
                found.setdefault(part[k:], topic)
    found.pop("", None)
    return found


def main(map_file: str, port_name: str) -> None:
    """Publish until the port is closed or Ctrl-C."""
    import rclpy
    from rclpy.signals import SignalHandlerOptions
    from sensor_msgs.msg import Range

    with open(map_file, encoding="utf-8") as file:
        topics = yaml.safe_load(file)["ranges"]["topics"]
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # signals end this process as any other
    node = rclpy.create_node("ranges")
    publishers = {topic: node.create_publisher(Range, topic, 10) for topic in topics}
    names = topics_of(topics)
    strangers = set[str]()
    for stamp, anchor, r in ranges_of(open_port(port_name)):  # it ends when the tag is unplugged
        topic = names.get(anchor.upper())
        if topic is None:
            if anchor not in strangers:
                strangers.add(anchor)
                print(f"{anchor}: {r:.2f} m, but {map_file} has no topic that ends with it", flush=True)
            continue
        message = Range(radiation_type=Range.INFRARED, min_range=0.0, max_range=100.0, range=r)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        message.header.frame_id = anchor
        publishers[topic].publish(message)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("usage: range_node.py MAP.yaml PORT")
    try:
        main(*sys.argv[1:])
    except KeyboardInterrupt:
        sys.exit(0)
    except ImportError as error:
        sys.exit(f"range_node.py: {error}: source ROS 2, or install the extra ros2")
    except OSError as error:
        sys.exit(f"range_node.py: {error}")
