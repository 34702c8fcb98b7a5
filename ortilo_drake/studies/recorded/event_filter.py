"""The tight filter driven by recorded events: ranges, their differences, IMU samples and aids, each at its own stamp.

States, propagation and scalar updates come from onboard/estimator/tight. The states are position p and velocity v of
the estimated point, attitude R (body to world), biases b_g of the gyro and b_a of the accelerometer; for each anchor a
bias c_i [m] that wanders slowly and an error g_i [m] that lasts for tau (first-order Gauss-Markov); the flow's scale
error s; and drag's k. The latest samples of gyro and accelerometer hold until the next ones.

A range to anchor i, and the difference of the ranges to b and a, of a tag at the lever l from p in body axes, are

    r_i = |p + R l - a_i| + c_i + g_i + white,   r_ab = r_b - r_a

Ranges are taken one at a time. A range is left out if its innovation exceeds the gate times its standard deviation, or
if its anchor is still refused (anchor_trust.py). Boxes are associated with landmarks and taken as in tight/pixels.py.
Where the height is known or constant, a row of z or v_z comes first at each epoch. Without an IMU there are no samples
and no variance of R, b_g and b_a: the filter is then the constant-velocity filter, driven by white acceleration.
imu_watch.py handles a vehicle at rest, its take-off, and an accelerometer that fails.
"""

from typing import NamedTuple

import numpy as np

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.onboard.estimator.tight.layout import THETA
from ortilo_drake.onboard.estimator.tight.update import Taken, none_taken, settle
from ortilo_drake.studies.recorded.anchor_trust import ASTRAY, Trust, accept_range, is_lost, new_trust, weigh_by
from ortilo_drake.studies.recorded.event_rows import (
    ROOM,
    Now,
    grown_at,
    own_row,
    take,
    take_boxes,
    take_level,
    take_start,
    variance_of,
)
from ortilo_drake.studies.recorded.filter_types import (
    BOXES,
    ENTRIES,
    FLOW,
    FORCE,
    LANDED,
    QUERY,
    RANGE,
    RATES,
    Events,
    EventValues,
    Restart,
    Run,
    Setup,
    SparseRow,
    State,
)
from ortilo_drake.studies.recorded.imu_watch import (
    AVERAGED,
    HELD,
    RESTS,
    doubt_force,
    force_agrees,
    rest_again,
    watch_range,
    watch_rest,
)
from ortilo_drake.studies.recorded.passing import (
    STALE,
    Passing,
    accumulate,
    empty_passing,
    propagate_over,
    reset_passing,
)
from ortilo_drake.studies.recorded.run_tape import cut_to, room_for, write_query, write_range, write_step

EPOCH, FORCE_AT, RATES_AT, GROWN, LOW, BEGUN = range(6)  # indices into `marks`


class Carried(NamedTuple):
    """The values carried from one event to the next beside the state.

    These are the anchors' record, the time passed, rows that wait, a blank row, marks and usual. marks (6): stamps of
    the last epoch and of the last samples of force and rates [s], the factor of range noise near the floor, whether it
    is so large that no range counts, and whether the first epoch is past. usual (n, 2): the mean of measured less
    expected range at rest [m] of each anchor, and the number of ranges in it. A run that goes on with these values
    gives the same bits as one run over all events, if one run takes in all events of one stamp.
    """

    trust: Trust
    passing: Passing
    waiting: Taken
    row: SparseRow
    marks: np.ndarray
    usual: np.ndarray


@cached_njit
def initial_carried(anchors: int, N: int, t: float) -> Carried:
    """Return the values carried at the start of a run at t [s], with N error states."""
    row = SparseRow(np.zeros(ENTRIES, np.int64), np.zeros(ENTRIES), np.empty(N))
    marks = np.array([-np.inf, t, t, 1.0, 0.0, 0.0])
    return Carried(new_trust(anchors), empty_passing(N), none_taken(ROOM, N), row, marks, np.zeros((anchors, 2)))


@cached_njit
def run_filter(
    events: Events,
    heard_all: EventValues,
    start: State,
    carried: Carried,
    anew: Restart,
    setup: Setup,
    wait: float,
    whole: bool,
) -> tuple[Run, State, int]:
    """Run the filter over events, to their end or until it is lost.

    Returns the run, the state after it, and the number of events taken in: fewer than all if the filter was lost.

    Args:
        events: in order of time; later than all events of the run that this one continues.
        heard_all: the values that the events index.
        start: the state before the first event; the attitude's variance is 0 without an IMU.
        carried: the values left by the run before, or initial_carried; changed.
        anew: position and velocity to start anew from.
        setup: the settings that hold throughout.
        wait: the filter does not stop as lost before this stamp [s].
        whole: whether to write the tape that a smoother needs.
    """
    total, N, noise, aids = len(events.t), start.C.shape[0], setup.noise, setup.aids
    t, x, C, held, watched = start.t, start.x.copy(), start.C.copy(), start.held.copy(), start.watched.copy()
    run, written = room_for(events, N, whole)
    trust, passing, waiting, row, marks = carried.trust, carried.passing, carried.waiting, carried.row, carried.marks
    now = Now(x, C, waiting, row, run.tape, written, watched)
    epoch, force_at, rates_at, grown = marks[EPOCH], marks[FORCE_AT], marks[RATES_AT], marks[GROWN]
    imu = C[THETA, THETA] > 0.0  # not by the imu's events: a live run while the imu is silent has none
    low, begun, done = marks[LOW] > 0.0, marks[BEGUN] > 0.0, total
    for k in range(total):
        h, kind = events.t[k] - t, events.kind[k]
        if h > 0.0:
            settle(C, waiting)
            accumulate(x, passing, h, held, watched, t, noise, aids, t - min(force_at, rates_at) > STALE and imu)
            t = events.t[k]
        if kind == RATES:
            held[:3], rates_at = heard_all.rates[events.which[k]], t
            continue
        if kind == FORCE:
            f = heard_all.force[events.which[k]].copy()
            if watched[RESTS] > 0.0:
                watch_rest(x, C, watched, f[2], t - force_at)
            elif aids.drag >= 0.0:
                settle(C, waiting)
                doubt_force(f, x, C, watched, t, t - force_at, aids)  # which replaces the doubted axes of f
            held[3:], force_at = f, t
            if watched[RESTS] > 0.0 or max(watched[HELD], watched[HELD + 1]) < AVERAGED:
                continue
        if passing.time[0] > 0.0:
            propagate_over(C, x, passing, grown, len(setup.anchors), noise)
            write_step(run.tape, written, passing)
            reset_passing(passing)
        new = t > epoch
        if new:
            settle(C, waiting)
            astray = C[0, 0] + C[1, 1] + C[2, 2] > ASTRAY**2
            grown = grown_at(x, C[2, 2], setup.levers[0], noise, aids)
            low = grown > 2.0  # all ranges are wrong there: none shows that the filter is lost
            lost = astray or (not low and is_lost(t, trust))
            if lost and kind == RANGE and t >= wait and watched[RESTS] == 0.0:
                done = k
                break
            epoch = t
        if not begun and anew.variances[0] < np.inf:
            for i in range(N):
                C[i, i] += anew.opening[i]
            if watched[RESTS] == 0.0:
                take_start(now, anew)
        begun = True
        if new and watched[RESTS] == 0.0:
            take_level(now, setup.levers[0], setup.level)
        if kind == QUERY:
            settle(C, waiting)
            write_query(run, written, x, C)
            continue
        if kind == BOXES:
            if watched[RESTS] == 0.0:
                take_boxes(heard_all.boxes[events.which[k]], now, held[:3], setup)
            continue
        rows = 0 if watched[RESTS] > 0.0 else 2 if kind in (FORCE, FLOW) else 4 if kind == LANDED else 1
        for axis in range(rows):
            e, r, m = own_row(k, axis, events, heard_all, now, held[:3], setup, grown)
            if m == 0:
                continue
            own = variance_of(now, row, m)
            S = own + r
            squared = e * e / S
            taken = e * e <= noise.gate**2 * S
            if kind == RANGE:
                i, passes = events.which[k], taken
                weighed = weigh_by(trust, i, t, e, S, noise.reflected)
                taken = accept_range(trust, i, t, e, S, passes, low)
                write_range(run, written, e, S, taken)
                if noise.reflected > 0.0:
                    if taken or not passes:
                        take(now, row, weighed[0], weighed[1])
                    continue
            if kind == FORCE:
                taken = force_agrees(watched, axis, squared) and taken
            if squared > noise.huber**2:
                S = own + r * np.sqrt(squared) / noise.huber
            if taken:
                take(now, row, e, S)
        if kind == LANDED:
            rest_again(watched, carried.usual)
            trust.refused_from[:] = np.inf
        if kind == RANGE and rows == 0:
            e, r, m = own_row(k, 0, events, heard_all, now, held[:3], setup, grown)
            if m > 0 and events.other[k] < 0:
                watch_range(e, r, C, watched, carried.usual[events.which[k]])
            write_range(run, written, 0.0, 1.0, False)
    settle(C, waiting)
    marks[EPOCH], marks[FORCE_AT], marks[RATES_AT] = epoch, force_at, rates_at
    marks[GROWN], marks[LOW], marks[BEGUN] = grown, low, begun
    return cut_to(run, written), State(t, x, C, held, watched), done
