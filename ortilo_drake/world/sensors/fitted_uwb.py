"""UWB ranging with errors fitted to recordings: the element of fitted_errors.py's equations.

g_i goes on in every tick. In a tick in which a message is sent, each range is missing with the same probability, and
the outliers' chain of its anchor goes on if it is not.
"""

from typing import Any

import numpy as np
from scipy.special import ndtr

from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import PAYLOAD, uwb_size
from ortilo_drake.scenario import Uwb
from ortilo_drake.scenario.range_errors import UwbNoise, white_scales
from ortilo_drake.world.drawn_truth import AtStart
from ortilo_drake.world.noise import put_normals, stream_id, uniforms
from ortilo_drake.world.sensors.fitted_errors import (
    Day,
    draw_day,
    drawn_scales,
    growth,
    odd_after,
    outlier_chain,
    row_error,
)
from ortilo_drake.world.sensors.matern_field import FEATURES, field_at
from ortilo_drake.world.sensors.uwb import put_uwb_message, ranging_settings, walls_between
from ortilo_drake.world.slow_error import SlowNoise, gauss_markov, slow_noise_after

LASTING, CHANCES, ODD = "fitted/lasting", "fitted/chances", "fitted/outliers"  # streams
TAILS = "fitted/tails"


def fitted_out(
    n: Any,
    k: int,
    seed: int,
    sent: np.ndarray,
    state: np.ndarray,
    anchors: np.ndarray,
    bias: np.ndarray,
    walls: np.ndarray,
    constants: np.ndarray,
    frequencies: np.ndarray,
    phases: np.ndarray,
    amplitudes: np.ndarray,
    scales: np.ndarray,
    g: np.ndarray,
    odd: np.ndarray,
    v: np.ndarray,
    out: np.ndarray,
) -> None:
    """Output the uwb message in a tick in which it is sent, else zeros; none of its ranges is below 0."""
    fill(out, 0.0)
    if sent[0] < 0.0:
        return
    count = constants.size
    fill(v, 0.0)
    put_uwb_message(out, v, state, anchors, bias, walls, n.settings, k * n.h)
    put_normals(v, seed, n.stream, k)
    chance = uniforms(seed, n.chances, k, 2 * count)
    s = growth(state[2] - n.floor, n.near_floor)
    scale = drawn_scales(scales, seed, n.tails, k, count)
    for i in range(count):
        if out[PAYLOAD + count + i] == 0.0:
            continue
        if chance[i] < n.missing:
            out[PAYLOAD + i] = 0.0
            out[PAYLOAD + count + i] = 0.0
            continue
        far, white = (n.far, n.white) if odd[i] != 0.0 else (0.0, n.white * scale[i])
        own = g[i] + field_at(frequencies[i], phases[i], amplitudes[i], state)
        out[PAYLOAD + i] = max(out[PAYLOAD + i] + row_error(constants[i], own, s, white, far, v[i]), 0.0)


def fitted_step(
    n: Any, k: int, seed: int, sent: np.ndarray, a: np.ndarray, q: np.ndarray, g: np.ndarray, odd: np.ndarray
) -> None:
    """Advance the slow errors to the next tick, and the outliers to the next message."""
    put(slow_noise_after(g, a, q, seed, n.lasting, k * n.h, n.h), g)
    if sent[0] < 0.0:
        return
    chance = uniforms(seed, n.chances, k, 2 * odd.size)
    for i in range(odd.size):
        if chance[i] >= n.missing:
            odd[i] = 1.0 if odd_after(odd[i] != 0.0, chance[odd.size + i], n.begins, n.ends) else 0.0


FITTED = Element("fitted_uwb", out=fitted_out, step=fitted_step, allocates=True)


def fitted_box(settings: Uwb, room: Room, h: float) -> Box:
    """Return the receiver; as uwb_box, it reads `sent` (1) and the true state (12).

    What a seed draws (constants, fields, the first slow errors) is zero until it is drawn.
    """
    noise, n = noise_of(settings), len(room.anchors)
    given = given_of(noise, settings, room, lasting_of(noise, n, h), h, noise.outliers.share, (CHANCES, LASTING))
    given = given.updated(Values({"white": noise.white}))
    return Box("uwb", FITTED, uwb_size(n), given, {"v": (n,)})


def given_of(
    noise: UwbNoise, settings: Uwb, room: Room, lasting: SlowNoise, h: float, share: float, streams: tuple[str, str]
) -> Values:
    """Return the numbers, tables and states that fitted ranges and differences share; what a seed draws is zero.

    The noise is that of single ranges, `lasting` the process of the slow errors g, the share that of the rows that are
    outliers; the two streams are of the rows' chances and of the slow errors.
    """
    begins, ends = outlier_chain(share, noise.outliers.burst)
    numbers = {"settings": ranging_settings(settings), "far": noise.outliers.sd, "begins": begins, "ends": ends}
    numbers |= {"missing": noise.missing, "near_floor": noise.near_floor, "floor": float(room.interior.min[2]), "h": h}
    numbers |= {name: stream_id(stream) for name, stream in zip(("chances", "lasting"), streams, strict=True)}
    numbers["tails"] = stream_id(TAILS)
    zero = np.zeros(len(room.anchors))
    tables = {"anchors": room.anchor_positions, "bias": zero, "walls": walls_between(settings, room), "constants": zero}
    fields = np.zeros((zero.size, 0 if noise.field is None else FEATURES, 3))
    tables |= {"frequencies": fields, "phases": fields[..., 0], "amplitudes": fields[..., 0]}
    tables["scales"] = white_scales(noise.freedom)
    tables |= {"a": lasting.a, "q": lasting.q}
    return Values(numbers | {"stream": stream_id("uwb")}, {"g": zero.copy(), "odd": zero.copy()}, tables)


def fitted_drawn(settings: Uwb, n: int, h: float, draw: AtStart) -> Values:
    """Return the values given to the box of n anchors in a flight of these draws."""
    noise = noise_of(settings)
    day = draw_day(noise, n, draw)
    start = {"g": lasting_of(noise, n, h).start * draw(LASTING, n)}
    start["odd"] = (ndtr(draw(ODD, n)) < noise.outliers.share).astype(float)
    return Values(start=start, tables={"constants": day.constants} | field_tables(day))


def noise_of(settings: Uwb) -> UwbNoise:
    """Return the errors of single ranges that a scenario's uwb has, of those that were fitted."""
    assert settings.fitted is not None
    return settings.fitted.of_single_ranges


def lasting_of(noise: UwbNoise, n: int, h: float) -> SlowNoise:
    """Return the process of the slow errors g of n anchors."""
    time, sd = (1.0, 0.0) if noise.lasting is None else (noise.lasting.time, noise.lasting.sd)
    return gauss_markov(np.full(n, sd), time, h)


def field_tables(day: Day) -> dict[str, np.ndarray]:
    """Return the tables of a day's fields; none if it has none."""
    if not day.fields:
        return {}
    w, u, amplitude = (np.array(part) for part in zip(*day.fields, strict=True))
    return {"frequencies": w, "phases": u, "amplitudes": amplitude}
