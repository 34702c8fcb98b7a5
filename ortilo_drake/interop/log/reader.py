"""Reading a log back: as the Dataset of its flight, or tick by tick for a replay."""

import json
from collections.abc import Iterable, Iterator
from itertools import groupby
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import xarray as xr

from ortilo_drake.flight.flight import flight_dataset
from ortilo_drake.flight.lost import find_loss
from ortilo_drake.flight.saved_flight import LARGEST
from ortilo_drake.flight.signals import Signals, output_sizes
from ortilo_drake.interop.log.mcap_records import LoggedMessage, read_logged
from ortilo_drake.interop.ros.ros_messages import ARRAY_TYPE, FORMAT, SCENARIO_TOPIC, SENT, SIGNAL_PREFIX, STRING_TYPE
from ortilo_drake.interop.ros.ros_motion import GOAL_TOPIC, GOAL_TYPE
from ortilo_drake.interop.ros.ros_sensors import IMAGE_TOPIC, IMAGE_TYPE, image_of
from ortilo_drake.interop.ros.ros_types import from_cdr
from ortilo_drake.model.input_files import MIB, exists
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario
from ortilo_drake.scenario.scenario import scenario_from_json

TICK_LIMIT: Final = 64 * MIB  # limit of the messages of a tick; a 4K picture takes 33 MiB
MISSING_LIMIT: Final = 256 * MIB  # limit of the rows of ticks missing in a log, 50 minutes at 30 Hz


class LoggedTick(NamedTuple):
    """One tick of a log: k, the true state x (12) or None if unknown, the messages, and the recorded outputs."""

    k: int
    state: np.ndarray | None
    messages: Signals
    outputs: Signals


def log_file(path: Path) -> Path:
    """Return the MCAP file of a log's folder, or the path itself if it is a file; InputError if there is none."""
    if not exists(path):
        raise InputError(f"{path}: no such log")
    if not path.is_dir():
        return path
    files = sorted(path.glob("*.mcap"))
    if len(files) != 1:
        raise InputError(
            f"{path}: not a log: holds {len(files)} .mcap files, not one; `ortilo replay --map MAP.yaml` "
            "reads other recordings (docs/how_to/recorded.md)"
        )
    return files[0]


def _description(path: Path) -> dict[str, Any]:
    """Return the content of /ortilo/scenario: format, software, scenario; InputError if the log begins otherwise."""
    first = next(read_logged(path, lambda topic: True), None)
    if first is None:
        raise InputError(f"{path}: empty or cut off before its scenario")
    try:
        if (first.topic, first.type_name) != (SCENARIO_TOPIC, STRING_TYPE):
            raise ValueError
        description = json.loads(from_cdr(STRING_TYPE, first.data).data)
        found = description["format"]
        _ = json.loads(description["scenario"]), str(description["software"])
    except Exception:  # a foreign message may be wrong in any way
        raise InputError(f"{path}: not a log of ortilo-drake: does not begin with {SCENARIO_TOPIC}") from None
    if found != FORMAT:
        raise InputError(f"{path}: a log of format {found}, this version reads format {FORMAT}")
    return description


def log_scenario(path: Path) -> Scenario:
    """Return the scenario that a log was flown with; InputError if the file is no log of ours."""
    file = log_file(path)
    description = _description(file)
    return scenario_from_json(description["scenario"], description.get("scenario_format"), str(file))


def holds_what_was_sent(path: Path) -> bool:
    """Return whether a log holds the messages that a world sent in real time; InputError if it is no log of ours.

    Such a log does not say whether and when the onboard half received them.
    """
    return _description(log_file(path)).get("messages") == SENT


def _decode(file: Path, message: LoggedMessage) -> tuple[str, np.ndarray]:
    try:
        if message.topic == IMAGE_TOPIC and message.type_name == IMAGE_TYPE:
            return "image", image_of(from_cdr(IMAGE_TYPE, message.data).data)
        if (message.topic, message.type_name) == (GOAL_TOPIC, GOAL_TYPE):
            p_W = from_cdr(GOAL_TYPE, message.data).pose.position
            return "goal", np.array([p_W.x, p_W.y])
        if message.type_name == ARRAY_TYPE:
            return message.topic.removeprefix(SIGNAL_PREFIX), np.array(from_cdr(ARRAY_TYPE, message.data).data)
    except Exception as error:  # the decoders raise errors of many kinds
        raise InputError(f"{file}: {message.topic}: cannot be decoded: {error}") from None
    raise InputError(f"{file}: {message.topic}: is of type {message.type_name or 'unknown'}")


def _bounded(file: Path, k: int, messages: Iterable[LoggedMessage]) -> Iterator[LoggedMessage]:
    """Yield a tick's messages; InputError if they exceed TICK_LIMIT, as where all messages have the same log time."""
    size = 0
    for message in messages:
        size += len(message.data)
        if size > TICK_LIMIT:
            raise InputError(f"{file}: tick {k}: holds more than {TICK_LIMIT / MIB:g} MiB")
        yield message


def read_ticks(path: Path, images: bool = True) -> Iterator[LoggedTick]:
    """Yield the ticks of a log in order, with or without images; a log that a kill cut short ends at the cut.

    InputError if there is no such log, if it is not ours or damaged, or if its log times do not rise.
    """
    file, scenario = log_file(path), log_scenario(path)
    sizes = output_sizes(scenario.measurement)

    def wanted(topic: str) -> bool:
        if topic in (IMAGE_TOPIC, SCENARIO_TOPIC):
            return images and topic == IMAGE_TOPIC
        return topic == GOAL_TOPIC or topic.startswith(SIGNAL_PREFIX)

    before = -1
    for log_time, group in groupby(read_logged(file, wanted), key=lambda message: message.log_time):
        k = round(log_time * 1e-9 * scenario.control_rate)
        if k <= before:
            raise InputError(f"{file}: tick {k} after tick {before}: log times must rise")
        before = k
        signals = dict(_decode(file, message) for message in _bounded(file, k, group))
        state = signals.pop("state", None)
        outputs = {name: signals.pop(name) for name in sizes if name in signals}
        outputs = {name: value for name, value in outputs.items() if not np.isnan(value).all()}  # NaN: never received
        yield LoggedTick(k, state, signals, outputs)


def read_messages(path: Path) -> Iterator[tuple[int, Signals, Signals]]:
    """Yield (k, messages to the onboard half, its outputs) of every tick; see read_ticks."""
    for tick in read_ticks(path):
        yield tick.k, tick.messages, tick.outputs


def read_log(path: Path) -> xr.Dataset:
    """Return a log as the Dataset of flight.fly for the same flight, without `player` and `real_time_factor`.

    A log that a kill cut short gives the ticks before the cut. Ticks that the log lacks are NaN. The truth is NaN in
    the log of an onboard half, which does not know it. A loss is found from the true states in the log. InputError as
    in read_ticks; also if the log has no tick, or its flight would fill the memory.
    """
    file = log_file(path)
    description, scenario = _description(file), log_scenario(file)
    sizes = scenario.measurement.logged_sizes()
    ticks: list[tuple[int, Signals]] = []
    for tick in read_ticks(file, images=False):
        signals = tick.outputs if tick.state is None else tick.outputs | {"state": tick.state}
        for name, value in signals.items():
            if value.shape != (sizes[name],):
                raise InputError(f"{file}: {SIGNAL_PREFIX}{name}: has {value.size} numbers, not {sizes[name]}")
        ticks.append((tick.k, signals))
        # A flight may fill the memory, with its ticks or with ticks missing between its log times.
        row, missing = 8 * sum(sizes.values()), tick.k + 1 - len(ticks)
        if (tick.k + 1) * row > LARGEST or missing * row > MISSING_LIMIT:
            most = f"{LARGEST / MIB:g} MiB, {MISSING_LIMIT / MIB:g} of them of missing ticks"
            raise InputError(f"{file}: tick {tick.k}, of which {missing} are missing: at most {most}, are read")
    if not ticks:
        raise InputError(f"{file}: cut off before its first tick")
    logged = np.full((ticks[-1][0] + 1, sum(sizes.values())), np.nan)
    starts = dict(zip(sizes, np.cumsum([0, *sizes.values()]).tolist(), strict=False))
    for k, signals in ticks:
        for name, value in signals.items():
            logged[k, starts[name] : starts[name] + sizes[name]] = value
    known = [k for k, signals in ticks if "state" in signals]
    lost = find_loss(logged[known, : sizes["state"]], scenario.h, scenario.load_room(), scenario.vehicle)
    if lost is not None:
        k = known[lost.tick]
        lost = type(lost)(k, k * scenario.h, lost.cause)
        logged = logged[: k + 1]
    flight = flight_dataset(scenario, np.arange(len(logged)) * scenario.h, logged, lost)
    flight.attrs["software"] = description["software"]
    return flight
