"""The tight filter driven by recorded events: ranges, their differences, IMU samples and aids, each at its own stamp.

States, propagation and scalar updates are those of onboard/estimator/tight: position p and velocity v of the point that
is estimated, attitude R (body to world), biases b_g of the gyro and b_a of the accelerometer; for each anchor a bias
c_i [m] that wanders slowly and an error g_i [m] that lasts for tau (first-order Gauss-Markov); and the flow's error of
scale s. The latest samples of gyro and accelerometer hold until the next ones.

A range to anchor i, and a difference of the ranges to b and a, with the antenna at the lever l from p in body axes:

    r_i = |p + R l - a_i| + c_i + g_i + white,   r_ab = r_b - r_a

taken one at a time, and left out if its innovation exceeds the gate times its standard deviation. An anchor that was
left out for a second, by far, comes back when its innovations are small on average: an error that fades would pull the
filter along as soon as it passed the gate. Where the height is known or constant, a row of z or v_z comes first at each
epoch. Without an IMU, no samples and no variance of R, b_g and b_a, this is the constant-velocity filter, driven by
white acceleration.

Until take-off the vehicle may be known to rest: then no force is integrated and nothing else is taken in. Take-off is
where the force upward, less gravity and SLACK, has added up to RISE (Page's cumulative sum, Biometrika 41, 1954).

An accelerometer is doubted axis by axis, where drag is given: a sample that is farther than `doubted` from what drag
makes is not used, and an axis of which more than FAILS of the samples of a second are such is not used any more. Drag
takes its place.
"""

import numpy as np
from numba import njit
from numba.extending import register_jitable

from ortilo_drake.model.vehicle import GRAVITY
from ortilo_drake.onboard.estimator.tight.drag import along_body, drag_step
from ortilo_drake.onboard.estimator.tight.floor_rows import finder_row, flow_row
from ortilo_drake.onboard.estimator.tight.inertial import inertial_step, matrix_of, propagate_covariance
from ortilo_drake.onboard.estimator.tight.layout import ACCEL, GYRO, N_INERTIAL, THETA, P, Q, V
from ortilo_drake.onboard.estimator.tight.ranges import range_row
from ortilo_drake.onboard.estimator.tight.update import correct, innovation_variance, none_taken, settle
from ortilo_drake.studies.recorded.filter_types import (
    BIASES,
    ENTRIES,
    FINDER,
    FLOW,
    FORCE,
    QUERY,
    RANGE,
    RATES,
    Aids,
    Anew,
    Events,
    Heard,
    Level,
    Noise,
    Run,
    State,
    Tape,
    Watch,
    nominal,
)

RECENT = 5.0  # an anchor counts among those heard if its last range is not older [s]
PATIENCE = 3.0  # so many times longer the filter is believed where all that it refuses is too long
SETTLES = 0.5  # innovations of an anchor that was refused for long are averaged over this time [s]
MOST = 8.0  # of these innovations, in standard deviations
FAR = 1.0  # what is refused by less may be a bias that the filter does not know of [m]
SETTLED = 1.0  # and it is heard again when their mean is below so many standard deviations
STEP = 0.01  # longest step of the propagation [s]
ROOM = 16  # rows that wait until the covariance is passed over
SLACK, RISE = 0.15, 0.2  # of the force upward at rest [m/s²], and of the speed upward that is no rest [m/s]
OFF = (0.05, 0.2)  # standard deviations of position and velocity that take-off adds [m], [m/s]
SPAN, FAILS = 1.0, 0.1  # share of doubted samples over so long [s] at which an axis has failed
UNKNOWN = 0.3  # standard deviation of what drag does not tell of the force then [m/s²]
NEAREST, LARGEST = 0.02, 10.0  # no antenna is nearer to the floor than this [m], and no error grows by more
LOW, UPRIGHT = 0.1, 0.5  # looking down needs this height [m] and R_33
nominal_at = register_jitable(nominal)


@register_jitable
def _anchor_entries(
    x: np.ndarray,
    R: np.ndarray,
    lever: np.ndarray,
    anchors: np.ndarray,
    i: int,
    sign: float,
    m: int,
    where: np.ndarray,
    row: np.ndarray,
) -> float:
    """Add sign times the row of the range to anchor i, its own states from entry m on; return that times the range."""
    gradient = np.empty(6)
    d = range_row(x[P : P + 3], R, lever, anchors[i], gradient)
    for k in range(6):
        row[k] += sign * gradient[k]
    for k, at in enumerate((BIASES + i, BIASES + len(anchors) + i)):
        where[m + k], row[m + k] = at, sign
        d += x[nominal_at(at)]
    return sign * d


@register_jitable
def _held(S: float, deviation: float) -> float:
    """Return the noise of a row that brings its variance S down to deviation², and no further.

    What is known of a height is known once: taken at every epoch as if it were new, it would soon be believed to death.
    """
    return 1.0 / (1.0 / deviation**2 - 1.0 / S)


@register_jitable
def _grown(x: np.ndarray, lever: np.ndarray, noise: Noise, aids: Aids) -> float:
    """Return by what ranges err more near the floor, at most LARGEST: a filter that is lost must hear some."""
    if noise.near_floor == 0.0:
        return 1.0
    down = matrix_of(x[Q : Q + 4])[2]
    z = x[P + 2] + down[0] * lever[0] + down[1] * lever[1] + down[2] * lever[2] - aids.floor
    return min(1.0 + (noise.near_floor / max(z, NEAREST)) ** 4, LARGEST)


@register_jitable
def _is_lost(
    t: float, refused_from: np.ndarray, heard_at: np.ndarray, mean: np.ndarray, far: np.ndarray, watch: Watch
) -> bool:
    """Return whether the refused ranges say that the filter is wrong, and not they.

    A range that is too long alone says little: it came by a detour. Three anchors that agree stand for the filter.
    """
    heard = refused = long_since = 0
    short = off = False
    for i in range(len(heard_at)):
        if heard_at[i] >= t - RECENT:
            heard += 1
            if refused_from[i] <= t - watch.refused:
                refused += 1
                short |= mean[i] < 0.0
                off |= far[i]
            if refused_from[i] <= t - PATIENCE * watch.refused:
                long_since += 1
    if refused < 2 or not off:
        return False
    if short:
        return heard - refused < 3 or refused > watch.share * heard
    return long_since >= 2 and heard - long_since < 3


@register_jitable
def _go_on(
    x: np.ndarray,
    A: np.ndarray,
    W: np.ndarray,
    h: float,
    held: np.ndarray,
    watched: np.ndarray,
    t: float,
    noise: Noise,
    aids: Aids,
) -> None:
    """Propagate the nominal state, transition and noise by h, in steps; the errors that fade are the caller's."""
    steps = int(np.ceil(h / STEP))
    dt = h / steps
    variances = np.array([noise.rotation**2 / dt, noise.acceleration**2 / dt])
    for _ in range(steps):
        f, R, v = held[3:].copy(), matrix_of(x[Q : Q + 4]), x[V : V + 3].copy()
        if watched[0] > 0.0:
            f = R[2] * GRAVITY + x[Q + 7 : Q + 10]
        for i in range(2):
            if watched[0] == 0.0 and watched[4 + i] <= t:
                f[i] = x[Q + 7 + i] - aids.drag * along_body(R, v, i)
        inertial_step(x, A, W, held[:3], f, dt, variances if watched[0] == 0.0 else np.array([variances[0], 0.0]))
        if watched[0] > 0.0:  # position and velocity are as they were, whatever tilt and biases are
            A[:THETA], W[:THETA], W[:, :THETA] = 0.0, 0.0, 0.0
            for i in range(THETA):
                A[i, i] = 1.0
        for i in range(2):
            if watched[0] == 0.0 and watched[4 + i] <= t:
                drag_step(A, W, R, v, i, aids.drag, dt, aids.drag_sd**2)


@register_jitable
def _doubt(f: np.ndarray, x: np.ndarray, C: np.ndarray, watched: np.ndarray, t: float, h: float, aids: Aids) -> None:
    """Put what drag makes in the place of a doubted sample's axis (3), and count it; an axis may fail."""
    R = matrix_of(x[Q : Q + 4])
    for i in range(2):
        made = x[Q + 7 + i] - aids.drag * along_body(R, x[V : V + 3], i)
        doubted = not abs(f[i] - made) <= aids.doubted
        if watched[4 + i] == np.inf:
            watched[2 + i] += min(1.0, h / SPAN) * (doubted - watched[2 + i])
            if watched[2 + i] > FAILS:
                watched[4 + i] = t
                x[Q + 7 + i] = 0.0
                C[ACCEL + i, ACCEL + i] += UNKNOWN**2
        if doubted:
            f[i] = made


@njit(cache=True)
def run_filter(
    events: Events,
    heard_all: Heard,
    anchors: np.ndarray,
    lever: np.ndarray,
    start: State,
    anew: Anew,
    level: Level,
    noise: Noise,
    aids: Aids,
    watch: Watch,
    whole: bool,
) -> tuple[Run, State, int]:
    """Run the filter over the events, to their end or until it is lost.

    Returns the run, the state behind it, and how many events it took in: fewer than there are if it was lost.

    Args:
        events: in order of time.
        heard_all: the numbers that they point to.
        anchors: positions (n, 3).
        lever: from the estimated point to the antenna, body axes (3).
        start: the state before the first event; the attitude's variance is 0 without an IMU.
        anew: position and velocity to start anew from.
        level: what is known of the height.
        noise: the noise.
        aids: range finder, flow and drag.
        watch: when it is lost.
        whole: whether to keep what a smoother needs.
    """
    n, total, N = len(anchors), len(events.t), start.C.shape[0]
    t, x, C, held, watched = start.t, start.x.copy(), start.C.copy(), start.held.copy(), start.watched.copy()
    ranges = queries = epochs = others = flows = 0
    last = -np.inf
    for k in range(total):
        kind = events.kind[k]
        ranges += kind == RANGE
        queries += kind == QUERY
        flows += kind == FLOW
        others += kind >= FINDER
        if kind > FORCE and events.t[k] > last:
            epochs, last = epochs + 1, events.t[k]
    steps = epochs if whole else 0
    rows = ranges + flows + others + 6 + 2 * epochs if whole else 0
    what = np.empty(steps + rows + (queries if whole else 0), np.int8)
    As, all_keeps = np.empty((steps, 9, N_INERTIAL)), np.empty((steps, N - GYRO))
    all_where, all_row = np.zeros((rows, ENTRIES), np.int64), np.zeros((rows, ENTRIES))
    gains, es, Ss = np.empty((rows, N)), np.empty(rows), np.empty(rows)
    C_out = np.empty((queries if whole else 0, 9, N))
    x_out, P_out = np.empty((queries, N + 1)), np.empty((queries, 3, 3))
    innovation, variance, taken = np.zeros(ranges), np.ones(ranges), np.zeros(ranges, np.bool_)
    refused_from, heard_at = np.full(n, np.inf), np.full(n, -np.inf)
    far = np.zeros(n, np.bool_)  # whether it was refused by far
    mean = np.zeros(n)  # of the innovations of an anchor that is refused, in standard deviations
    A, W, scratch = np.zeros((9, N_INERTIAL)), np.zeros((9, 9)), np.empty((9, N))
    where, row, PHt, waiting = np.zeros(ENTRIES, np.int64), np.zeros(ENTRIES), np.empty(N), none_taken(ROOM, N)
    keeps, walks = np.ones(N - GYRO), np.zeros(N - GYRO)
    for i in range(9):
        A[i, i] = 1.0
    epoch, passed, done, written, step, number = -np.inf, 0.0, total, 0, 0, 0
    heard = asked = 0
    begun, low, grown = False, False, 1.0
    force_at = t
    for k in range(total):
        h, kind = events.t[k] - t, events.kind[k]
        if h > 0.0:
            if waiting.number[0] > 0:
                settle(C, waiting)
            _go_on(x, A, W, h, held, watched, t, noise, aids)
            t, passed = events.t[k], passed + h
        if kind == RATES:
            held[:3] = heard_all.rates[events.which[k]]
            continue
        if kind == FORCE:
            f, h = heard_all.force[events.which[k]].copy(), t - force_at
            force_at = t
            if watched[0] > 0.0:
                watched[1] = max(0.0, watched[1] + h * (f[2] - GRAVITY - SLACK))
                watched[6] = watched[6] + h if watched[1] > 0.0 else 0.0
                if watched[1] > RISE:  # off, as if the force had been one since the sum was 0
                    watched[0], x[V + 2] = 0.0, watched[1] + SLACK * watched[6]
                    x[P + 2] += x[V + 2] * watched[6] / 2.0
                    for i in range(3):
                        C[P + i, P + i] += OFF[0] ** 2
                        C[V + i, V + i] += OFF[1] ** 2
            elif aids.drag >= 0.0:
                settle(C, waiting)
                _doubt(f, x, C, watched, t, h, aids)
            held[3:] = f
            continue
        if passed > 0.0:
            for i in range(n):
                keeps[BIASES + n + i - GYRO] = np.exp(-passed / noise.correlation_time)
                walks[BIASES + i - GYRO] = noise.bias_walk**2 * passed
                lasts = noise.range_correlated * grown
                walks[BIASES + n + i - GYRO] = lasts**2 * (1.0 - keeps[BIASES + n + i - GYRO] ** 2)
                x[nominal_at(BIASES + n + i)] *= keeps[BIASES + n + i - GYRO]
            for i in range(3):
                walks[i], walks[3 + i] = noise.rotation_bias**2 * passed, noise.acceleration_bias**2 * passed
            propagate_covariance(C, A, W, keeps, walks, scratch)
            if whole:
                what[written], As[step], all_keeps[step] = 0, A, keeps
                written, step = written + 1, step + 1
            A[:], W[:], passed = 0.0, 0.0, 0.0
            for i in range(9):
                A[i, i] = 1.0
        new = t > epoch
        if new:
            settle(C, waiting)
            astray = C[0, 0] + C[1, 1] + C[2, 2] > watch.astray**2
            grown = _grown(x, lever, noise, aids)
            low = grown > 2.0  # all ranges are wrong there, and none says that the filter is lost
            lost = astray or (not low and _is_lost(t, refused_from, heard_at, mean, far, watch))
            if lost and kind == RANGE and t >= watch.wait and watched[0] == 0.0:
                done = k
                break
            epoch = t
        if kind == QUERY:
            settle(C, waiting)
        # The rows of this event: those of a new start and of the level first, its own last.
        starts = 6 if not begun and anew.variances[0] < np.inf else 0
        if starts:
            for i in range(N):
                C[i, i] += anew.opening[i]
        begun = True
        own = 2 if kind == FLOW else 0 if kind == QUERY else 1
        for j in range(-starts - 2, own):
            if watched[0] > 0.0 or (-3 < j < 0 and not new):
                continue
            where[:], row[:], m = 0, 0.0, 6
            R = matrix_of(x[Q : Q + 4])
            accepted, S, e, r = True, 0.0, 0.0, 0.0
            if j < -2:
                i = j + 2 + starts
                where[0], row[0], e, r = i, 1.0, anew.x[i] - x[i], anew.variances[i]
            elif j == -2:
                if level.climb == np.inf:
                    continue
                where[0], row[0], e = V + 2, 1.0, -x[V + 2]
            elif j == -1:
                if level.deviation == np.inf:
                    continue
                where[0], row[0], e = P + 2, 1.0, level.height - x[P + 2]
                for i in range(3):
                    a, b = (i + 1) % 3, (i + 2) % 3
                    where[1 + i], row[1 + i] = THETA + i, lever[a] * R[2, b] - lever[b] * R[2, a]
                    e -= R[2, i] * lever[i]
            elif kind == RANGE:
                for i in range(3):
                    where[i], where[3 + i] = P + i, THETA + i
                b, a = events.which[k], events.other[k]
                e = events.r[k] - _anchor_entries(x, R, lever, anchors, b, 1.0, 6, where, row)
                m = 8
                if a >= 0:
                    e -= _anchor_entries(x, R, lever, anchors, a, -1.0, 8, where, row)
                    m = 10
                r = noise.range_white
                r *= grown
                r = r * r
            elif R[2, 2] < UPRIGHT or x[P + 2] - aids.floor < LOW:
                continue
            elif kind == FINDER:
                e = events.r[k] - finder_row(x[P : P + 3], R, aids.finder, aids.floor, where, row)
                r = aids.finder_sd**2
            else:
                w, scale_at = held[:3] - x[Q + 4 : Q + 7], N - 1
                y = flow_row(
                    j, x[P : P + 3], x[V : V + 3], R, w, aids.floor, aids.pixels, x[nominal_at(scale_at)], scale_at,
                    where, row,
                )  # fmt: skip
                e, r, m = heard_all.flow[events.which[k], j] - y, aids.flow_sd**2, 9
            S = innovation_variance(C, waiting, where, row, m, PHt)
            if j == -2 or j == -1:
                deviation = level.climb if j == -2 else level.deviation
                if not deviation**2 < S:
                    continue
                S += _held(S, deviation)
            elif j < 0:
                S += r
            else:
                own_S, S = S, S + r
                accepted = e * e <= noise.gate**2 * S
                if kind == RANGE:
                    i = events.which[k]
                    innovation[heard], variance[heard] = e, S
                    z = e / np.sqrt(S)
                    share = 1.0 if refused_from[i] == np.inf else 1.0 - np.exp((heard_at[i] - t) / SETTLES)
                    mean[i] += share * (min(max(z, -MOST), MOST) - mean[i])
                    heard_at[i] = t
                    far[i] = (far[i] and refused_from[i] < np.inf) or abs(e) > FAR
                    fades = far[i] and t - refused_from[i] >= watch.refused and abs(mean[i]) > SETTLED
                    accepted = accepted and not fades
                    taken[heard] = accepted
                    if accepted:
                        refused_from[i] = np.inf
                    elif refused_from[i] == np.inf and not low:
                        refused_from[i] = t
                squared = e * e / S
                if squared > noise.huber**2:
                    S = own_S + r * np.sqrt(squared) / noise.huber
            if not accepted:
                continue
            if whole:
                what[written], all_where[number], all_row[number], es[number], Ss[number] = 1, where, row, e, S
                gains[number] = PHt / S
                written, number = written + 1, number + 1
            correct(x, waiting, PHt, S, e, N)
            if waiting.number[0] == ROOM:
                settle(C, waiting)
        heard += kind == RANGE
        if kind == QUERY:
            settle(C, waiting)
            x_out[asked], P_out[asked] = x, C[:3, :3]
            if whole:
                what[written], C_out[asked] = 2, C[:9]
                written += 1
            asked += 1
    settle(C, waiting)
    tape = Tape(
        what[:written], As[:step], all_keeps[:step], all_where[:number], all_row[:number], gains[:number], es[:number],
        Ss[:number], C_out[:asked] if whole else C_out,
    )  # fmt: skip
    run = Run(x_out[:asked], P_out[:asked], innovation[:heard], variance[:heard], taken[:heard], tape)
    return run, State(t, x, C, held, watched), done
