"""UWB ranging with fitted errors: their equations, and the element.

The errors are those of a NOISE.yaml, in simulated flights and in recorded paths that are flown again. A range from p,
at the height z above the floor, to anchor i has the error

    e_i = c_i + s (g_i + f_i(p) + d v_i),   s = min(1 + (z_0 / z)^4, 10),   d = sqrt(w^2 + o^2) in an outlier, else w

c_i is a constant, g_i first-order Gauss-Markov noise (noise.py), f_i a field in space and v_i standard normal. g_i
advances in every tick. In a tick in which a message is sent, each range is missing with the same probability; if it is
not, its anchor's outlier chain advances. Outliers are a two-state chain along the rows of an anchor: they begin with
probability q / ((1 - q) b) and end with 1 / b, so that a share q of all rows are outliers, b in a row on average (E. N.
Gilbert, "Capacity of a burst-noise channel", 1960). Constants and fields are the same in all flights of a day.

With a heavy tail, w is multiplied by one of six factors, drawn for each row that is no outlier (white_scales).

A field is Matérn, drawn by random features (Rahimi and Recht, NIPS 2007).

    f(p) = sd sqrt(2 / M) sum_m n_m cos(w_m . p + u_m),   covariance sd² (1 + d) exp(-d),   d = sqrt(3) |p - q| / length

with n_m standard normal and u_m uniform. The spectral density of the Matérn 3/2 kernel is that of Student's t with
three degrees of freedom, so w = z / length sqrt(3 / chi²_3) with z standard normal (3).
"""

from typing import Any, NamedTuple

import numpy as np
from numba.extending import register_jitable
from scipy.special import ndtr

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.loop.element import Box, Element, Values, group_of
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import PAYLOAD, uwb_size
from ortilo_drake.scenario import Uwb
from ortilo_drake.scenario.noise_file import UwbNoise, white_scales
from ortilo_drake.world.drawn_truth import AtStart
from ortilo_drake.world.noise import SlowNoise, gauss_markov, put_normals, slow_noise_after, stream_id, uniforms
from ortilo_drake.world.sensors.uwb import Receiver, put_uwb_message, receiver_of

FEATURES = 200
NUMBERS = 8  # that draw a feature: three of z, three of chi², its phase, n


class Day(NamedTuple):
    """Errors of n anchors that are the same in all flights of a day: constants, and fields of M features or none."""

    constants: np.ndarray
    """constant error of each anchor (n) [m]."""
    w: np.ndarray
    """frequencies (n, M, 3) [rad/m]."""
    u: np.ndarray
    """phases (n, M) [rad]."""
    amplitude: np.ndarray
    """amplitudes (n, M) [m]."""

    def fields_at(self, p: np.ndarray) -> np.ndarray:
        """Return the anchors' fields at places (k, 3) as (k, n) [m]."""
        anchors, places = range(len(self.constants)), np.ascontiguousarray(p)
        return np.array([[field_at(self, i, place) for i in anchors] for place in places])


@cached_njit
def field_at(day: Day, i: int, p: np.ndarray) -> float:
    """Return the value of anchor i's field at p (3) [m]."""
    total = 0.0 * p[0]
    for m in range(day.u.shape[1]):
        phase = day.w[i, m, 0] * p[0] + day.w[i, m, 1] * p[1] + day.w[i, m, 2] * p[2] + day.u[i, m]
        total += day.amplitude[i, m] * np.cos(phase)
    return total


NEAREST, LARGEST = 0.02, 10.0  # least height of an antenna above the floor [m], and largest growth of an error


def fields_of(normals: np.ndarray, length: float, sd: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return w, u and amplitude of the fields of this length and sd [m] that standard normal numbers (n, 8 M) give."""
    z, chi, phase, number = np.split(normals.reshape(len(normals), -1, NUMBERS), (3, 6, 7), axis=2)
    w = z / length * np.sqrt(3.0 / np.sum(chi**2, axis=2, keepdims=True))
    amplitude = sd * np.sqrt(2.0 / number.shape[1]) * number[..., 0]
    return w, 2.0 * np.pi * ndtr(phase[..., 0]), amplitude


def no_day(noise: UwbNoise, n: int) -> Day:
    """Return a day without errors for n anchors, with arrays of the sizes that draw_day gives."""
    M = 0 if noise.field is None else FEATURES
    return Day(np.zeros(n), np.zeros((n, M, 3)), np.zeros((n, M)), np.zeros((n, M)))


def draw_day(noise: UwbNoise, n: int, draw: AtStart) -> Day:
    """Draw a day's errors for n anchors; the noise's own constants, if it has any, replace the drawn ones."""
    drawn, field = noise.constants_sd * draw("fitted/constants", n), noise.field
    day = no_day(noise, n)._replace(constants=drawn if noise.constants is None else np.array(noise.constants))
    if field is None:
        return day
    normals = np.array([draw(f"fitted/field/{i}", NUMBERS * FEATURES) for i in range(n)])
    return Day(day.constants, *fields_of(normals, field.length, field.sd))


def share_of_pairs(share: float) -> float:
    """Return the share of outliers among differences of two ranges, given the share among ranges."""
    return 1.0 - (1.0 - share) ** 2


def outlier_chain(share: float, burst: float) -> tuple[float, float]:
    """Return the probabilities with which outliers begin and end from one row of an anchor to the next."""
    return share / ((1.0 - share) * burst), 1.0 / burst


@register_jitable
def odd_after(odd: bool, u: float, begins: float, ends: float) -> bool:
    """Return whether an anchor's next row is an outlier, given u uniform on [0, 1)."""
    return u >= ends if odd else u < begins


@register_jitable
def growth(height: float, near_floor: float) -> float:
    """Return s for the height z [m] and z_0 [m] (near_floor)."""
    return min(1.0 + (near_floor / max(height, NEAREST)) ** 4, LARGEST)


@register_jitable
def drawn_scales(scales: np.ndarray, seed: int, stream: np.uint64, tick: int, rows: int) -> np.ndarray:
    """Return the factor of each row's white deviation (rows), drawn from equally likely scales."""
    found = np.ones(rows)
    if scales.size > 1:
        chance = uniforms(seed, stream, tick, rows)
        for j in range(rows):
            found[j] = scales[int(chance[j] * scales.size)]
    return found


@register_jitable
def row_error(constant: float, own: float, s: float, white: float, far: float, v: float) -> float:
    """Return c + s (g + f + d v) of a row [m]; far is the deviation that an outlier adds, 0 in any other row."""
    return constant + s * (own + np.sqrt(white * white + far * far) * v)


def largest_sd(noise: UwbNoise) -> float:
    """Return the largest root mean square of a row's error [m]: an outlier, next to the floor if the height matters."""
    lasts = [part.sd for part in (noise.lasting, noise.field) if part is not None]
    s = LARGEST if noise.near_floor > 0.0 else 1.0
    white = noise.white * white_scales(noise.freedom).max()
    constant = noise.constants_sd if noise.constants is None else max(map(abs, noise.constants), default=0.0)
    return constant + s * float(np.linalg.norm([white, noise.outliers.sd, *lasts]))


@cached_njit
def outlier_rows(anchor: np.ndarray, odd: np.ndarray, u: np.ndarray, begins: float, ends: float) -> np.ndarray:
    """Return a mask (m) of the outlier rows, given each row's anchor (m) and uniform numbers u on [0, 1) (m).

    `odd` (n) says whether each anchor's row before its first one was an outlier; it is updated. begins and ends are
    those of outlier_chain.
    """
    found = np.empty(anchor.size, dtype=np.bool_)
    for k in range(anchor.size):
        i = anchor[k]
        odd[i] = odd_after(odd[i], u[k], begins, ends)
        found[k] = odd[i]
    return found


LASTING, CHANCES, ODD = "fitted/lasting", "fitted/chances", "fitted/outliers"  # streams
TAILS = "fitted/tails"


def fitted_out(
    n: Any,
    k: int,
    seed: int,
    sent: np.ndarray,
    state: np.ndarray,
    receiver: Receiver,
    day: Day,
    scales: np.ndarray,
    g: np.ndarray,
    odd: np.ndarray,
    v: np.ndarray,
    out: np.ndarray,
) -> None:
    """Output the uwb message in a tick in which it is sent, else zeros; no range is below 0."""
    fill(out, 0.0)
    if sent[0] < 0.0:
        return
    count = v.size
    fill(v, 0.0)
    put_uwb_message(out, v, state, receiver, k * n.h)
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
        own = g[i] + field_at(day, i, state)
        out[PAYLOAD + i] = max(out[PAYLOAD + i] + row_error(day.constants[i], own, s, white, far, v[i]), 0.0)


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

    The values that a seed draws (constants, fields, the first slow errors) are zero until they are drawn.
    """
    noise, n = noise_of(settings), len(room.anchors)
    given = given_of(noise, room, lasting_of(noise, n, h), h, noise.outliers.share, (CHANCES, LASTING))
    given = given.updated(Values({"white": noise.white}))
    return Box("uwb", FITTED, uwb_size(n), given, {"v": (n,)}).with_groups(
        receiver=receiver_of(settings, room), day=no_day(noise, n)
    )


def given_of(
    noise: UwbNoise, room: Room, lasting: SlowNoise, h: float, share: float, streams: tuple[str, str]
) -> Values:
    """Return the numbers, tables and states that fitted ranges and differences share; drawn values are zero at first.

    The noise is that of single ranges, `lasting` the process of the slow errors g, `share` the share of outlier rows.
    The two streams are those of the rows' chances and of the slow errors.
    """
    begins, ends = outlier_chain(share, noise.outliers.burst)
    numbers: dict[str, Any] = {"far": noise.outliers.sd, "begins": begins, "ends": ends}
    numbers |= {"missing": noise.missing, "near_floor": noise.near_floor, "floor": float(room.interior.min[2]), "h": h}
    numbers |= {name: stream_id(stream) for name, stream in zip(("chances", "lasting"), streams, strict=True)}
    numbers["tails"] = stream_id(TAILS)
    tables = {"scales": white_scales(noise.freedom), "a": lasting.a, "q": lasting.q}
    start = {name: np.zeros(len(room.anchors)) for name in ("g", "odd")}
    return Values(numbers | {"stream": stream_id("uwb")}, start, tables)


def fitted_drawn(settings: Uwb, n: int, h: float, draw: AtStart) -> Values:
    """Return the values that these draws give to the box of n anchors in a flight."""
    noise = noise_of(settings)
    start = {"g": lasting_of(noise, n, h).start * draw(LASTING, n)}
    start["odd"] = (ndtr(draw(ODD, n)) < noise.outliers.share).astype(float)
    return Values(start=start).updated(group_of("day", draw_day(noise, n, draw))[1])


def noise_of(settings: Uwb) -> UwbNoise:
    """Return the fitted errors of single ranges that a scenario's uwb has."""
    assert settings.fitted is not None
    return settings.fitted.of_single_ranges


def lasting_of(noise: UwbNoise, n: int, h: float) -> SlowNoise:
    """Return the process of the slow errors g of n anchors."""
    time, sd = (1.0, 0.0) if noise.lasting is None else (noise.lasting.time, noise.lasting.sd)
    return gauss_markov(np.full(n, sd), time, h)
