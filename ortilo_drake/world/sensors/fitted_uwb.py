"""UWB ranging with errors fitted to recordings: their equations, and the element.

g_i goes on in every tick. In a tick in which a message is sent, each range is missing with the same probability, and
the outliers' chain of its anchor goes on if it is not.

The errors are those that a NOISE.yaml describes, of simulated flights and of recorded paths that are flown again.

A range from p, at the height z above the floor, to anchor i errs by

    e_i = c_i + s (g_i + f_i(p) + d v_i),   s = min(1 + (z_0 / z)^4, 10),   d = sqrt(w^2 + o^2) in an outlier, else w

c_i is a constant, g_i first-order Gauss-Markov noise (noise.py), f_i a field in space and v_i
standard normal. Outliers are a two-state chain along the rows of an anchor: they begin with probability q / ((1 - q) b)
and end with 1 / b, so that a share q of all rows are some, b in a row on average (E. N. Gilbert, "Capacity of a
burst-noise channel", 1960). Constants and fields are the same in all flights of a day.

With a heavy tail w is that times one of six factors, drawn for each row that is no outlier (white_scales).

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
NUMBERS = 8  # that a feature is drawn by: three of z, three of chi², its phase, n


@cached_njit
def field_at(w: np.ndarray, u: np.ndarray, amplitude: np.ndarray, p: np.ndarray) -> float:
    """Return a field at a place p (3), of its features (M, 3), (M) and (M)."""
    total = 0.0 * p[0]
    for m in range(u.size):
        total += amplitude[m] * np.cos(w[m, 0] * p[0] + w[m, 1] * p[1] + w[m, 2] * p[2] + u[m])
    return total


class MaternField(NamedTuple):
    """Frequencies (M, 3) [rad/m], phases (M) [rad], and the amplitude of each feature (M) [m]."""

    w: np.ndarray
    u: np.ndarray
    amplitude: np.ndarray

    def at(self, p: np.ndarray) -> np.ndarray:
        """Return the field at places (k, 3)."""
        return np.array([field_at(*self, place) for place in np.ascontiguousarray(p)])


def field_of(normals: np.ndarray, length: float, sd: float) -> MaternField:
    """Return the field of a length and a deviation [m] that belongs to standard normal numbers (8 M)."""
    z, chi, phase, n = np.split(normals.reshape(-1, NUMBERS).T, (3, 6, 7))
    w = z / length * np.sqrt(3.0 / np.sum(chi**2, axis=0))
    amplitude = sd * np.sqrt(2.0 / n.size) * n[0]
    return MaternField(np.ascontiguousarray(w.T), 2.0 * np.pi * ndtr(phase[0]), amplitude)


NEAREST, LARGEST = 0.02, 10.0  # no antenna is nearer to the floor than this [m], and no error grows by more


class Day(NamedTuple):
    """Errors that are the same in all flights of a day: each anchor's constant (n) [m], and its field, if any."""

    constants: np.ndarray
    fields: tuple[MaternField, ...]


def draw_day(noise: UwbNoise, n: int, draw: AtStart) -> Day:
    """Return a day drawn; constants that the noise has, n then, are these."""
    drawn, field, size = noise.constants_sd * draw("fitted/constants", n), noise.field, NUMBERS * FEATURES
    constants = drawn if noise.constants is None else np.array(noise.constants)
    if field is None:
        return Day(constants, ())
    its = [draw(f"fitted/field/{i}", size) for i in range(n)]
    return Day(constants, tuple(field_of(normals, field.length, field.sd) for normals in its))


def share_of_pairs(share: float) -> float:
    """Return the share of differences of two ranges that are outliers, of that of ranges."""
    return 1.0 - (1.0 - share) ** 2


def outlier_chain(share: float, burst: float) -> tuple[float, float]:
    """Return with which probability outliers begin and end from a row of an anchor to its next."""
    return share / ((1.0 - share) * burst), 1.0 / burst


@register_jitable
def odd_after(odd: bool, u: float, begins: float, ends: float) -> bool:
    """Return whether an anchor's next row is an outlier, u uniform on [0, 1)."""
    return u >= ends if odd else u < begins


@register_jitable
def growth(height: float, near_floor: float) -> float:
    """Return s, of the height z [m] and z_0 [m]."""
    return min(1.0 + (near_floor / max(height, NEAREST)) ** 4, LARGEST)


@register_jitable
def drawn_scales(scales: np.ndarray, seed: int, stream: np.uint64, tick: int, rows: int) -> np.ndarray:
    """Return the factor of each row's white deviation, drawn of some as likely (rows)."""
    found = np.ones(rows)
    if scales.size > 1:
        chance = uniforms(seed, stream, tick, rows)
        for j in range(rows):
            found[j] = scales[int(chance[j] * scales.size)]
    return found


@register_jitable
def row_error(constant: float, own: float, s: float, white: float, far: float, v: float) -> float:
    """Return c + s (g + f + d v) of a row, far the deviation of what an outlier adds, 0 in another row [m]."""
    return constant + s * (own + np.sqrt(white * white + far * far) * v)


def largest_sd(noise: UwbNoise) -> float:
    """Return the root mean square of a row's error at worst: an outlier, beside the floor if that counts [m]."""
    lasts = [part.sd for part in (noise.lasting, noise.field) if part is not None]
    s = LARGEST if noise.near_floor > 0.0 else 1.0
    white = noise.white * white_scales(noise.freedom).max()
    constant = noise.constants_sd if noise.constants is None else max(map(abs, noise.constants), default=0.0)
    return constant + s * float(np.linalg.norm([white, noise.outliers.sd, *lasts]))


@cached_njit
def outlier_rows(anchor: np.ndarray, odd: np.ndarray, u: np.ndarray, begins: float, ends: float) -> np.ndarray:
    """Return a mask (m) of the outlier rows, of the anchor of each row and of uniform numbers u on [0, 1) (m).

    `odd` is whether the row before the first of each anchor was one (n), and changed; begins and ends are those of
    outlier_chain.
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
