"""Noise as a pure function of (seed, stream, tick), white or lasting.

Philox 4x64-10 (Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC 2011), the generator of
numpy.random.Philox, compiled by numba: a block cipher turns the counter (block, tick) under the key
(seed, stream) into four 64-bit words. No state, so a noise source is a memoryless function of time, and adding
a sensor or changing a rate leaves every other stream as it was.

A negative seed stands for given normal numbers, see given_noise.py; a uniform number is then Phi of a normal one.

A lasting error is a constant plus slowly changing noise, sampled exactly at the ticks.

    e_k = b + x_k,   x_{k+1} = a x_k + q w_k,   w standard normal.

First-order Gauss-Markov noise of standard deviation s and correlation time T has a = exp(-h / T), q = s sqrt(1 - a^2)
and x_0 = s w: stationary with E[x_j x_k] = s^2 a^|j - k|. A random walk that comes to the standard deviation r in 1 s
has a = 1, q = r sqrt(h) and x_0 = 0. (A. Gelb, ed., "Applied Optimal Estimation", 1974, section 3.8.)

A slow noise number that is still a pure function of the tick t, between nodes N ticks apart, is

    ((1 - a) n_k + a n_{k+1}) / sqrt((1 - a)^2 + a^2),   k = t div N,   a = (t mod N) / N,

standard normal in every tick.
"""

import hashlib
import math
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import types, uint64
from numba.extending import intrinsic, register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.compiled.inlined import Calling
from ortilo_drake.loop.plain import generic_twin_of
from ortilo_drake.model.clock import tick_of
from ortilo_drake.model.placing import put
from ortilo_drake.model.triples import Four
from ortilo_drake.world.given_noise import given_numbers, number_at, seed_beside

_M0, _M1 = uint64(0xD2E7470EE14C6C93), uint64(0xCA5A826395121157)
_W0, _W1 = uint64(0x9E3779B97F4A7C15), uint64(0xBB67AE8584CAA73B)
Words = tuple[np.uint64, np.uint64, np.uint64, np.uint64]

_BELOW_1 = 1.0 - 2.0**-53
_11 = uint64(11)


def stream_id(name: str) -> np.uint64:
    """Return the 64-bit number of a noise stream, from its name."""
    return np.uint64(int.from_bytes(hashlib.blake2b(name.encode(), digest_size=8).digest(), "little"))


@intrinsic
def _multiply(typing_context: Any, a: Any, b: Any) -> Any:
    """Return the high and low 64 bits of a b: one instruction, where Python's whole numbers would take twenty."""

    def codegen(context: Any, builder: ir.IRBuilder, signature: Any, arguments: Any) -> ir.Value:
        word, wide = ir.IntType(64), ir.IntType(128)
        whole = builder.mul(*(builder.zext(its, wide) for its in arguments))
        parts = builder.trunc(builder.lshr(whole, wide(64)), word), builder.trunc(whole, word)
        return context.make_tuple(builder, signature.return_type, parts)

    return types.UniTuple(types.uint64, 2)(types.uint64, types.uint64), codegen


@register_jitable
def philox_words(key0: int, key1: np.uint64, counter0: int, counter1: int) -> Words:
    """Return the block of four words for a key and a counter (counter0, counter1, 0, 0)."""
    c0, c1, c2, c3 = uint64(counter0), uint64(counter1), uint64(0), uint64(0)
    k0, k1 = uint64(key0), uint64(key1)
    for _ in range(10):
        high0, low0 = _multiply(_M0, c0)
        high1, low1 = _multiply(_M1, c2)
        c0, c1, c2, c3 = high1 ^ c1 ^ k0, low1, high0 ^ c3 ^ k1, low0
        k0 += _W0
        k1 += _W1
    return c0, c1, c2, c3


@register_jitable
def _uniform(word: np.uint64) -> float:
    """Return the number uniform on [0, 1) that a word gives."""
    return (word >> _11) * 2.0**-53


@register_jitable
def _normal_pair(word0: np.uint64, word1: np.uint64) -> tuple[float, float]:
    """Return the two standard normal numbers that two words give (Box-Muller)."""
    radius = np.sqrt(-2.0 * np.log(1.0 - _uniform(word0)))  # 1 - u is never 0
    angle = 2.0 * np.pi * _uniform(word1)
    return radius * np.cos(angle), radius * np.sin(angle)


@register_jitable
def _phi(z: float) -> float:
    """Return the share of standard normal numbers below z, less than 1."""
    return min(0.5 * math.erfc(-z / math.sqrt(2.0)), _BELOW_1)


@register_jitable
def _four_given(seed: int, stream: np.uint64, tick: int) -> Four:
    at, given = given_numbers(seed, stream, tick, 4)
    if given == 4:
        return number_at(at, 0), number_at(at, 1), number_at(at, 2), number_at(at, 3)
    word0, word1, word2, word3 = philox_words(seed_beside(seed), stream, 0, tick)
    return *_normal_pair(word0, word1), *_normal_pair(word2, word3)


@register_jitable(forceinline=True)
def four_normals(seed: int, stream: np.uint64, tick: int) -> Four:
    """Return the first four standard normal numbers that belong to this seed, stream and tick."""
    if seed < 0:
        return _four_given(seed, stream, tick)
    word0, word1, word2, word3 = philox_words(seed, stream, 0, tick)
    return *_normal_pair(word0, word1), *_normal_pair(word2, word3)


@register_jitable(forceinline=True)
def four_uniforms(seed: int, stream: np.uint64, tick: int) -> Four:
    """Return the first four numbers uniform on [0, 1) that belong to this seed, stream and tick."""
    if seed < 0:
        z = _four_given(seed, stream, tick)
        return _phi(z[0]), _phi(z[1]), _phi(z[2]), _phi(z[3])
    word0, word1, word2, word3 = philox_words(seed, stream, 0, tick)
    return _uniform(word0), _uniform(word1), _uniform(word2), _uniform(word3)


@cached_njit
def uniforms(seed: int, stream: np.uint64, tick: int, n: int) -> np.ndarray:
    """Return n numbers uniform on [0, 1) that belong to this seed, stream and tick."""
    values = np.empty(n)
    if seed < 0:
        put_normals(values, seed, stream, tick)
        for i in range(n):
            values[i] = _phi(values[i])
        return values
    for at in range(0, n, 4):
        words = philox_words(seed, stream, at // 4, tick)
        for i in range(min(n - at, 4)):
            values[at + i] = _uniform(words[i])
    return values


@register_jitable
def put_normals(values: np.ndarray, seed: int, stream: np.uint64, tick: int) -> None:
    """Write the standard normal numbers that belong to this seed, stream and tick to values (n)."""
    if seed < 0:
        at, given = given_numbers(seed, stream, tick, values.size)
        if given < values.size:
            _put_drawn(values, seed_beside(seed), stream, tick)
        for i in range(given):
            values[i] = number_at(at, i)
    else:
        _put_drawn(values, seed, stream, tick)


@register_jitable
def _put_drawn(values: np.ndarray, seed: int, stream: np.uint64, tick: int) -> None:
    n = values.size
    for at in range(0, n, 4):
        word0, word1, word2, word3 = philox_words(seed, stream, at // 4, tick)
        values[at], second = _normal_pair(word0, word1)
        if at + 1 < n:
            values[at + 1] = second
        if at + 2 < n:
            values[at + 2], fourth = _normal_pair(word2, word3)
            if at + 3 < n:
                values[at + 3] = fourth


@cached_njit(pipeline_class=Calling)
def normals(seed: int, stream: np.uint64, tick: int, n: int) -> np.ndarray:
    """Return n standard normal numbers that belong to this seed, stream and tick."""
    values = np.empty(n)
    put_normals(values, seed, stream, tick)
    return values


@generic_twin_of(put_normals)
def put_numbers(values: np.ndarray, seed: int, stream: np.uint64, tick: int) -> None:
    """Same as `put_normals`, for values of any scalar type: noise is a constant."""
    put(normals(seed, stream, tick, values.size), values)


@generic_twin_of(four_normals)
def four_numbers(seed: int, stream: np.uint64, tick: int) -> Four:
    """Same as `four_normals`, drawn by compiled code."""
    first, second, third, fourth = normals(seed, stream, tick, 4).tolist()
    return first, second, third, fourth


@generic_twin_of(four_uniforms)
def four_uniform_numbers(seed: int, stream: np.uint64, tick: int) -> Four:
    """Same as `four_uniforms`, drawn by compiled code."""
    first, second, third, fourth = uniforms(seed, stream, tick, 4).tolist()
    return first, second, third, fourth


for _drawn in (normals, uniforms):
    generic_twin_of(_drawn)(_drawn)  # the compiled functions serve every scalar type


class SlowNoise(NamedTuple):
    """The parameters of the process x_k, for each of its n components."""

    a: np.ndarray
    """decay over a tick (n)."""
    q: np.ndarray
    """standard deviation of the noise that a tick adds (n)."""
    start: np.ndarray
    """standard deviation of x_0 (n)."""


def gauss_markov(sd: np.ndarray, time: float, h: float) -> SlowNoise:
    """Return first-order Gauss-Markov noise of standard deviations sd (n), correlation time [s] and tick h [s]."""
    a = np.exp(-h / time)
    return SlowNoise(np.full(len(sd), a), sd * np.sqrt(1.0 - a * a), sd)


def random_walk(after_1_s: np.ndarray, h: float) -> SlowNoise:
    """Return random walks that have these standard deviations after 1 s (n), with ticks of h [s]."""
    return SlowNoise(np.ones(len(after_1_s)), after_1_s * np.sqrt(h), np.zeros(len(after_1_s)))


@cached_njit
def slow_noise_after(
    x: np.ndarray, a: np.ndarray, q: np.ndarray, seed: int, stream: np.uint64, time: float, h: float
) -> np.ndarray:
    """Return x_{k+1} from x_k (n) at t_k [s]."""
    return a * x + q * normals(seed, stream, tick_of(time, h) + 1, len(a))


def slow_step(n: Any, k: int, seed: int, x: np.ndarray, a: np.ndarray, q: np.ndarray) -> None:
    """Advance the slow errors x to the next tick; the element has a noise stream and the tick h [s]."""
    put(slow_noise_after(x, a, q, seed, n.stream, k * n.h, n.h), x)


@register_jitable
def _mixed(new: float, before: float, after: float, share: float, a: float) -> float:
    """Return a number whose slow part lies at the fraction a of the way from one node to the next."""
    scale = np.sqrt(share / ((1.0 - a) ** 2 + a**2))
    return np.sqrt(1.0 - share) * new + scale * ((1.0 - a) * before + a * after)


@register_jitable(forceinline=True)
def persistent_normals(
    seed: int, of_nodes: np.ndarray, white: np.uint64, nodes: np.uint64, tick: int, share: float, spacing: int
) -> Four:
    """Return a tick's four standard normal numbers, of whose variance a share changes slowly.

    The function is inlined where it is called, so that unused numbers are not drawn. `seed` is that of the tick's
    noise; of_nodes (2) are the seeds of the nodes before and after, the same unless each tick of the flight has its own
    seed. `white` is the stream of what is new in every tick, `nodes` that of the nodes, `spacing` ticks apart.
    """
    z = four_normals(seed, white, tick)
    if share <= 0.0:
        return z
    a = (tick % spacing) / spacing
    before = four_normals(of_nodes[0], nodes, tick // spacing)
    after = four_normals(of_nodes[1], nodes, tick // spacing + 1)
    return (
        _mixed(z[0], before[0], after[0], share, a),
        _mixed(z[1], before[1], after[1], share, a),
        _mixed(z[2], before[2], after[2], share, a),
        _mixed(z[3], before[3], after[3], share, a),
    )


@register_jitable
def seeds_of_nodes(slow: np.ndarray, seeds: np.ndarray, k: int) -> np.ndarray:
    """Return the seeds of the nodes before and after tick k, for each slowly changing number: the nodes' ticks' seeds.

    `slow` (n, 2) holds for each number the share that changes slowly, and the ticks between its nodes. `seeds` holds
    the seed of each tick; a node after the last tick has the last seed. The result is (n, 2).
    """
    found = np.empty((slow.shape[0], 2), dtype=np.int64)
    for i in range(slow.shape[0]):
        spacing = max(int(slow[i, 1]), 1)
        for j in range(2):
            found[i, j] = seeds[min((k // spacing + j) * spacing, seeds.size - 1)]
    return found
