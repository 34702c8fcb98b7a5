"""Anchors that are not where the map has them: some change places, or one was surveyed or typed wrongly.

With a truth, each anchor's ranges tell its place in the truth's frame, and these places are matched with the map's.
Without a truth, and for differences, the places are exchanged two at a time, going on from the exchanges that fit best.
A single anchor is wrong if the others fit without it; its ranges then tell its place.
"""

from itertools import combinations, permutations

import numpy as np
from scipy.optimize import least_squares, linear_sum_assignment

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.studies.recorded.calibrate import found_roughly
from ortilo_drake.studies.recorded.plain_fit import SPREAD, PlainFit, Reading, left_of
from ortilo_drake.studies.recorded.readings import ALIKE, BETTER, Guess, Trial, path_of
from ortilo_drake.studies.recorded.truth_path import LEAST, TruthPath, covered_ranges, modelled

BEST = 3  # orders that go on to the next exchange of two places
CLEARLY = 1.4  # factor of a pair's gain where all fits well: on real recordings no wrong pair gains anything
SAME = 1.2  # orders whose summed distances are within this factor of the least count as equal: the map's is preferred
HEADINGS, SOME = 36, 60  # headings tried between found places and map; ranges used for an anchor's place
ALL_HEADINGS = 8  # with more anchors, pairs are tried only from the frame already found
ALONE = 1.5  # one anchor is wrong if leaving out any other leaves a residual larger by this factor
TYPED = 0.5  # a slip of the pen is told if it adds at most this cost for each range: errors of 0.07 m
BIAS = 0.15  # standard deviation of the bias of that anchor's ranges [m]
FEWEST = 6  # without a truth, one of at least so many anchors may be left out

Order = tuple[int, ...]  # for each anchor, the index of its place in the map


def worst_anchor(fit: PlainFit, anchors: np.ndarray) -> float:
    """Return the RMS error of the ranges of the anchor that fits worst, each anchor with a bias of its own [m]."""
    heard, worst = fit.heard, 0.0
    errors = modelled(fit.places, anchors, np.full(len(anchors), fit.bias), heard) - heard.r
    for i in range(len(anchors)):
        e = np.concatenate([errors[heard.anchor == i], -errors[heard.other == i]])
        worst = max(worst, left_of(e - np.median(e))) if len(e) else worst
    return worst


def names_of(map_: Map, n: int) -> list[str]:
    """Return the anchors' names in the map, or else their topics, or else their numbers in the list, from 1."""
    named = map_.names or (tuple(map_.anchors) if isinstance(map_.anchors, dict) else ())
    named = named or (() if map_.ranges is None else tuple(map_.ranges.topics))
    return [f"'{name}'" for name in named] if len(named) == n else [str(i + 1) for i in range(n)]


def matched_order(trial: Trial, map_: Map) -> Guess | None:
    """Return the order of the anchors by their places in the truth's frame, if it fits clearly better."""
    path = path_of(trial.now)
    order = tuple(range(len(trial.now.anchors))) if path is None else _matched(trial, path)
    return _best_of(trial, map_, _fits(trial, [order], path, None))


def exchanged_order(trial: Trial, map_: Map, exchanges: int = 2, by: float = BETTER) -> Guess | None:
    """Return the order after some exchanges of two anchors whose residual is smaller by the factor `by`, if any."""
    n, path = len(trial.now.anchors), path_of(trial.now)
    near = trial.fit if path is not None and n > ALL_HEADINGS else None
    own = tuple(range(n))
    best, known = [own], {own}
    for k in range(exchanges):
        tried = {_exchanged(order, i, j) for order in best for i, j in combinations(range(n), 2)}
        tried = (tried | ({own[::-1], (*own[1:], 0), (n - 1, *own[:-1])} if k == 0 else set())) - known
        known |= tried
        fits = _fits(trial, sorted(tried), path, near)
        if guess := _best_of(trial, map_, fits, by):
            return guess
        best = [order for order, _ in fits[:BEST]]
    return None


def _fits(
    trial: Trial, orders: list[Order], path: TruthPath | None, near: PlainFit | None
) -> list[tuple[Order, PlainFit]]:
    """Return orders with their fits, the best first."""
    read = [trial.now._replace(anchors=trial.now.anchors[list(order)]) for order in orders]
    fits = [(order, trial.fit_of(one, path, near)) for order, one in zip(orders, read, strict=True)]
    return sorted(((order, fit) for order, fit in fits if fit is not None), key=lambda one: one[1].cost)


def _best_of(trial: Trial, map_: Map, fits: list[tuple[Order, PlainFit]], by: float = BETTER) -> Guess | None:
    """Return the best order, if clearly better; without a truth all that fit as well, as a room's mirror image does."""
    good = [(order, fit.left) for order, fit in fits if trial.is_better(fit, trial.now, by)]
    if not good:
        return None
    least = min(left for _, left in good)
    alike = [order for order, left in good if left <= ALIKE * least][: None if trial.now.truth is None else 1]
    names = names_of(map_, len(trial.now.anchors))
    said = " or ".join(dict.fromkeys(_said(order, names) for order in alike))
    return Guess(f"anchors: {said}", trial.fit.left, least)


def _matched(trial: Trial, path: TruthPath) -> Order:
    """Return the map's place nearest to each anchor's place by its ranges; the map's order if unknown."""
    now, n = trial.now, len(trial.now.anchors)
    own, best = tuple(range(n)), (np.inf, tuple(range(n)))
    ranges = now.ranges.only(np.flatnonzero(now.ranges.other < 0))
    for offset in trial.offsets:
        chosen = covered_ranges(ranges, float(offset), path)
        of_each = [chosen[ranges.anchor[chosen] == i] for i in range(n)]
        if min(map(len, of_each)) < LEAST:
            continue
        of_each = [at[:: max(1, len(at) // SOME)] for at in of_each]
        fits = [found_roughly(path.at(ranges.t[at] + offset)[0], ranges.r[at]) for at in of_each]
        cost = sum(one.cost / len(at) for one, at in zip(fits, of_each, strict=True))
        if cost < best[0]:
            best = cost, _alike(np.array([one.x for one in fits]), now.anchors, now.frame == "same")
    return best[1] if np.isfinite(best[0]) else own


def _alike(found: np.ndarray, anchors: np.ndarray, same: bool) -> Order:
    """Return the anchor (n, 3) of each found place (n, 3); the frame is turned about z and shifted unless `same`."""
    tried: list[tuple[float, Order]] = []
    for yaw in (0.0,) if same else np.linspace(0.0, 2.0 * np.pi, HEADINGS, endpoint=False):
        c, s = np.cos(yaw), np.sin(yaw)
        p = found @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        p = p if same else p - p.mean(axis=0) + anchors.mean(axis=0)
        apart = np.linalg.norm(p[:, None] - anchors, axis=2)
        order = linear_sum_assignment(apart)[1]
        tried.append((float(apart[np.arange(len(order)), order].sum()), tuple(int(i) for i in order)))
    most = SAME * min(tried)[0]
    return max((sum(i == j for i, j in enumerate(order)), -total, order) for total, order in tried if total <= most)[2]


def _exchanged(order: Order, i: int, j: int) -> Order:
    new = list(order)
    new[i], new[j] = order[j], order[i]
    return tuple(new)


def _said(order: Order, names: list[str]) -> str:
    n = len(order)
    pairs = [(i, j) for i, j in enumerate(order) if order[j] == i and i < j]
    if order == tuple(range(n))[::-1] and n > 3:
        return "in reverse order"
    if sum(i != j for i, j in enumerate(order)) == 2 * len(pairs):
        return f"entries {', '.join(f'{names[i]} and {names[j]}' for i, j in pairs)} change places"
    if order == (*range(1, n), 0):
        return "the first one last"
    if order == (n - 1, *range(n - 1)):
        return "the last one first"
    return f"in the order {', '.join(names[i] for i in order)}"


def moved_anchor(trial: Trial, map_: Map) -> Guess | None:
    """Return the place of the one anchor whose entry is wrong, if the others fit clearly better without it."""
    now, n, path = trial.now, len(trial.now.anchors), path_of(trial.now)
    if path is None and n < FEWEST:
        return None
    tried = ((i, trial.fit_of(now._replace(without=i), path)) for i in range(n))
    fits = sorted(((i, fit) for i, fit in tried if fit is not None), key=lambda one: one[1].left)
    if len(fits) < 2:
        return None
    (i, fit), (_, second) = fits[:2]
    if not trial.is_better(fit, now) or second.left < ALONE * fit.left:
        return None
    name, own = names_of(map_, n)[i], now.anchors[i]
    place = _place(fit, now, i)
    moved = now.anchors.copy()
    moved[i] = place
    whole = trial.fit_of(now._replace(anchors=moved), path)
    if whole is None or not trial.is_better(whole, now):
        return None  # the anchor's ranges are wrong, as behind metal, not its place
    return Guess(f"anchors: entry {name} at {point_text(place)}, not {point_text(own)},", trial.fit.left, whole.left)


def _place(fit: PlainFit, now: Reading, i: int) -> np.ndarray:
    """Return an anchor's place (3) by its ranges from the antenna's places: the smallest slip of the pen that fits.

    Tried in order: axes exchanged or a sign turned, one coordinate, all three; of mirror images the nearer one.
    """
    rows = np.flatnonzero((fit.heard.anchor == i) | (fit.heard.other == i))
    heard, p, anchors, c = fit.heard.only(rows), fit.places[rows], now.anchors.copy(), np.zeros(len(now.anchors))
    own, none = now.anchors[i], np.zeros((3, 0))

    def fitted(start: np.ndarray, free: np.ndarray) -> tuple[float, np.ndarray]:
        """Return cost and place of a fit from `start`, moved along the axes `free` (3, k), with a bias of its own."""

        def residuals(y: np.ndarray) -> np.ndarray:
            anchors[i] = start + free @ y[1:]
            c[:], c[i] = fit.bias, fit.bias + y[0]
            return np.append((modelled(p, anchors, c, heard) - heard.r) / SPREAD, y[0] / BIAS)

        found = least_squares(residuals, np.zeros(1 + free.shape[1]), loss="soft_l1")
        return float(found.cost), start + free @ found.x[1:]

    middle, axes = now.anchors.mean(axis=0), np.eye(3)
    around = [own + 0.1, *(own + 2.0 * (middle - own) * axis for axis in axes), middle]
    anywhere = [fitted(start, axes) for start in around]
    least = min(cost for cost, _ in anywhere)
    swapped = [own[list(order)] for order in permutations(range(3))] + [own * (1 - 2 * axis) for axis in axes]
    edits = [fitted(edit, none) for edit in swapped]
    edits += [
        min((fitted(own + by * axis, axis[:, None]) for by in (-1.0, 1.0)), key=lambda one: one[0]) for axis in axes
    ]
    good = [place for cost, place in edits if cost <= least + TYPED * len(rows)]
    near = [place for cost, place in anywhere if cost <= ALIKE * least]
    return np.round(good[0] if good else min(near, key=lambda a: float(np.linalg.norm(a - own))), 2)


def point_text(p: np.ndarray) -> str:
    """Return a place (3) as a YAML list."""
    return f"[{', '.join(f'{v:g}' for v in p)}]"
