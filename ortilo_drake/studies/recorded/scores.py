"""The scores of an estimate: errors against the truth, by evo and by axis, consistency, availability."""

from dataclasses import dataclass, replace

import numpy as np

from ortilo_drake.model.optional import check_installed
from ortilo_drake.model.white_noise import nees_of
from ortilo_drake.studies.recorded.filtered import Estimate
from ortilo_drake.studies.recorded.plain_fit import left_of
from ortilo_drake.studies.recorded.reacquired import Lost

RPE_OVER = 1.0  # duration of the relative position error [s]


@dataclass(frozen=True)
class Scores:
    """Scores of one row; scores that need a truth are None without one.

    rmse: by axis [m]; ate, ate_aligned: RMSE of the absolute position error, as it is and after the best SE(3) [m];
    rpe: RMSE of the relative position error over 1 s [m]; nees: mean of e' P^-1 e (3 if consistent); nis: mean over the
    ranges taken (about 1); rejected: share of the ranges left out; available: share of the judged stamps at which the
    filter's own deviation is below the map's limit; gap_end, gap_end_largest: RMS and largest position error at the
    ends of the gaps [m]; lost: when the filter was lost; silent: the longest time without a range in each loss [s];
    rmse_found: RMS error by axis at other times [m]; largest: the largest position error [m], its time [s], and the
    time since the last range [s]; innovation: RMS of the ranges' innovations without the largest 5 % [m].
    """

    rmse: tuple[float, float, float] | None
    ate: float | None
    ate_aligned: float | None
    rpe: float | None
    nees: float | None
    nis: float
    rejected: float
    available: float
    gap_end: float | None = None
    gap_end_largest: float | None = None
    gaps: int = 0
    lost: tuple[Lost, ...] = ()
    silent: tuple[float, ...] = ()
    rmse_found: tuple[float, float, float] | None = None
    largest: tuple[float, float, float] | None = None
    innovation: float | None = None


def by_evo(t: np.ndarray, p: np.ndarray, truth: np.ndarray) -> tuple[float, float | None, float]:
    """Return ATE, ATE after the best SE(3), and RPE over a second [m], all RMSE, by the package evo.

    The aligned ATE is None where the best SE(3) is not unique, as for a body that stands still.

    Args:
        t: stamps [s] (m).
        p: estimates (m, 3).
        truth: true positions (m, 3).
    """
    check_installed("evo", "recorded")
    from evo.core.geometry import GeometryException
    from evo.core.metrics import APE, RPE, PoseRelation, Unit
    from evo.core.trajectory import PoseTrajectory3D

    kind = PoseRelation.translation_part
    no_turn = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1))
    both = (PoseTrajectory3D(truth, no_turn, t), PoseTrajectory3D(p.copy(), no_turn, t))
    ape = APE(kind)
    ape.process_data(both)
    over = max(1, round(RPE_OVER / float(np.median(np.diff(t)))))
    rpe = RPE(kind, over, Unit.frames, all_pairs=True)
    rpe.process_data(both)
    before, over_a_second = (float(np.sqrt(np.mean(m.error**2))) for m in (ape, rpe))
    try:
        both[1].align(both[0])
    except GeometryException:  # points on a line, or one point, fit more than one turn
        return before, None, over_a_second
    aligned = APE(kind)
    aligned.process_data(both)
    return before, float(np.sqrt(np.mean(aligned.error**2))), over_a_second


def nis_of(found: Estimate, begin: float, end: float) -> tuple[float, float]:
    """Return the mean NIS of the ranges taken between two stamps [s] (NaN without any), and the share refused."""
    counted = (found.range_stamps >= begin) & (found.range_stamps <= end)
    taken = found.run.taken & counted
    squares = found.run.innovation[taken] ** 2 / found.run.variance[taken]
    nis = float(np.mean(squares)) if len(squares) else float("nan")
    return nis, float(1.0 - taken.sum() / max(1, counted.sum()))


def score(found: Estimate, judged: np.ndarray, truth: np.ndarray | None, available_below: float) -> Scores:
    """Return the scores of an estimate at its `judged` stamps (mask (m)); truth (m, 3), limit of the deviation [m]."""
    t, P, stamps, lost = found.t[judged], found.P[judged], found.range_stamps, tuple(found.lost)
    available = float(np.mean(np.sqrt(np.trace(P, axis1=1, axis2=2)) < available_below))
    silent = tuple(_silent(stamps, since, until) for since, until in lost)
    e_r = found.run.innovation[(stamps >= t[0]) & (stamps <= t[-1])]
    scores = Scores(None, None, None, None, None, *nis_of(found, t[0], t[-1]), available)
    scores = replace(scores, lost=lost, silent=silent, innovation=left_of(e_r) if len(e_r) else None)
    if truth is None:
        return scores
    e, there = (found.p - truth)[judged], not_lost_at(t, lost)
    errors = np.linalg.norm(e, axis=1)
    worst = float(t[errors.argmax()])
    ate, ate_aligned, rpe = by_evo(t, found.p[judged], truth[judged])
    return replace(
        scores,
        rmse=rms_by_axis(e),
        ate=ate,
        ate_aligned=ate_aligned,
        rpe=rpe,
        nees=float(np.mean(nees_of(e, P))),
        rmse_found=rms_by_axis(e[there]) if there.any() else None,
        largest=(float(errors.max()), worst, worst - float(stamps[stamps <= worst][-1])),
    )


def _silent(stamps: np.ndarray, since: float, until: float | None) -> float:
    """Return the longest time between two ranges' stamps from `since` until `until` [s]; None: until the last one."""
    inside = stamps[(stamps >= since) & (stamps <= (np.inf if until is None else until))]
    return float(np.diff(inside).max(initial=0.0))


def not_lost_at(t: np.ndarray, lost: tuple[Lost, ...]) -> np.ndarray:
    """Return the mask of the stamps t (m) [s] at which the filter was not lost (m)."""
    there = np.ones(len(t), dtype=bool)
    for since, until in lost:
        there &= (t <= since) | (t >= (np.inf if until is None else until))
    return there


def rms_by_axis(e: np.ndarray) -> tuple[float, float, float]:
    """Return the root mean square of errors (m, 3) by axis."""
    x, y, z = (float(axis) for axis in np.sqrt(np.mean(e**2, axis=0)))
    return x, y, z
