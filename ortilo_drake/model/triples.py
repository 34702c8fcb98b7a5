"""Short vectors as tuples, for compiled functions: an array would cost more than the arithmetic."""

import numpy as np
from numba.extending import register_jitable

Triple = tuple[float, float, float]  # this and the next types are for any scalar type
Four = tuple[float, float, float, float]
Six = tuple[float, float, float, float, float, float]
Twelve = tuple[float, float, float, float, float, float, float, float, float, float, float, float]


@register_jitable
def triple(v: np.ndarray) -> Triple:
    """Return the first three numbers of an array as a tuple."""
    return v[0], v[1], v[2]


@register_jitable
def plus(a: Triple, b: Triple) -> Triple:
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@register_jitable
def minus(a: Triple, b: Triple) -> Triple:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@register_jitable
def times(s: float, a: Triple) -> Triple:
    """Return the product s a of a number and a vector."""
    return s * a[0], s * a[1], s * a[2]


@register_jitable
def dot(a: Triple, b: Triple) -> float:
    """Return the scalar product a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@register_jitable
def cross(a: Triple, b: Triple) -> Triple:
    """Return the cross product a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
