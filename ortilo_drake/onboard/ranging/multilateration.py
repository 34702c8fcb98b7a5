"""Position from ranges to surveyed anchors (paper, section III-B).

The position is the intersection of the spheres of the three nearest anchors, as the authors do, or the weighted
least-squares fit of all ranges. The covariance comes from the geometry (range_equations.py). There is *no fix* with
fewer than three ranges, with anchors on one line, with an sd above MAX_SD, or if the fit does not converge. Ranges that
do not agree with the others may be left out before (fault_exclusion.py).
"""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.loop.plain import generic_twin_of
from ortilo_drake.model.placing import fill, put
from ortilo_drake.model.scalars import values_of
from ortilo_drake.model.triples import Triple, triple
from ortilo_drake.onboard.ranging.clock_offset import differentiable_offset_fix
from ortilo_drake.onboard.ranging.fault_exclusion import KNOWN, PLAIN, Consistency, consistency_of, consistent_fix
from ortilo_drake.onboard.ranging.nearest_three import three_spheres
from ortilo_drake.onboard.ranging.range_equations import (
    Symmetric,
    covariance_of_the_new,
    fit_all,
    inverse,
    normal_equations,
    product,
)
from ortilo_drake.scenario import Multilateration as MultilaterationSettings


@register_jitable
def put_fix(out: np.ndarray, stamp: float, p: Triple, C: Symmetric) -> None:
    """Write the fix message (14) with the stamp [s], the position p (3) and its covariance C."""
    out[0], out[1] = 1.0, stamp
    put(p, out, 2)
    xx, xy, xz, yy, yz, zz = C
    put((xx, xy, xz, xy, yy, yz, xz, yz, zz), out, 5)


@cached_njit(_nrt=False)
def put_fix_message(
    uwb: np.ndarray,
    anchors: np.ndarray,
    noise: np.ndarray,
    xhat: np.ndarray,
    three: bool,
    used: np.ndarray,
    out: np.ndarray,
) -> None:
    """Write the fix message (14) of a uwb message (2 + 2 n) that arrived; zeros if there is no fix.

    The solver starts from xhat (3 or more) and uses the nearest three anchors if `three`; `used` is work memory (n).
    Anchors and noise as in range_equations.py.
    """
    n = anchors.shape[0]
    ranges, there, p_last = uwb[2 : 2 + n], uwb[2 + n :], triple(xhat)
    if three:
        found, p, C = three_spheres(ranges, there, anchors, noise, p_last, used)
    else:
        found, p, C = fit_all(ranges, there, anchors, noise, p_last)
    fill(out, 0.0)
    if found:
        put_fix(out, uwb[1], p, C)


@cached_njit
def tested_fix_message(
    uwb: np.ndarray,
    anchors: np.ndarray,
    noise: np.ndarray,
    xhat: np.ndarray,
    clock: np.ndarray,
    consistency: Consistency,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the fix message (14) of the ranges of a uwb message that agree, and the clock's new prior (3)."""
    n = anchors.shape[0]
    fix = consistent_fix(uwb[2 : 2 + n], uwb[2 + n :], anchors, noise, xhat[:3], clock, consistency)
    message = np.zeros(14)
    if fix.found:
        message[0], message[1] = 1.0, uwb[1]
        put(fix.p, message, 2)
        put(fix.C.ravel(), message, 5)
    return message, fix.clock


@generic_twin_of(put_fix_message)
def put_differentiable_fix_message(
    uwb: np.ndarray,
    anchors: np.ndarray,
    noise: np.ndarray,
    xhat: np.ndarray,
    three: bool,
    used: np.ndarray,
    out: np.ndarray,
) -> None:
    """Write the fix message of a uwb message of AutoDiffXd, with the derivatives of position and covariance.

    The position p* minimises the cost, so g(p*, r) = 0. The step p* + N^-1 g(p*, r) has the derivative dp*/dr, but for
    the curvature of the ranges times their residuals (Gauss-Newton), which is 0 without noise.
    """
    n, values, sizes = len(anchors), values_of(uwb), np.asarray(values_of(noise), dtype=float)
    nearest, message = np.zeros(n), np.zeros(14)
    put_fix_message(values, anchors, sizes, values_of(xhat), three, nearest, message)
    put(message, out)
    if message[0] == 0.0:
        return
    p, ranges, there = message[2:5], uwb[2 : 2 + n], nearest if three else values[2 + n :]
    _, N, g = normal_equations.py_func(p, ranges, there, anchors, noise)
    _, C = inverse.py_func(N)
    p = p + product.py_func(C, g)
    _, N, _ = normal_equations.py_func(p, ranges, there, anchors, noise)
    _, C = inverse.py_func(N)
    if noise[2] > 0.0:
        C = covariance_of_the_new.py_func(p, ranges, there, anchors, noise, C)
    put_fix(out, uwb[1], p, C)


@generic_twin_of(tested_fix_message)
def differentiable_tested_fix_message(
    uwb: np.ndarray,
    anchors: np.ndarray,
    noise: np.ndarray,
    xhat: np.ndarray,
    clock: np.ndarray,
    consistency: Consistency,
) -> tuple[np.ndarray, np.ndarray]:
    """Do tested_fix_message with AutoDiffXd; the choice of ranges and the clock's prior are constants."""
    n, values, known = len(anchors), values_of(uwb), values_of(clock).astype(float)
    sizes = np.asarray(values_of(noise), dtype=float)
    fix = consistent_fix(values[2 : 2 + n], values[2 + n :], anchors, sizes, values_of(xhat)[:3], known, consistency)
    if not fix.found or fix.unknowns == PLAIN:
        used, message = fix.used if fix.found else np.zeros(n), np.zeros(14, uwb.dtype)
        put_differentiable_fix_message(np.append(uwb[: 2 + n], used), anchors, noise, xhat, False, used, message)
        return message, fix.clock
    prior = known if fix.unknowns == KNOWN else np.zeros(3)
    p, C = differentiable_offset_fix(fix.p, uwb[2 : 2 + n], fix.used, anchors, noise, prior)
    return np.concatenate(([1.0 + 0.0 * uwb[1], uwb[1]], p, C.ravel())), fix.clock


def believed_noise(settings: MultilaterationSettings) -> np.ndarray:
    """Return the settings' noise s_0 [m], s_1 and s_2 [m] (3) of range_equations.py."""
    return np.array([*settings.noise.sds, settings.bias_sd])


def fix_message_at(
    settings: MultilaterationSettings, anchors: np.ndarray, uwb: np.ndarray, x: np.ndarray
) -> np.ndarray:
    """Return the fix message (14) of a uwb message that arrived, given the filter's estimate x (12 or more)."""
    noise = believed_noise(settings)
    if settings.exclude is None:
        message, n = np.zeros(14), len(anchors)
        put_fix_message(uwb, anchors, noise, x, settings.method == "nearest_three", np.zeros(n), message)
        return message
    consistency = consistency_of(settings.exclude, len(anchors))
    return np.asarray(tested_fix_message(uwb, anchors, noise, x, np.zeros(3), consistency)[0])
