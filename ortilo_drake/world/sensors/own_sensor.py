"""A sensor of one's own given by its compiled share (model/parts.py, Compiled): a function of true state and noise.

If it is faster than the tick, its samples are made as the imu's (world/sensors/imu.py).
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.clock import tick_of
from ortilo_drake.model.parts import Compiled
from ortilo_drake.model.placing import fill, put, sample_of
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import ARRIVED, PAYLOAD, STAMP, size_of_samples
from ortilo_drake.scenario import Scenario
from ortilo_drake.world.noise import put_normals, stream_id
from ortilo_drake.world.sensors.samples import passed_at, rows_of, sample_time, seed_of_sample


@lru_cache(maxsize=64)
def compiled_sensor_out(measure: Callable[..., np.ndarray]) -> tuple[Callable[..., None], Callable[..., None]]:
    """Return the element functions that make a sensor's message of one sample, and of several, by `measure`."""

    @register_jitable
    def put_sample(sample: np.ndarray, numbers: Any, state: np.ndarray, v: np.ndarray, t: float) -> None:
        """Write [1, t, payload] measured at a state (12), nothing if the sensor gives nothing."""
        payload = measure(numbers, state, v, t)
        if payload.size > 0:
            if payload.size != sample.size - PAYLOAD:
                raise ValueError("returns another number of values than its payload has")
            sample[ARRIVED], sample[STAMP] = 1.0, t
            put(payload, sample, PAYLOAD)

    def say(
        numbers: Any, n: Any, k: int, seed: int, sent: np.ndarray, state: np.ndarray, v: np.ndarray, out: np.ndarray
    ) -> None:
        """Output [1, t_k, payload] in a tick in which it is sent, zeros if it is not or the sensor gives nothing."""
        fill(out, 0.0)
        if sent[0] >= 0.0:
            put_normals(v, seed, n.stream, k)
            put_sample(out, numbers, state, v, k * n.h)

    def say_samples(
        numbers: Any,
        n: Any,
        k: int,
        sent: np.ndarray,
        seeds: np.ndarray,
        state: np.ndarray,
        passed: np.ndarray,
        rows: np.ndarray,
        v: np.ndarray,
        out: np.ndarray,
    ) -> None:
        """Output the samples of a tick in which they are sent, the oldest first, else zeros."""
        fill(out, 0.0)
        count = rows.size + 1
        if sent[0] < 0.0:
            return
        for i in range(1 if k > 0 else count, count + 1):
            t, sample = sample_time(k, i, count, n.h), sample_of(out, i - 1, count)
            x = state if i == count else passed_at(passed, rows[i - 1])[0]
            put_normals(v, seed_of_sample(seeds, k, i, count), n.stream, tick_of(t, n.h / count))
            put_sample(sample, numbers, x, v, t)
            if sample[ARRIVED] != 0.0:
                out[ARRIVED], out[STAMP] = 1.0, t

    return say, say_samples


def own_sensor_box(name: str, share: Compiled, scenario: Scenario, room: Room) -> Box:
    """Return a compiled sensor's box: it reads `sent` (1), not negative where it is sent, and the state (12).

    If it is faster than the tick, it also reads what was `passed` inside the tick before, see vehicle/continuous.py.
    """
    samples, size = scenario.samples(name), PAYLOAD + share.payload
    element = Element("own_sensor", out=compiled_sensor_out(share.measure)[samples > 1], allocates=True, checked=True)
    given = Values({"stream": stream_id(name), "h": scenario.h})
    if samples > 1:
        given = given.updated(Values(tables={"rows": rows_of(samples, scenario.instants)}))
        size = size_of_samples(size, samples)
    box = Box(name, element, size, given, {"v": (share.noises,)})
    return box.with_groups(numbers=share.numbers(scenario.sampled_for(name), room))
