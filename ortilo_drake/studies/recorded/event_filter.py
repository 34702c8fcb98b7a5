"""The tight filter driven by recorded events: ranges, their differences, IMU samples and aids, each at its own stamp.

States, propagation and scalar updates are those of onboard/estimator/tight: position p and velocity v of the point that
is estimated, attitude R (body to world), biases b_g of the gyro and b_a of the accelerometer; for each anchor a bias
c_i [m] that wanders slowly and an error g_i [m] that lasts for tau (first-order Gauss-Markov); the flow's error of
scale s; and drag's k. The latest samples of gyro and accelerometer hold until the next ones.

A range to anchor i, and a difference of the ranges to b and a, of a tag at the lever l from p in body axes:

    r_i = |p + R l - a_i| + c_i + g_i + white,   r_ab = r_b - r_a

taken one at a time, and left out if its innovation exceeds the gate times its standard deviation, or if its anchor has
yet to come back (anchors_heard.py). Boxes are given to landmarks and taken as in tight/pixels.py. Where the height is
known or constant, a row of z or v_z comes first at each epoch. Without an IMU, no samples and no variance of R, b_g and
b_a, this is the constant-velocity filter, driven by white acceleration. A vehicle that rests, and an accelerometer that
fails, are in imu_watch.py.
"""

import numpy as np
from numba import njit
from numba.extending import register_jitable

from ortilo_drake.onboard.estimator.tight.inertial import matrix_of
from ortilo_drake.onboard.estimator.tight.layout import Layout, P, Q, V
from ortilo_drake.onboard.estimator.tight.pixels import box_misfit, box_rows, pose_belief
from ortilo_drake.onboard.estimator.tight.update import Taken, correct, innovation_variance, settle
from ortilo_drake.onboard.landmarks.landmark_association import associate
from ortilo_drake.studies.recorded.anchors_heard import is_lost, judged
from ortilo_drake.studies.recorded.carried import BEGUN, EPOCH, FORCE_AT, GROWN, LOW, ROOM, Carried, nothing_carried
from ortilo_drake.studies.recorded.event_rows import (
    Row,
    distance_down_row,
    distance_row,
    grown_at,
    height_row,
    held_back,
    pixels_row,
    state_row,
    wipe,
)
from ortilo_drake.studies.recorded.filter_types import (
    BOXES,
    ENTRIES,
    FINDER,
    FLOW,
    FORCE,
    LANDED,
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
    Sight,
    State,
    Tape,
    Watch,
)
from ortilo_drake.studies.recorded.imu_watch import RESTS, doubt_force, rest_again, watch_rest
from ortilo_drake.studies.recorded.passing import begin_anew, go_on, pass_over
from ortilo_drake.studies.recorded.run_tape import cut_to, room_for, write_query, write_range, write_row, write_step

NEAR, UPRIGHT = 0.1, 0.5  # looking down needs this height [m] and R_33
LANDED_SD = (0.02, 0.03)  # standard deviations of velocity and height where it has landed [m/s], [m]


@register_jitable
def _take(
    x: np.ndarray, C: np.ndarray, waiting: Taken, row: Row, e: float, S: float, tape: Tape, written: np.ndarray
) -> None:
    """Take a row of innovation e, whose variance is S, and write it down."""
    write_row(tape, written, row, e, S)
    correct(x, waiting, row.PHt, S, e, C.shape[0])
    if waiting.number[0] == ROOM:
        settle(C, waiting)


@register_jitable
def _variance(C: np.ndarray, waiting: Taken, row: Row, m: int) -> float:
    """Return H C H^T of a row with m entries."""
    return innovation_variance(C, waiting, row.where, row.of, m, row.PHt)


@register_jitable
def _take_start(
    x: np.ndarray, C: np.ndarray, waiting: Taken, row: Row, anew: Anew, tape: Tape, written: np.ndarray
) -> None:
    """Take position and velocity to start anew from."""
    for i in range(6):
        wipe(row)
        state_row(i, row)
        S = _variance(C, waiting, row, 1) + anew.variances[i]
        _take(x, C, waiting, row, anew.x[i] - x[i], S, tape, written)


@register_jitable
def _take_level(
    x: np.ndarray,
    C: np.ndarray,
    waiting: Taken,
    row: Row,
    lever: np.ndarray,
    level: Level,
    tape: Tape,
    written: np.ndarray,
) -> None:
    """Correct with the known climb and height, as far as they are surer than the filter."""
    if level.climb < np.inf:
        wipe(row)
        state_row(V + 2, row)
        S = _variance(C, waiting, row, 1)
        if level.climb**2 < S:
            _take(x, C, waiting, row, -x[V + 2], S + held_back(S, level.climb), tape, written)
    if level.deviation < np.inf:
        wipe(row)
        e = height_row(x, matrix_of(x[Q : Q + 4]), lever, level.height, row)
        S = _variance(C, waiting, row, 4)
        if level.deviation**2 < S:
            _take(x, C, waiting, row, e, S + held_back(S, level.deviation), tape, written)


@register_jitable
def _own_row(
    k: int,
    axis: int,
    events: Events,
    heard_all: Heard,
    x: np.ndarray,
    held: np.ndarray,
    anchors: np.ndarray,
    levers: np.ndarray,
    grown: float,
    noise: Noise,
    aids: Aids,
    row: Row,
) -> tuple[float, float, int]:
    """Write the row of event k; return innovation, noise and the number of entries, 0 without a row.

    Of a flow that is the row along an axis, 0 or 1; of a landing those of the velocity, 0 to 2, and of the height, 3.
    What looks down says nothing near the floor or where the body is far from upright.
    """
    wipe(row)
    R, kind, seen = matrix_of(x[Q : Q + 4]), events.kind[k], events.r[k]
    if kind == RANGE:
        lever = levers[1 + events.tag[k]]
        e, m = distance_row(x, R, lever, anchors, events.which[k], events.other[k], seen, row)
        return e, (noise.range_white * grown) ** 2, m
    if kind == LANDED:
        at = V + axis if axis < 3 else P + 2
        state_row(at, row)
        return (0.0 if axis < 3 else seen) - x[at], LANDED_SD[axis // 3] ** 2, 1
    if R[2, 2] < UPRIGHT or x[P + 2] - aids.floor < NEAR:
        return 0.0, 0.0, 0
    if kind == FINDER:
        return distance_down_row(x, R, seen, aids, row), aids.finder_sd**2, 4
    seen, scale_at = heard_all.flow[events.which[k], axis], len(row.PHt) - 2
    return pixels_row(axis, x, R, held[:3], seen, scale_at, aids, row), aids.flow_sd**2, 9


@register_jitable
def _take_boxes(
    message: np.ndarray,
    x: np.ndarray,
    C: np.ndarray,
    waiting: Taken,
    rates: np.ndarray,
    noise: Noise,
    sight: Sight,
    tape: Tape,
    written: np.ndarray,
) -> None:
    """Give the boxes of a detections message to landmarks, and take their centres."""
    N, sd = C.shape[0], sight.noise
    layout = Layout(-1, -1, -1, -1, -1, -1, -1, N, 0, N)
    settle(C, waiting)
    xhat, P_pose = pose_belief(x, C, layout, -1)
    chosen, centers, _ = associate(
        message, xhat, P_pose, sight.positions, sight.outlines, sight.labels, sight.camera, sd[0], sight.gates[1], sd[1]
    )
    where, rows = np.zeros((2, ENTRIES), np.int64), np.zeros((2, ENTRIES))
    u, v = Row(where[0], rows[0], np.empty(N)), Row(where[1], rows[1], np.empty(N))
    for b in range(chosen.size):
        i, e, of_center = chosen[b], np.empty(2), np.zeros(2)
        at, outline, camera, seen = sight.positions[i], sight.outlines[i], sight.camera, centers[b]
        m = box_rows(x, layout, i, seen, at, outline, camera, sd, rates, -1, where, rows, e, of_center)
        if m == 0:
            continue
        r_u, r_v = of_center[0] ** 2, of_center[1] ** 2
        squared, S_u = box_misfit(C, waiting, where, rows, m, e, r_u, r_v, u.PHt, v.PHt)
        if not squared <= sight.gates[0]:
            continue
        weight = max(1.0, np.sqrt(squared) / noise.huber)
        _take(x, C, waiting, u, e[0], S_u + (weight - 1.0) * r_u, tape, written)
        m = box_rows(x, layout, i, seen, at, outline, camera, sd, rates, -1, where, rows, e, of_center)
        if m > 0:
            _take(x, C, waiting, v, e[1], _variance(C, waiting, v, m) + weight * r_v, tape, written)


@register_jitable
def _take_force(
    f: np.ndarray,
    x: np.ndarray,
    C: np.ndarray,
    waiting: Taken,
    watched: np.ndarray,
    t: float,
    h: float,
    aids: Aids,
) -> None:
    """Watch a sample of the specific force (3), h after the last; what is doubted of it is replaced."""
    if watched[RESTS] > 0.0:
        watch_rest(x, C, watched, f[2], h)
    elif aids.drag >= 0.0:
        settle(C, waiting)
        doubt_force(f, x, C, watched, t, h, aids)


@njit(cache=True)
def run_filter(
    events: Events,
    heard_all: Heard,
    anchors: np.ndarray,
    levers: np.ndarray,
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
        levers: from the estimated point to the point that the tags count from, and to each tag, body axes (1 + m, 3).
        start: the state before the first event; the attitude's variance is 0 without an IMU.
        anew: position and velocity to start anew from.
        level: what is known of the height.
        noise: the noise.
        aids: range finder, flow, drag and boxes.
        watch: when it is lost.
        whole: whether to keep what a smoother needs.
    """
    carried = nothing_carried(len(anchors), start.C.shape[0], start.t)
    return run_further(events, heard_all, anchors, levers, start, carried, anew, level, noise, aids, watch, whole)


@njit(cache=True)
def run_further(
    events: Events,
    heard_all: Heard,
    anchors: np.ndarray,
    levers: np.ndarray,
    start: State,
    carried: Carried,
    anew: Anew,
    level: Level,
    noise: Noise,
    aids: Aids,
    watch: Watch,
    whole: bool,
) -> tuple[Run, State, int]:
    """Continue a run over further events, all later than those before; see run_filter.

    Args:
        events: in order of time.
        heard_all: the numbers that they point to.
        anchors: positions (n, 3).
        levers: as run_filter's.
        start: the state that the last part ended with.
        carried: what it left; changed.
        anew: as at the start of the run.
        level: what is known of the height.
        noise: the noise.
        aids: range finder, flow, drag and boxes.
        watch: when it is lost.
        whole: whether to keep what a smoother needs.
    """
    n, total, N = len(anchors), len(events.t), start.C.shape[0]
    t, x, C, held, watched = start.t, start.x.copy(), start.C.copy(), start.held.copy(), start.watched.copy()
    run, written = room_for(events, N, whole)
    trust, passing, waiting, row, marks = carried.trust, carried.passing, carried.waiting, carried.row, carried.marks
    epoch, force_at, grown = marks[EPOCH], marks[FORCE_AT], marks[GROWN]
    low, begun, done = marks[LOW] > 0.0, marks[BEGUN] > 0.0, total
    for k in range(total):
        h, kind = events.t[k] - t, events.kind[k]
        if h > 0.0:
            settle(C, waiting)
            go_on(x, passing, h, held, watched, t, noise, aids)
            t = events.t[k]
        if kind == RATES:
            held[:3] = heard_all.rates[events.which[k]]
            continue
        if kind == FORCE:
            f = heard_all.force[events.which[k]].copy()
            _take_force(f, x, C, waiting, watched, t, t - force_at, aids)
            held[3:], force_at = f, t
            continue
        if passing.time[0] > 0.0:
            pass_over(C, x, passing, grown, n, noise)
            write_step(run.tape, written, passing)
            begin_anew(passing)
        new = t > epoch
        if new:
            settle(C, waiting)
            astray = C[0, 0] + C[1, 1] + C[2, 2] > watch.astray**2
            grown = grown_at(x, levers[0], noise, aids)
            low = grown > 2.0  # all ranges are wrong there, and none says that the filter is lost
            lost = astray or (not low and is_lost(t, trust, watch))
            if lost and kind == RANGE and t >= watch.wait and watched[RESTS] == 0.0:
                done = k
                break
            epoch = t
        if not begun and anew.variances[0] < np.inf:
            for i in range(N):
                C[i, i] += anew.opening[i]
            if watched[RESTS] == 0.0:
                _take_start(x, C, waiting, row, anew, run.tape, written)
        begun = True
        if new and watched[RESTS] == 0.0:
            _take_level(x, C, waiting, row, levers[0], level, run.tape, written)
        if kind == QUERY:
            settle(C, waiting)
            write_query(run, written, x, C)
            continue
        if kind == BOXES:
            if watched[RESTS] == 0.0:
                message = heard_all.boxes[events.which[k]]
                _take_boxes(message, x, C, waiting, held[:3], noise, aids.sight, run.tape, written)
            continue
        rows = 0 if watched[RESTS] > 0.0 else 2 if kind == FLOW else 4 if kind == LANDED else 1
        for axis in range(rows):
            e, r, m = _own_row(k, axis, events, heard_all, x, held, anchors, levers, grown, noise, aids, row)
            if m == 0:
                continue
            own = _variance(C, waiting, row, m)
            S = own + r
            squared = e * e / S
            taken = e * e <= noise.gate**2 * S
            if kind == RANGE:
                taken = judged(trust, events.which[k], t, e, S, taken, low, watch)
                write_range(run, written, e, S, taken)
            if squared > noise.huber**2:
                S = own + r * np.sqrt(squared) / noise.huber
            if taken:
                _take(x, C, waiting, row, e, S, run.tape, written)
        if kind == LANDED:
            rest_again(watched)
            trust.refused_from[:] = np.inf
        if kind == RANGE and rows == 0:
            write_range(run, written, 0.0, 1.0, False)
    settle(C, waiting)
    marks[EPOCH], marks[FORCE_AT], marks[GROWN], marks[LOW], marks[BEGUN] = epoch, force_at, grown, low, begun
    return cut_to(run, written), State(t, x, C, held, watched), done
