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
from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import PAYLOAD, uwb_size
from ortilo_drake.scenario import Uwb
from ortilo_drake.scenario.noise_file import UwbNoise, white_scales
from ortilo_drake.world.drawn_truth import AtStart
from ortilo_drake.world.noise import SlowNoise, gauss_markov, put_normals, slow_noise_after, stream_id, uniforms
from ortilo_drake.world.sensors.uwb import put_uwb_message, ranging_settings, walls_between

FEATURES = 200
NUMBERS = 8  # that draw a feature: three of z, three of chi², its phase, n


@cached_njit
def field_at(w: np.ndarray, u: np.ndarray, amplitude: np.ndarray, p: np.ndarray) -> float:
    """Return the value at p (3) of a field with frequencies w (M, 3), phases u (M) and amplitudes (M)."""
    total = 0.0 * p[0]
    for m in range(u.size):
        total += amplitude[m] * np.cos(w[m, 0] * p[0] + w[m, 1] * p[1] + w[m, 2] * p[2] + u[m])
    return total


class MaternField(NamedTuple):
    """A field's frequencies (M, 3) [rad/m], phases (M) [rad] and amplitudes (M) [m], one for each feature."""

    w: np.ndarray
    u: np.ndarray
    amplitude: np.ndarray

    def at(self, p: np.ndarray) -> np.ndarray:
        """Return the field at places (k, 3)."""
        return np.array([field_at(*self, place) for place in np.ascontiguousarray(p)])


def field_of(normals: np.ndarray, length: float, sd: float) -> MaternField:
    """Return the field of this length and standard deviation [m] that standard normal numbers (8 M) give."""
    z, chi, phase, n = np.split(normals.reshape(-1, NUMBERS).T, (3, 6, 7))
    w = z / length * np.sqrt(3.0 / np.sum(chi**2, axis=0))
    amplitude = sd * np.sqrt(2.0 / n.size) * n[0]
    return MaternField(np.ascontiguousarray(w.T), 2.0 * np.pi * ndtr(phase[0]), amplitude)


NEAREST, LARGEST = 0.02, 10.0  # least height of an antenna above the floor [m], and largest growth of an error


class Day(NamedTuple):
    """Errors that are the same in all flights of a day: each anchor's constant (n) [m], and its field, if any."""

    constants: np.ndarray
    fields: tuple[MaternField, ...]


def draw_day(noise: UwbNoise, n: int, draw: AtStart) -> Day:
    """Draw a day's errors for n anchors; the noise's own constants, if it has any, replace the drawn ones."""
    drawn, field, size = noise.constants_sd * draw("fitted/constants", n), noise.field, NUMBERS * FEATURES
    constants = drawn if noise.constants is None else np.array(noise.constants)
    if field is None:
        return Day(constants, ())
    its = [draw(f"fitted/field/{i}", size) for i in range(n)]
    return Day(constants, tuple(field_of(normals, field.length, field.sd) for normals in its))


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
    """Output the uwb message in a tick in which it is sent, else zeros; no range is below 0."""
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

    The values that a seed draws (constants, fields, the first slow errors) are zero until they are drawn.
    """
    noise, n = noise_of(settings), len(room.anchors)
    given = given_of(noise, settings, room, lasting_of(noise, n, h), h, noise.outliers.share, (CHANCES, LASTING))
    given = given.updated(Values({"white": noise.white}))
    return Box("uwb", FITTED, uwb_size(n), given, {"v": (n,)})


def given_of(
    noise: UwbNoise, settings: Uwb, room: Room, lasting: SlowNoise, h: float, share: float, streams: tuple[str, str]
) -> Values:
    """Return the numbers, tables and states that fitted ranges and differences share; drawn values are zero at first.

    The noise is that of single ranges, `lasting` the process of the slow errors g, `share` the share of outlier rows.
    The two streams are those of the rows' chances and of the slow errors.
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
    """Return the values that these draws give to the box of n anchors in a flight."""
    noise = noise_of(settings)
    day = draw_day(noise, n, draw)
    start = {"g": lasting_of(noise, n, h).start * draw(LASTING, n)}
    start["odd"] = (ndtr(draw(ODD, n)) < noise.outliers.share).astype(float)
    return Values(start=start, tables={"constants": day.constants} | field_tables(day))


def noise_of(settings: Uwb) -> UwbNoise:
    """Return the fitted errors of single ranges that a scenario's uwb has."""
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
