"""Whether one more unknown explains the errors: an anchor's place, the ranges' scale, the truth's late or fast clock.

A cheap fit leaves errors e at known places; its unknowns y, and a bias c_i of each anchor, may still move:

    minimise  Σ rho((e + J y + c_i [- c_j] + X z) / 0.06 m) + |c|² / (0.2 m)² + what is known of y,   rho = soft L1

over y, c and z, once without z and once for each z that may be wrong. The z that gains most is told if it explains a
good part of the errors and is far more likely than the map's value. The errors of ranges last: all errors within their
duration, twice the filter's `correlation_time`, count as one sample.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from ortilo_drake.interop.recorded.map_file import Map, unit_key
from ortilo_drake.interop.recorded.recording import Ranges
from ortilo_drake.studies.recorded.moved_anchors import names_of, point_text
from ortilo_drake.studies.recorded.plain_fit import CLOCK, SPREAD, PlainFit, Reading, left_of, toward
from ortilo_drake.studies.recorded.readings import NEAR, OF_RANGES, UNITS, Guess, Trial, cheap_fit, path_of, scale_key
from ortilo_drake.studies.recorded.truth_path import LEAST, modelled

RANGES, WINDOWS = 1500, 24  # ranges used, at most; windows of a fit without a truth
BIAS, STEPS = 0.2, 6  # standard deviation of an anchor's bias [m]; Gauss-Newton steps of a solution
EXPLAINS, SURE = 1.35, 4.5  # a move must shrink the anchor's errors by this factor, and be so many deviations large
MOVED = 0.3  # least distance of a move that is told [m]
ONE_AXIS, OTHERS = 0.7, 0.8  # one axis is told if it has this share of the gain, and no other this share of its gain
TOLD_APART = 3.0  # standard deviations between two readings that can be told apart
CERTAIN = 8.0  # standard deviations by which a scale or a clock must be wrong
LEVERLESS = 1.6  # without attitude the lever's errors remain: then all errors must shrink by this factor
JUMPS = 15  # times at which a clock's jump is tried
SCALE, DRIFT, LATE = 0.01, 0.001, 0.05  # least scale error, drift [s/s] and delay [s] that are told

Extra = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]  # z (d) -> places of the anchors (n, 3), X (m, d) [m]


class _Solved(NamedTuple):
    """Cost, errors left (m) [m], z and its standard deviations (d) as if no error lasted, and biases (n) [m]."""

    cost: float
    errors: np.ndarray
    z: np.ndarray
    sd: np.ndarray
    biases: np.ndarray


def freed_guess(trial: Trial, map_: Map, imu_gains: float | None) -> Guess | None:
    """Return the anchor's place, the scale or the clock error that clearly explains the fit's residual.

    `imu_gains`: the gain of the truth's clock on the imu's [s/s], None if the body rates do not tell it.
    """
    anchors, fit = trial.now.anchors, _by_more(trial, trial.now)
    if fit is None or fit.left > NEAR * trial.noise:
        return None
    heard, before = fit.heard, _as_it_is(fit, anchors)
    found: list[tuple[float, Guess | None]] = []
    for i in range(len(anchors)):
        its = (heard.anchor == i) | (heard.other == i)
        if its.sum() >= LEAST:
            found.append(_moved(fit, trial, map_, i, its, before))
    if trial.now.truth is not None:
        found += _of_scale_and_clock(fit, trial, map_, before, imu_gains)
    return max(found, key=lambda one: one[0])[1] if found else None


def feet_or_nanoseconds(trial: Trial, map_: Map, guess: Guess) -> Guess:
    """Return a guess of feet or nanoseconds of flight as the likelier one, or as both if neither is clearly likelier.

    The two units differ by 1.6 %; a bias for each anchor and more ranges tell them apart.
    """
    units = {"ft": UNITS["ft"], "ns of flight": OF_RANGES["ns of flight"]}
    if not any(guess.key == scale_key(map_, by, unit) for unit, by in units.items()):
        return guess
    tried = []
    for unit, by in units.items():
        ranges = trial.now.ranges._replace(r=trial.now.ranges.r * by)
        fit = _by_more(trial, trial.now._replace(ranges=ranges))
        if fit is not None:
            tried.append((_as_it_is(fit, trial.now.anchors), fit, scale_key(map_, by, unit)))
    if len(tried) < 2:
        return guess
    (best, fit, key), (other, _, other_key) = sorted(tried, key=lambda one: one[0].cost)
    widens = _lasting(fit.heard, np.ones(len(fit.heard.r), dtype=bool), map_, True)
    sure = np.sqrt(2.0 * (other.cost - best.cost)) * SPREAD / left_of(best.errors) / widens
    return guess._replace(key=key if sure > TOLD_APART else f"{key} or {other_key}")


def _by_more(trial: Trial, now: Reading) -> PlainFit | None:
    """Return the cheap fit of a reading by more of the ranges, starting at the clock offset of the trial's fit."""
    near = trial.fit if now.ranges is trial.now.ranges and now.frame != "same" else None
    at = np.array([trial.fit.offset])
    return cheap_fit(now, path_of(now), at, moves=trial.moves, near=near, few=RANGES, windows=WINDOWS)


def _as_it_is(fit: PlainFit, anchors: np.ndarray) -> _Solved:
    return _solved(fit, anchors, lambda _: (anchors, np.zeros((len(fit.heard.r), 0))), 0)


def _solved(fit: PlainFit, anchors: np.ndarray, extra: Extra, d: int) -> _Solved:
    """Return the solution with d more unknowns z."""
    heard, n, k = fit.heard, len(anchors), fit.slopes.shape[1]
    m, two = len(heard.r), heard.other >= 0
    own = np.zeros((m, n))
    own[np.arange(m), heard.anchor] = 1.0
    own[two, heard.other[two]] -= 1.0
    known = np.hstack([block_diag(fit.slopes[m:], np.eye(n) / BIAS), np.zeros((len(fit.slopes) - m + n, d))])
    x = np.zeros(k + n + d)
    for step in range(STEPS + 1):
        places, X = extra(x[k + n :])
        e = (modelled(fit.places, places, fit.bias + x[k : k + n], heard) - heard.r) / SPREAD + fit.slopes[:m] @ x[:k]
        if places is anchors:
            e = e + X @ x[k + n :] / SPREAD
        rho = np.sqrt(1.0 + e**2)
        L = np.vstack([np.hstack([fit.slopes[:m], own / SPREAD, X / SPREAD]) / np.sqrt(rho)[:, None], known])
        normal = L.T @ L + 1e-9 * np.eye(len(x))
        if step < STEPS:
            x = x - np.linalg.solve(normal, L.T @ np.concatenate([e / np.sqrt(rho), known @ x]))
    sd = np.sqrt(np.diag(np.linalg.inv(normal))[k + n :])
    cost = float(np.sum(rho - 1.0) + 0.5 * np.sum((known @ x) ** 2))
    return _Solved(cost, SPREAD * e, x[k + n :], sd, fit.bias + x[k : k + n])


def _lasting(heard: Ranges, its: np.ndarray, map_: Map, apart: bool) -> float:
    """Return the factor by which lasting errors widen a standard deviation; `apart`: each anchor errs by itself."""
    then = np.floor(heard.t[its] / (2.0 * map_.filter.correlation_time))
    samples = len(np.unique(then)) * (len(np.unique(heard.anchor[its])) if apart else 1)
    return float(np.sqrt(max(1.0, its.sum() / samples)))


def _moved(
    fit: PlainFit, trial: Trial, map_: Map, i: int, its: np.ndarray, before: _Solved
) -> tuple[float, Guess | None]:
    """Return the gain of moving anchor i, and the guess of its new place if that is clearly better."""
    anchors = trial.now.anchors
    now = _along(fit, anchors, i, np.eye(3))
    was, left, gain = left_of(before.errors[its]), left_of(now.errors[its]), before.cost - now.cost
    sure = np.sqrt(max(0.0, 2.0 * gain)) * SPREAD / left / _lasting(fit.heard, its, map_, False)  # by the likelihoods
    if (
        sure < SURE
        or np.linalg.norm(now.z) < MOVED
        or was < EXPLAINS * left
        or max(left, left_of(now.errors)) > trial.noise
    ):
        return gain, None
    return gain, Guess(_moved_key(map_, fit, anchors, i, before, now), was, left, "its range")


def _along(fit: PlainFit, anchors: np.ndarray, i: int, axes: np.ndarray) -> _Solved:
    """Return the solution with anchor i moved along the columns of `axes` (3, d)."""
    heard = fit.heard

    def extra(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        places, X = anchors.copy(), np.zeros((len(heard.r), 3))
        places[i] += axes @ z
        X[heard.anchor == i] -= toward(fit.places[heard.anchor == i] - places[i])
        X[heard.other == i] += toward(fit.places[heard.other == i] - places[i])
        return places, X @ axes

    return _solved(fit, anchors, extra, axes.shape[1])


def _moved_key(map_: Map, fit: PlainFit, anchors: np.ndarray, i: int, before: _Solved, now: _Solved) -> str:
    """Return the key with the new place of anchor i: moved along one axis only if that axis explains the gain."""
    single = [_along(fit, anchors, i, np.eye(3)[:, [axis]]) for axis in range(3)]
    gains = np.array([before.cost - one.cost for one in single])
    axis, second = np.argsort(gains)[::-1][:2]
    move = now.z
    if gains[axis] > ONE_AXIS * (before.cost - now.cost) and gains[second] < OTHERS * gains[axis]:
        move = np.eye(3)[axis] * single[axis].z
    at, own = point_text(np.round(anchors[i] + move, 1) + 0.0), point_text(anchors[i])
    return f"anchors: entry {names_of(map_, len(anchors))[i]} at about {at}, not {own},"


class Move(NamedTuple):
    """The key of one moved anchor ("" for the map's places), all anchors then (n, 3), and their ranges' biases (n)."""

    key: str
    anchors: np.ndarray
    biases: np.ndarray


def moves_of(trial: Trial, map_: Map, most: int) -> list[Move]:
    """Return the map's anchors, then at most `most` moves of one anchor to its best place, the largest gain first.

    Empty if too few ranges can be fitted, or if they fit so badly that more is wrong. Moves below 0.3 m are left out.
    """
    anchors, fit = trial.now.anchors, _by_more(trial, trial.now)
    if fit is None or fit.left > NEAR * trial.noise:
        return []
    before = _as_it_is(fit, anchors)
    heard = [i for i in range(len(anchors)) if ((fit.heard.anchor == i) | (fit.heard.other == i)).sum() >= LEAST]
    tried = ((i, _along(fit, anchors, i, np.eye(3))) for i in heard)
    moved = sorted((one for one in tried if np.linalg.norm(one[1].z) >= MOVED), key=lambda one: one[1].cost)
    found = [Move("", anchors, before.biases)]
    for i, now in moved[:most]:
        places = anchors + np.outer(np.arange(len(anchors)) == i, now.z)
        found.append(Move(_moved_key(map_, fit, anchors, i, before, now), places, now.biases))
    return found


def _of_scale_and_clock(
    fit: PlainFit, trial: Trial, map_: Map, before: _Solved, imu_gains: float | None
) -> list[tuple[float, Guess | None]]:
    """Return the gains of a scale of the ranges and of the truth's clock, each with its guess if that is clear."""
    heard, m = fit.heard, len(fit.heard.r)
    by_lever = 1.0 if trial.now.truth is None or trial.now.truth.R is not None else LEVERLESS
    widens = _lasting(heard, np.ones(m, dtype=bool), map_, True)

    def by(X: np.ndarray, least: float, key: Callable[[float], str]) -> tuple[float, Guess | None]:
        now = _solved(fit, trial.now.anchors, lambda _: (trial.now.anchors, X), X.shape[1])
        was, left, z = left_of(before.errors), left_of(now.errors), float(now.z[-1])
        clear = abs(z) > max(least, CERTAIN * now.sd[-1] * left / SPREAD * widens)
        clear = clear and was > by_lever * left
        return before.cost - now.cost, Guess(key(z), was, left) if clear else None

    clock = fit.slopes[:m, [CLOCK]] * SPREAD
    drifts = np.hstack([clock, clock * (heard.t - heard.t.mean())[:, None]])
    clocks = [by(drifts, DRIFT, lambda z: _clock_key(map_, z, imu_gains))]
    for then in np.quantile(heard.t, np.linspace(0.0, 1.0, JUMPS + 2)[1:-1]):
        jumped = np.hstack([clock, clock * (heard.t > then)[:, None]])
        clocks.append(by(jumped, LATE, partial(_jump_key, float(then))))
    clear = [one for one in clocks if one[1] is not None]
    if not clear and not trial.moves:  # the fit held the clock offset of the body rates or of the map
        clear = [by(clock, LATE, lambda z: _late_key(map_, z))]
    scale = by(-heard.r[:, None], SCALE, lambda z: scale_key(map_, round(1.0 + z, 4)))
    return [scale, max(clear or clocks[:1], key=lambda one: one[0])]


def _jump_key(then: float, gained: float) -> str:
    """Return the key for a truth's clock that gains `gained` [s] at once; the ranges' clock may have jumped instead."""
    return (
        f"ranges: a clock that jumps by {-gained:+.2f} s about {then:.0f} s after the first, or the truth's the other "
        "way,"
    )


def _late_key(map_: Map, late: float) -> str:
    """Return the key that mends a clock offset that is wrong by `late` [s], by the ranges."""
    if isinstance(map_.calibration.clock, float | int):
        return f"calibration: {{clock: {map_.calibration.clock + late:.3f}}}"
    return f"imu: {{late: {(map_.imu.late if map_.imu else 0.0) + late:.3f}}}"


def _clock_key(map_: Map, gains: float, imu_gains: float | None) -> str:
    """Return the key that mends a truth's clock that gains `gains` on the ranges' clock [s/s]."""
    if imu_gains is not None and abs(imu_gains) < abs(gains) / 2.0:  # truth and imu agree: the ranges' clock is wrong
        return " and ".join(unit_key(map_, 1.0 + gains, key) for key in ("ranges", "differences") if getattr(map_, key))
    return unit_key(map_, 1.0 / (1.0 + gains), "truth")
