"""Fisher information on position and velocity in UWB ranges and in their differences.

A range r = d + s(d) v, v standard normal, has the log-likelihood -ln s - (r - d)^2 / (2 s^2), and its Fisher
information about d is 1 / s^2 + 2 (s' / s)^2 (Kay, "Fundamentals of Statistical Signal Processing: Estimation Theory",
1993, eq. 3.31): noise that grows with the distance has information about the distance. With s = s_0 + s_1 d the Fisher
information is (1 + 2 s_1^2) / s^2. In a round of ranging, range i is measured s_i before its message's stamp, where
d = |p - s_i v - a_i|.

A difference r_ab = d_b - d_a + s v, s^2 = (s_0 + s_1 d_a)^2 + (s_0 + s_1 d_b)^2, of a packet with the age t, with
d_i = |p - t v_WB - a_i| and unit vectors u_i from the anchors, has the information about position

    g g^T / s^2 + (grad s^2) (grad s^2)^T / (2 s^4),   g = u_b - u_a

and the gradients with respect to velocity are -t times those with respect to position. This gives two rows. The second
one, of grad s^2, has the variance 2 s^4 and depends on no lasting error.
"""

import numpy as np

from ortilo_drake.model.geometry.line_of_sight import walls_crossed
from ortilo_drake.model.range_pairs import pairs_in_turn
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import N_X
from ortilo_drake.scenario import Scenario, Uwb
from ortilo_drake.sensors.information_rows import SOURCE, rows_of
from ortilo_drake.sensors.unknown_error import Seen
from ortilo_drake.world.sensors.uwb import receiver_of


def range_rows(settings: Uwb, room: Room, truth: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Return the rows of the ranges to all anchors in reach, in the ticks marked in `seen` (n).

    `truth` holds the true states (n, 12). The excess length of a range behind a wall counts as known.
    """
    *_, s_0, s_1, _, most_walls, max_distance = receiver_of(settings, room)
    ticks = np.flatnonzero(seen)
    p_AB = truth[ticks, np.newaxis, :3] - room.anchor_positions  # (ticks, anchors, 3)
    d = np.linalg.norm(p_AB, axis=2)
    there = (d <= max_distance) & (d > 0.0)
    if np.isfinite(most_walls):
        for k, i in np.argwhere(there):
            p_WB = np.ascontiguousarray(truth[ticks[k], :3])
            there[k, i] = walls_crossed(p_WB, room.anchor_positions[i], room.wall_boxes) <= most_walls
    k, i = np.nonzero(there)
    gradients = _with_velocity(p_AB[k, i] / d[k, i, np.newaxis], settings.ages(len(room.anchors))[i])
    return rows_of(ticks[k], gradients, (s_0 + s_1 * d[k, i]) ** 2 / (1.0 + 2.0 * s_1**2), i)


NO_PAIR = -1  # source of a row whose information is in the noise


def difference_rows(scenario: Scenario, room: Room, truth: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Return the rows of the packets of anchors in reach; the source of the pair (a, b) of n anchors is a n + b.

    The uwb message reached the vehicle in the ticks marked in `seen` (n), at true states (n, 12).
    """
    uwb, anchors = scenario.uwb, room.anchor_positions
    *_, s_0, s_1, _, most_walls, max_distance = receiver_of(uwb, room)
    rows, every, n = uwb.rows(scenario.h), uwb.link.every(scenario.h), len(anchors)
    pairs, ticks = pairs_in_turn(uwb.pairs, n), np.repeat(np.flatnonzero(seen), rows)
    j = np.tile(np.arange(rows), np.count_nonzero(seen))
    a, b = pairs[(ticks // every * rows + j) % len(pairs)].T
    age = every * scenario.h / rows * (rows - 1 - j)
    p = truth[ticks, :3] - age[:, np.newaxis] * truth[ticks, 6:9]
    d_a, d_b = (np.linalg.norm(p - anchors[i], axis=1) for i in (a, b))
    there = (np.maximum(d_a, d_b) <= max_distance) & (np.minimum(d_a, d_b) > 0.0)
    if np.isfinite(most_walls):
        for k in np.flatnonzero(there):
            crossed = [walls_crossed(p[k], anchors[i], room.wall_boxes) for i in (a[k], b[k])]
            there[k] = max(crossed) <= most_walls
    ticks, a, b, age, p, d_a, d_b = (its[there] for its in (ticks, a, b, age, p, d_a, d_b))
    u_a, u_b = (p - anchors[a]) / d_a[:, np.newaxis], (p - anchors[b]) / d_b[:, np.newaxis]
    sd_a, sd_b = s_0 + s_1 * d_a, s_0 + s_1 * d_b
    variance = sd_a**2 + sd_b**2
    found = rows_of(ticks, _with_velocity(u_b - u_a, age), variance, a * n + b)
    if s_1 == 0.0:
        return found
    grad = 2.0 * s_1 * (sd_a[:, np.newaxis] * u_a + sd_b[:, np.newaxis] * u_b)
    return np.concatenate((found, rows_of(ticks, _with_velocity(grad, age), 2.0 * variance**2, NO_PAIR)))


def _with_velocity(g: np.ndarray, age: np.ndarray) -> np.ndarray:
    """Return gradients over the states (n, 12), given gradients by position (n, 3) and ages (n) [s]."""
    gradients = np.zeros((len(g), N_X))
    gradients[:, :3], gradients[:, 6:9] = g, -age[:, np.newaxis] * g
    return gradients


def between(n: int) -> Seen:
    """Return the coefficients, in rows of differences, of one error for each of n anchors: 1 for b, -1 for a."""

    def coefficients(rows: np.ndarray) -> np.ndarray:
        source = rows[:, SOURCE].astype(int)
        is_pair, eye = (source >= 0)[:, np.newaxis], np.eye(n)
        return np.asarray(is_pair * (eye[source % n] - eye[np.maximum(source, 0) // n]))

    return coefficients
