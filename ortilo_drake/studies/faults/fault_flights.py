"""Flights with one fault each, beside the same seeds without any."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.stats import chi2

from ortilo_drake.flight.intervals import Interval, Middle, middle_of, share_interval
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.planner.planned import path_of
from ortilo_drake.scenario import Scenario
from ortilo_drake.studies.faults.catalogue import LENGTH, START, Case, catalogue
from ortilo_drake.studies.faults.courses import BIN, Course, fly_courses
from ortilo_drake.theory.consistency.consistency import nees_interval

PASSES: Final = 1.5  # at most so many times the error without the fault
WITHIN_3_SIGMA: Final = float(chi2(3).ppf(chi2(1).cdf(3.0**2)))  # NEES of a position as far off as 3 sigma is, 14.16
SETTLES: Final = 2.0  # from a fault's end to where 'after' begins [s]
KNOWN: Final = 10.0  # from the start of a fault that does not end to where 'after' begins [s]
WINDOW: Final = 5.0  # for which an estimator must be good to have recovered [s]
Settings = tuple[tuple[str, Any], ...]


@dataclass(frozen=True)
class Phase:
    """The estimate in one part of the flights, those that were not lost all together.

    The error is the root mean square of the distance of estimated and true position [m], the ratio that over the error
    of the same seeds without the fault in the same ticks [1]. NEES is the mean of the position's, 3 if the filter is
    consistent, with its 95 % interval over flights by Student's t, cut at 0; None of fewer than two. Errors [m] and
    ratios are medians of those of each flight, with the lost ones as worst and without them.
    """

    error: float
    ratio: float
    nees: float
    nees_interval: Interval | None
    errors: Middle
    ratios: Middle


@dataclass(frozen=True)
class FaultRow:
    """Flights of a scenario with one fault.

    Attributes:
        fault: its name in the catalogue.
        scenario: its name.
        flights: how many.
        lost: how many of them.
        lost_share: Wilson's 95 % interval of the share lost [1].
        before: until the fault; None if all flights were lost, as the two below.
        during: from its start to its end; to 10 s after the start if it does not end.
        after: from 2 s after its end, or from there on, to the flight's end.
        recovery: from the fault's end, or its start if it does not end, to the first 5 s in which the error of all
            flights together is at most 1.5 times the one without the fault [s]; None if there are none.
        passed_during: during the fault the error is at most 1.5 times the one without it, or the filter knows that it
            is not: the mean NEES is at most WITHIN_3_SIGMA.
        passed_after: afterwards the error is at most 1.5 times the one without the fault.
        passed: no flight lost, and both.
        settings: the fault as the list `faults` of the scenario has it.
    """

    fault: str
    scenario: str
    flights: int
    lost: int
    lost_share: Interval
    before: Phase | None
    during: Phase | None
    after: Phase | None
    recovery: float | None
    passed_during: bool
    passed_after: bool
    passed: bool
    settings: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class FaultStudy:
    """The result of the study of faults, as `ortilo faults --json` writes it, a row by fault, then by scenario.

    Each row has so many flights. Faults begin at the start, those that end have the length [s]. Without a fault so many
    flights of each scenario were lost.
    """

    scenarios: list[str]
    flights: int
    start: float
    length: float
    lost_without: list[int]
    rows: list[FaultRow]


def fault_study(
    vary: Sequence[Callable[[Settings], Scenario]],
    names: Sequence[str],
    flights: int,
    out: Path,
    start: float = START,
    length: float = LENGTH,
    workers: int = 1,
    progress: Callable[[int], None] | None = None,
) -> FaultStudy:
    """Fly scenarios without a fault and with each fault, by name, that applies to them, on so many seeds from 0.

    Each scenario is one that `vary` returns with settings laid over it. The faults begin at the start, those that end
    have the length [s]. The folder of the courses, workers and progress are as fly_kept has them. InputError if a
    flight ends too early for anything to be seen after the fault.
    """
    wanted: list[tuple[Scenario, Case | None]] = []
    scenarios = []
    for make in vary:
        calm = make((("faults", []),))
        check_length(calm, start, length)
        scenarios.append(calm)
        wanted.append((calm, None))
        cases = [case for case in catalogue(calm, start, length) if case.name in names]
        wanted += [(make((("faults", [case.fault]),)), case) for case in cases]
    flown = fly_courses([(scenario, range(flights)) for scenario, _ in wanted], out, workers, progress)
    rows, without, lost_without = [], flown[0], []
    for (scenario, case), courses in zip(wanted, flown, strict=True):
        if case is None:
            without = courses
            lost_without.append(_lost(courses))
        else:
            rows.append(row_of(scenario.name, case, courses, without))
    rows.sort(key=lambda row: names.index(row.fault))  # stable: scenarios stay in their order
    return FaultStudy([s.name for s in scenarios], flights, start, length, lost_without, rows)


def check_length(scenario: Scenario, start: float, length: float) -> None:
    """Refuse a flight that ends too soon after its faults, and faults between half seconds."""
    for name, value in (("--start", start), ("--length", length)):
        if value % BIN != 0.0:
            raise InputError(f"{name} {value:g}: must be a multiple of {BIN:g} s")
    end = path_of(scenario).end_time() + scenario.settle
    least = start + max(length + SETTLES, KNOWN) + BIN
    if end < least:
        raise InputError(
            f"{scenario.name}: ends at {end:.1f} s: with faults from {start:g} s on it must fly to {least:g} s"
        )


def _lost(courses: Sequence[Course]) -> int:
    return sum(course.lost is not None for course in courses)


def row_of(scenario: str, case: Case, courses: Sequence[Course], without: Sequence[Course]) -> FaultRow:
    """Return the row of a fault of a scenario, by name, from the courses with it and of the same seeds without it."""
    pairs = [(a, b) for a, b in zip(courses, without, strict=True) if a.lost is None and b.lost is None]
    lost = _lost(courses)
    share = share_interval(lost, len(courses))
    if not pairs:
        none = (None, None, None, None, False, False, False, case.fault)
        return FaultRow(case.name, scenario, len(courses), lost, share, *none)
    square, calm, nees = map(np.array, zip(*((a.square, b.square, a.nees) for a, b in pairs), strict=True))
    first = round(case.start / BIN)
    last = round((case.start + KNOWN if case.end is None else case.end) / BIN)
    then = last if case.end is None else last + round(SETTLES / BIN)
    before, during, after = (
        _phase(square[:, part], calm[:, part], nees[:, part], lost)
        for part in (slice(0, first), slice(first, last), slice(then, None))
    )
    recovery = recovery_time(square, calm, first if case.end is None else last)
    good_during = during.ratio <= PASSES or during.nees <= WITHIN_3_SIGMA
    good_after = after.ratio <= PASSES
    verdict = good_during, good_after, lost == 0 and good_during and good_after
    return FaultRow(
        case.name, scenario, len(courses), lost, share, before, during, after, recovery, *verdict, case.fault
    )


def _phase(square: np.ndarray, calm: np.ndarray, nees: np.ndarray, lost: int) -> Phase:
    """Return a phase of flights that were not lost (flights, bins), and of so many that were."""
    each, its_calm = square.mean(axis=1), calm.mean(axis=1)
    return Phase(
        error=float(np.sqrt(square.mean())),
        ratio=float(np.sqrt(square.mean() / calm.mean())),
        nees=float(nees.mean()),
        nees_interval=nees_interval(nees.mean(axis=1)),
        errors=middle_of(np.sqrt(each).tolist(), lost),
        ratios=middle_of(np.sqrt(each / its_calm).tolist(), lost),
    )


def recovery_time(square: np.ndarray, calm: np.ndarray, origin: int) -> float | None:
    """Return the time from a bin, origin, to the first WINDOW in which the error is at most PASSES times the calm one.

    Both are mean squared errors (flights, bins) [m^2], of the same seeds with the fault and without it.
    """
    n = round(WINDOW / BIN)
    for k in range(origin, square.shape[1] - n + 1):
        if square[:, k : k + n].mean() <= PASSES**2 * calm[:, k : k + n].mean():
            return (k - origin) * BIN
    return None
