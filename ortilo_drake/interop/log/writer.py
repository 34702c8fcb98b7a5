"""Writing a flight tick by tick, as a rosbag2 folder with one MCAP file."""

import json
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO

import numpy as np
import yaml

from ortilo_drake import __version__
from ortilo_drake.flight.files import write_text
from ortilo_drake.flight.signals import Signals
from ortilo_drake.interop.log.logged_map import RANGES, logged_map
from ortilo_drake.interop.ros.ros_messages import LATCHED, TAKEN, blank_messages, start_messages, tick_messages
from ortilo_drake.interop.ros.ros_types import RosMessage, definition, to_cdr, to_ns, typestore
from ortilo_drake.model.optional import EXTRAS, check_installed, later
from ortilo_drake.model.signals import N_X, STATE_NAMES
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario

_NO_TIME = {"sec": 0, "nsec": 0}


def quality_of_service(topic: str) -> list[dict[str, Any]]:
    """Return a topic's quality of service: reliable, and transient local (kept for later readers) if sent only once."""
    return [
        {
            "history": "keep_last",
            "depth": 1 if topic in LATCHED else 10,
            "reliability": "reliable",
            "durability": "transient_local" if topic in LATCHED else "volatile",
            "deadline": dict(_NO_TIME),
            "lifespan": dict(_NO_TIME),
            "liveliness": "automatic",
            "liveliness_lease_duration": dict(_NO_TIME),
            "avoid_ros_namespace_conventions": False,
        }
    ]


def bag_metadata(file: str, topics: dict[str, str], counts: dict[str, int], end: int) -> str:
    """Return the metadata.yaml of a rosbag2 folder, version 9 (ROS 2 Jazzy); its messages span 0 to `end` [ns]."""
    times = {"duration": {"nanoseconds": end}, "starting_time": {"nanoseconds_since_epoch": 0}}
    total = sum(counts.values())
    information = {
        "version": 9,
        "storage_identifier": "mcap",
        "relative_file_paths": [file],
        **times,
        "message_count": total,
        "topics_with_message_count": [
            {
                "topic_metadata": {
                    "name": topic,
                    "type": type_name,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": quality_of_service(topic),
                    "type_description_hash": typestore().hash_rihs01(type_name),
                },
                "message_count": counts[topic],
            }
            for topic, type_name in topics.items()
        ],
        "compression_format": "",
        "compression_mode": "",
        "files": [{"path": file, **times, "message_count": total}],
        "custom_data": None,
        "ros_distro": "jazzy",
    }
    plain = json.loads(json.dumps({"rosbag2_bagfile_information": information}))  # copies: YAML would write aliases
    return yaml.safe_dump(plain, sort_keys=False)


mcap = later("mcap.writer")

KEEP_EVERY = 0.5  # a kill loses at most the last ticks of this time [s of flight]
_ONE_CHUNK = 2**40  # so large that only write_tick ends chunks, at whole ticks


class LogWriter:
    """A log that is being written: `with LogWriter(path, scenario) as log: log.write_tick(...)`.

    A path NAME gives the folder NAME, which must not exist, with NAME.mcap and, once the log is closed, metadata.yaml.
    rosbags, ros2 bag and Foxglove open such a folder. With ranges and imu there is also a map.yaml for the command
    `ortilo replay --map`. Every half second of flight goes to the file as one chunk, so a killed process loses at most
    half a second, and read_log reads the rest. A loss of power may lose more: nothing is synced to disk. Log times are
    t_k from the start of the flight [ns], not dates. `messages` says what write_tick is given: ros_messages.TAKEN,
    messages that the onboard half received, or SENT, messages that a world sent in real time.

    InputError on entering or writing, if the folder exists or cannot be written, or the scenario has no path.
    """

    def __init__(self, path: Path, scenario: Scenario, messages: str = TAKEN):
        self.path, self._messages = path, messages
        self._scenario, self._room = scenario, scenario.load_room()
        self._keep_every = max(1, round(KEEP_EVERY * scenario.control_rate))
        self._last, self._kept = -1, -1
        self._start: tuple[list[float], float] | None = None
        self._topics: dict[str, str] = {}
        self._counts: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._ranges: list[float] = []
        self._schemas: dict[str, int] = {}
        self._file: BinaryIO
        self._writer: Any

    @property
    def file(self) -> Path:
        """The path of the MCAP file."""
        return self.path / f"{self.path.name}.mcap"

    def __enter__(self) -> "LogWriter":
        if self.path.suffix == ".mcap":
            raise InputError(f"{self.path}: a log is a folder: give its name without .mcap")
        for package in ("mcap", "rosbags", "zstandard"):
            check_installed(package, EXTRAS[package])
        first = start_messages(self._scenario, self._room, self._messages)
        for state in (np.zeros(N_X), None):  # compiled before the first tick
            for _, type_name, fields in blank_messages(self._scenario, self._room, state):
                to_cdr(type_name, fields)
        try:
            self.path.mkdir(parents=True)
            self._file = self.file.open("xb")
        except FileExistsError:
            raise InputError(f"{self.path}: exists, a log is never overwritten") from None
        except OSError as error:
            raise self._not_written(error) from None
        self._writer = mcap.Writer(self._file, chunk_size=_ONE_CHUNK, compression=mcap.CompressionType.ZSTD)
        try:
            self._writer.start(profile="ros2", library=f"ortilo-drake {__version__}")
            for message in first:
                self._write(message, 0)
            self._writer.flush()
        except OSError as error:
            self._file.close()
            raise self._not_written(error) from None
        return self

    def write_tick(self, k: int, state: np.ndarray | None, messages: Signals, outputs: Signals) -> None:
        """Write tick k; ticks must come in ascending order.

        `state` is the true x (12), None if unknown. `messages` went to the onboard half: message vectors by port,
        'image' (height, width, 4), and 'goal' (2), the target in W of the flight from now on [m]. `outputs` are the
        onboard half's signals: control, y, delta, V2, estimate, covariance, reference. InputError if the file cannot be
        written, ValueError if k does not ascend.
        """
        if k <= self._last:
            raise ValueError(f"tick {k} after tick {self._last}")
        if k == 0 and (estimate := outputs.get("estimate")) is not None:
            self._start = estimate[:3].tolist(), float(estimate[STATE_NAMES.index("psi")])
        self._last, t = k, k * self._scenario.h
        log_time = to_ns(t)
        for message in tick_messages(t, state, messages, outputs, self._scenario, self._room):
            self._write(message, log_time)
        if k - self._kept >= self._keep_every:
            self._kept = k
            try:
                self._writer.flush()
            except OSError as error:
                raise self._not_written(error) from None

    def _write(self, message: RosMessage, log_time: int) -> None:
        topic, type_name, fields = message
        channel = self._channels.get(topic)
        if channel is None:
            channel = self._channels[topic] = self._open_channel(topic, type_name)
        self._writer.add_message(channel, log_time, to_cdr(type_name, fields), log_time)
        self._counts[topic] += 1
        if topic.startswith(RANGES):
            self._ranges.append(fields["range"])

    def _open_channel(self, topic: str, type_name: str) -> int:
        if type_name not in self._schemas:
            text = definition(type_name).encode()
            self._schemas[type_name] = self._writer.register_schema(type_name, "ros2msg", text)
        self._topics[topic], self._counts[topic] = type_name, 0
        offered = yaml.safe_dump(quality_of_service(topic))
        return self._writer.register_channel(topic, "cdr", self._schemas[type_name], {"offered_qos_profiles": offered})

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the log, also after an error: written ticks stay; a log without ticks is removed after an error."""
        if error is not None and self._last < 0:
            self._file.close()
            self.file.unlink()
            self.path.rmdir()
            return
        try:
            with self._file:
                text = bag_metadata(
                    self.file.name, self._topics, self._counts, to_ns(max(0, self._last) * self._scenario.h)
                )
                self._writer.flush()
                self._writer.add_metadata("rosbag2", {"serialized_metadata": text})
                self._writer.finish()
            write_text(self.path / "metadata.yaml", text)
            if ranging := logged_map(self._scenario, self._room, self._topics, np.array(self._ranges), self._start):
                write_text(self.path / "map.yaml", ranging)
        except (OSError, InputError) as failure:
            if error is None:
                raise (failure if isinstance(failure, InputError) else self._not_written(failure)) from None

    def _not_written(self, error: OSError) -> InputError:
        return InputError(f"{self.path}: cannot be written: {error.strerror or error}")
