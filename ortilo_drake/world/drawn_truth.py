"""The true values of one simulated world: the scenario's `truth` with its spreads drawn by one seed."""

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from ortilo_drake.model.room import Room
from ortilo_drake.model.typed_yaml import Frozen, InputError
from ortilo_drake.scenario.truth import Each, SensorTruth, Truth
from ortilo_drake.world.noise import normals, stream_id

Drawn = dict[str, np.ndarray]  # by dotted key within `truth`, such as 'vehicle.mass_factor'
AtStart = Callable[[str, int], np.ndarray]  # (stream's name, n) -> the stream's first n standard normal numbers

LEAST_FACTOR = 0.1  # smallest drawn value of a factor


def of_seed(seed: int) -> AtStart:
    """Return the function that gives the numbers of a seed's streams."""
    return lambda name, n: normals(seed, stream_id(name), 0, n)


def draw_truth(truth: Truth, seed: int | AtStart, room: Room, payloads: Mapping[str, int]) -> Drawn:
    """Return value + sd n for every entry that has a spread, n standard normal, as a function of seed and key.

    Each entry has its own noise stream, so a draw does not change when another entry does. An entry for each anchor,
    landmark or payload number has a row for each. A clock's entries are drawn for each sensor: 'clock.offset.uwb'.

    `seed` is the seed of all noise, or the function that gives the normal numbers; `payloads` maps each sensor that
    flies to the size of its payload. InputError if a registered sensor's entries do not fit its payload.
    """
    draw = seed if callable(seed) else of_seed(seed)
    drawn = {}
    for group in Truth.model_fields:
        if group == "sensors":
            continue
        settings = getattr(truth, group)
        for name, value, sd in _entries(settings):
            key, marks = f"{group}.{name}", type(settings).model_fields[name].metadata
            each = tuple(len(getattr(room, mark.things)) for mark in marks if isinstance(mark, Each))
            for its in (f"{key}.{sensor}" for sensor in payloads) if group == "clock" else (key,):
                drawn[its] = _draw(its, value, sd, (*each, *np.shape(value)), draw)
    for sensor, settings in dict(truth.sensors).items():
        if sensor not in payloads:
            continue
        check_size(sensor, settings, payloads[sensor])
        for name, value, sd in _entries(settings):
            key, nothing = f"sensors.{sensor}.{name}", 1.0 if name == "factor" else 0.0
            drawn[key] = _draw(key, value if len(value) else nothing, sd, (payloads[sensor],), draw)
    return drawn


def check_size(sensor: str, settings: SensorTruth, payload: int) -> None:
    """Raise InputError if an entry of a registered sensor is not as long as its payload."""
    for name, value in settings:
        if isinstance(value, tuple) and len(value) not in (0, payload):
            raise InputError(
                f"truth.sensors.{sensor}.{name}: {list(value)}: must have {payload} numbers, as its payload has"
            )


def _entries(settings: Frozen) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Yield name, value and sd of the entries that have a spread beside them."""
    fields = type(settings).model_fields
    for name in fields:
        if f"{name}_sd" in fields:
            yield name, np.array(getattr(settings, name)), np.array(getattr(settings, f"{name}_sd"))


def _draw(key: str, value: np.ndarray | float, sd: np.ndarray, shape: tuple[int, ...], draw: AtStart) -> np.ndarray:
    v = draw(f"truth/{key}", int(np.prod(shape))).reshape(shape)
    drawn = value + (sd if np.size(sd) else 0.0) * v
    return np.maximum(drawn, LEAST_FACTOR) if key.endswith("factor") else drawn
