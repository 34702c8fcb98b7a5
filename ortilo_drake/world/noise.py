"""Noise as a pure function of (seed, stream, tick).

Philox 4x64-10 (Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC 2011), the generator of
numpy.random.Philox, compiled by numba: a block cipher turns the counter (block, tick) under the key
(seed, stream) into four 64-bit words. No state, so a noise source is a memoryless function of time, and adding
a sensor or changing a rate leaves every other stream as it was.
"""

import hashlib

import numpy as np
from numba import njit, uint64
from numba.extending import register_jitable

_M0, _M1 = uint64(0xD2E7470EE14C6C93), uint64(0xCA5A826395121157)
_W0, _W1 = uint64(0x9E3779B97F4A7C15), uint64(0xBB67AE8584CAA73B)
_LOW, _32, _11 = uint64(0xFFFFFFFF), uint64(32), uint64(11)


def stream_id(name: str) -> np.uint64:
    """Return the 64-bit number of a noise stream, from its name."""
    return np.uint64(int.from_bytes(hashlib.blake2b(name.encode(), digest_size=8).digest(), "little"))


@register_jitable
def _multiply(a: np.uint64, b: np.uint64) -> tuple[np.uint64, np.uint64]:
    """Return the high and low 64 bits of a b."""
    a_lo, a_hi, b_lo, b_hi = a & _LOW, a >> _32, b & _LOW, b >> _32
    middle = a_hi * b_lo + ((a_lo * b_lo) >> _32)
    carry = a_lo * b_hi + (middle & _LOW)
    return a_hi * b_hi + (middle >> _32) + (carry >> _32), a * b


@njit(cache=True)
def philox_words(key0: int, key1: np.uint64, counter0: int, counter1: int, out: np.ndarray) -> None:
    """Write the block of four words for a key and a counter (counter0, counter1, 0, 0) to out (uint64)."""
    c0, c1, c2, c3 = uint64(counter0), uint64(counter1), uint64(0), uint64(0)
    k0, k1 = uint64(key0), uint64(key1)
    for _ in range(10):
        high0, low0 = _multiply(_M0, c0)
        high1, low1 = _multiply(_M1, c2)
        c0, c1, c2, c3 = high1 ^ c1 ^ k0, low1, high0 ^ c3 ^ k1, low0
        k0 += _W0
        k1 += _W1
    out[0], out[1], out[2], out[3] = c0, c1, c2, c3


@njit(cache=True)
def uniforms(seed: int, stream: np.uint64, tick: int, n: int) -> np.ndarray:
    """Return n numbers uniform on [0, 1) that belong to this seed, stream and tick."""
    words = np.empty(4, dtype=np.uint64)
    values = np.empty(n)
    for i in range(n):
        if i % 4 == 0:
            philox_words(seed, stream, i // 4, tick, words)
        values[i] = (words[i % 4] >> _11) * 2.0**-53
    return values


@njit(cache=True)
def normals(seed: int, stream: np.uint64, tick: int, n: int) -> np.ndarray:
    """Return n standard normal numbers that belong to this seed, stream and tick (Box-Muller)."""
    u = uniforms(seed, stream, tick, n + n % 2)
    values = np.empty(n)
    for i in range(0, n, 2):
        radius = np.sqrt(-2.0 * np.log(1.0 - u[i]))  # 1 - u is never 0
        angle = 2.0 * np.pi * u[i + 1]
        values[i] = radius * np.cos(angle)
        if i + 1 < n:
            values[i + 1] = radius * np.sin(angle)
    return values
