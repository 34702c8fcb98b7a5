"""Differences of UWB ranges (TDoA): packets in turn, each a row of model/range_pairs.py.

The packets of a message are evenly spaced, the last one at its stamp. Each packet is of the next pair (a, b) in turn.
With its age s, p = p_WB - s v_WB and d_i = |p - p_WA_i|, its value is

    r_ab = f (d_b + e_b - (d_a + e_a) + sqrt(n_a^2 + n_b^2) v),   e_i = b_i + z g_i + z h_i(p)

with a constant b_i, first-order Gauss-Markov noise g_i and a field h_i of each anchor, a factor f, and v standard
normal. White errors have n_i = s_0 + s_1 d_i, z = 1 and no field. Fitted errors are those of fitted_uwb.py: z
multiplies n_i too, and a row is an outlier if one of its two ranges is, along the rows of anchor b. A row is missing if
an anchor is out of reach or behind a wall that blocks, and at random with the fitted probability.

v is drawn anew for each row. Successive rows share an anchor: their correlation would be -1/2 if all noise came from
the shared anchor's reception. In recorded flights of the `util_2021` kind it is -0.15, and it is left out here.
"""

from typing import Any

import numpy as np
from numba.extending import register_jitable
from scipy.special import ndtr

from ortilo_drake.loop.element import Box, Element, Values, group_of
from ortilo_drake.model.geometry.line_of_sight import walls_crossed
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.range_pairs import AGE, ROW, THERE, VALUE, A, B, differences_size, pairs_in_turn
from ortilo_drake.model.room import Room
from ortilo_drake.model.scalars import values_of
from ortilo_drake.model.signals import ARRIVED, PAYLOAD, STAMP
from ortilo_drake.scenario import Scenario
from ortilo_drake.scenario.noise_file import UwbNoise
from ortilo_drake.world.drawn_truth import AtStart
from ortilo_drake.world.faults.fault_element import distance_to
from ortilo_drake.world.noise import SlowNoise, gauss_markov, put_normals, slow_noise_after, uniforms
from ortilo_drake.world.sensors.fitted_uwb import (
    Day,
    draw_day,
    drawn_scales,
    field_at,
    given_of,
    growth,
    lasting_of,
    no_day,
    noise_of,
    odd_after,
    row_error,
    share_of_pairs,
)
from ortilo_drake.world.sensors.uwb import Receiver, receiver_of

LASTING, CHANCES, ODD = "differences/lasting", "differences/chances", "differences/outliers"  # streams


@register_jitable
def in_turn(n: Any, k: int, j: int, pairs: np.ndarray) -> np.ndarray:
    """Return the pair of row j of the message of tick k (2)."""
    return pairs[(k // n.every * n.rows + j) % pairs.shape[0]]


@register_jitable
def row_is_odd(n: Any, odd: np.ndarray, b: int, chance: np.ndarray, j: int) -> bool:
    """Return whether row j, of anchor b, is an outlier; unless the row is missing, advance the anchor's chain."""
    was = odd[b] != 0.0
    if chance[j] >= n.missing:
        odd[b] = 1.0 if odd_after(was, chance[n.rows + j], n.begins, n.ends) else 0.0
    return was


def differences_out(
    n: Any,
    k: int,
    seed: int,
    sent: np.ndarray,
    state: np.ndarray,
    receiver: Receiver,
    day: Day,
    scales: np.ndarray,
    pairs: np.ndarray,
    g: np.ndarray,
    odd: np.ndarray,
    follows: np.ndarray,
    v: np.ndarray,
    out: np.ndarray,
) -> None:
    """Output the message in a tick in which it is sent, else zeros."""
    fill(out, 0.0)
    if sent[0] < 0.0:
        return
    out[ARRIVED], out[STAMP] = 1.0, k * n.h
    put_normals(v, seed, n.stream, k)
    chance = uniforms(seed, n.chances, k, 2 * n.rows)
    put(odd, follows)
    scale = drawn_scales(scales, seed, n.tails, k, n.rows)
    for j in range(n.rows):
        pair, at = in_turn(n, k, j, pairs), PAYLOAD + ROW * j
        a, b = pair[0], pair[1]
        out[at + A], out[at + B] = a, b
        is_odd = row_is_odd(n, follows, b, chance, j)
        age = n.spacing * (n.rows - 1 - j)
        p = state[:3] - age * state[6:9]
        d_a, d_b = distance_to(p, receiver.anchors[a]), distance_to(p, receiver.anchors[b])
        reached = max(d_a, d_b) <= receiver.max_distance
        for i in pair:
            crossed = walls_crossed(values_of(p), values_of(receiver.anchors[i]), receiver.walls)
            reached = reached and crossed <= receiver.most_walls
        if not reached or chance[j] < n.missing:
            continue
        s = growth(p[2] - n.floor, n.near_floor)
        own = g[b] + field_at(day, b, p)
        own -= g[a] + field_at(day, a, p)
        s_0, s_1 = receiver.s_0, receiver.s_1
        white = np.sqrt((s_0 + s_1 * d_a) ** 2 + (s_0 + s_1 * d_b) ** 2)
        far = n.far if is_odd else 0.0
        white *= 1.0 if is_odd else scale[j]
        constant = receiver.bias[b] + day.constants[b] - receiver.bias[a] - day.constants[a]
        out[at + VALUE] = n.factor * (d_b - d_a + row_error(constant, own, s, white, far, v[j]))
        out[at + THERE], out[at + AGE] = 1.0, age


def differences_step(
    n: Any,
    k: int,
    seed: int,
    sent: np.ndarray,
    pairs: np.ndarray,
    a: np.ndarray,
    q: np.ndarray,
    g: np.ndarray,
    odd: np.ndarray,
) -> None:
    """Advance the slow errors to the next tick, and the outliers to the next message."""
    put(slow_noise_after(g, a, q, seed, n.lasting, k * n.h, n.h), g)
    if sent[0] < 0.0:
        return
    chance = uniforms(seed, n.chances, k, 2 * n.rows)
    for j in range(n.rows):
        row_is_odd(n, odd, in_turn(n, k, j, pairs)[1], chance, j)


DIFFERENCES = Element("uwb_differences", out=differences_out, step=differences_step, allocates=True)


def differences_box(scenario: Scenario, room: Room) -> Box:
    """Return the receiver: it reads `sent` (1), not negative where its message is sent, and the true state (12).

    The values that a seed draws are zero until they are drawn.
    """
    uwb, n, h, every = scenario.uwb, len(room.anchors), scenario.h, scenario.every("uwb")
    noise = noise_of(uwb) if uwb.errors == "fitted" else UwbNoise(white=0.0)
    rows, share = uwb.rows(h), share_of_pairs(noise.outliers.share)
    own = {"factor": 1.0, "spacing": every * h / rows, "rows": rows, "every": every}
    given = given_of(noise, room, _lasting(scenario, n), h, share, (CHANCES, LASTING))
    given = given.updated(Values(own, tables={"pairs": pairs_in_turn(uwb.pairs, n)}))
    box = Box("uwb", DIFFERENCES, differences_size(rows), given, {"follows": (n,), "v": (rows,)})
    return box.with_groups(receiver=receiver_of(uwb, room), day=no_day(noise, n))


def differences_drawn(scenario: Scenario, room: Room, draw: AtStart) -> Values:
    """Return the values of slow and constant errors that these draws give to the box in a flight."""
    n = len(room.anchors)
    start = {"g": _lasting(scenario, n).start * draw(LASTING, n), "odd": np.zeros(n)}
    if scenario.uwb.errors != "fitted":
        return Values(start=start)
    noise = noise_of(scenario.uwb)
    start["odd"] = (ndtr(draw(ODD, n)) < share_of_pairs(noise.outliers.share)).astype(float)
    return Values(start=start).updated(group_of("day", draw_day(noise, n, draw))[1])


def _lasting(scenario: Scenario, n: int) -> SlowNoise:
    """Return the process of g_i: the fitted one, or the one of the truth's slow error."""
    truth, uwb = scenario.truth.uwb, scenario.uwb
    if uwb.errors != "fitted":
        return gauss_markov(np.full(n, truth.slow_sd), truth.slow_time, scenario.h)
    return lasting_of(noise_of(uwb), n, scenario.h)
