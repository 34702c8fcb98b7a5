"""Ranges of a DWM1001 tag at a serial port, as topics of ROS 2 for `ortilo hil bridge --from ros2`.

    python examples/companion/range_node.py MAP.yaml /dev/ttyACM0

The map's `ranges.topics` end with the anchors' addresses, /uwb/a0CA8 (ROS allows no name that begins with a digit). A
range is stamped when the first byte of its line
arrives. Another tag needs another `ranges_in`; the rest stays.
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

from ortilo_drake.interop.recorded.lec_console import ranges_in

SPEED = termios.B115200  # of a DWM1001; its USB port takes any
SILENT = 3.0  # without a range, the tag is asked for them [s]


def open_port(name: str) -> int:
    """Return a descriptor of a serial port that gives bytes as they come."""
    port = os.open(name, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(port)
    *flags, _, _, characters = termios.tcgetattr(port)
    termios.tcsetattr(port, termios.TCSANOW, [*flags, SPEED, SPEED, characters])
    return port


class Lines:
    """Lines cut from bytes as they come, each with the time at which its first byte came [ns]."""

    def __init__(self) -> None:
        self._rest, self._since = b"", 0

    def add(self, now: int, data: bytes) -> Iterator[tuple[int, str]]:
        """Yield time and text of each line that these bytes, received now [ns], end."""
        *ended, rest = (self._rest + data).split(b"\n")
        since = self._since if self._rest else now
        for line in ended:
            yield since, line.decode("ascii", "replace").strip()
            since = now
        self._rest, self._since = rest, since


def ask_for_ranges(port: int) -> None:
    """Send what makes a DWM1001 print ranges: two returns open its shell, `lec` starts them, and would stop them."""
    os.write(port, b"\r\r")
    time.sleep(1.0)
    os.write(port, b"lec\r")


def ranges_of(port: int) -> Iterator[tuple[int, str, float]]:
    """Yield time of arrival [ns], anchor's address and range [m] of each measurement, until the port is closed."""
    lines, heard = Lines(), time.monotonic()
    while True:
        if time.monotonic() - heard > SILENT:
            ask_for_ranges(port)
            heard = time.monotonic()
        if not select.select([port], [], [], 0.5)[0]:
            continue
        data = os.read(port, 4096)
        if not data:
            return
        for since, line in lines.add(time.time_ns(), data):
            try:
                found = ranges_in(line)[1]
            except ValueError:  # cut short
                continue
            for anchor, _, r in found:
                heard = time.monotonic()
                if math.isfinite(r) and r > 0.0:
                    yield since, anchor.upper(), r


def main(map_file: str, port_name: str) -> None:
    """Publish until the port is closed or Ctrl-C."""
    import rclpy
    from rclpy.signals import SignalHandlerOptions
    from sensor_msgs.msg import Range

    with open(map_file, encoding="utf-8") as file:
        topics = yaml.safe_load(file)["ranges"]["topics"]
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)  # signals end this process as any other
    node = rclpy.create_node("ranges")
    publishers = {topic[-4:].upper(): node.create_publisher(Range, topic, 10) for topic in topics}
    strangers = set[str]()
    for stamp, anchor, r in ranges_of(open_port(port_name)):  # it ends when the tag is unplugged
        if anchor not in publishers:
            if anchor not in strangers:
                strangers.add(anchor)
                print(f"{anchor}: {r:.2f} m, but {map_file} has no topic that ends with it", flush=True)
            continue
        message = Range(radiation_type=Range.INFRARED, min_range=0.0, max_range=100.0, range=r)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        message.header.frame_id = anchor
        publishers[anchor].publish(message)


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
