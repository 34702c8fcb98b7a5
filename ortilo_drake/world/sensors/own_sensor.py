"""A sensor of one's own given by its compiled share (model/parts.py, Compiled): a function of true state and noise."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.parts import Compiled
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import ARRIVED, PAYLOAD, STAMP
from ortilo_drake.scenario import Scenario
from ortilo_drake.world.noise import put_normals, stream_id


@lru_cache(maxsize=64)
def compiled_sensor_out(measure: Callable[..., np.ndarray]) -> Callable[..., None]:
    """Return the element function that makes a sensor's message from its compiled measurement."""

    def say(
        numbers: Any, n: Any, k: int, seed: int, sent: np.ndarray, state: np.ndarray, v: np.ndarray, out: np.ndarray
    ) -> None:
        """Output [1, t_k, payload] in a tick in which it is sent, zeros if it is not or the sensor gives nothing."""
        fill(out, 0.0)
        if sent[0] >= 0.0:
            put_normals(v, seed, n.stream, k)
            payload = measure(numbers, state, v, k * n.h)
            if payload.size > 0:
                if payload.size != out.size - PAYLOAD:
                    raise ValueError("returns another number of values than its payload has")
                out[ARRIVED], out[STAMP] = 1.0, k * n.h
                put(payload, out, PAYLOAD)

    return say


def own_sensor_box(name: str, share: Compiled, scenario: Scenario, room: Room) -> Box:
    """Return a compiled sensor's box: it reads `sent` (1), not negative where it is sent, and the state (12)."""
    element = Element("own_sensor", out=compiled_sensor_out(share.measure), allocates=True, checked=True)
    given = Values({"stream": stream_id(name), "h": scenario.h})
    box = Box(name, element, PAYLOAD + share.payload, given, {"v": (share.noises,)})
    return box.with_groups(numbers=share.numbers(scenario, room))
