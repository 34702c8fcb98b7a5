"""Flights under each mismatch: at given values, and at levels that search for the one at which 5 % are lost."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from ortilo_drake.flight.ensemble import fly_kept
from ortilo_drake.flight.figures import FIGURES
from ortilo_drake.flight.flight import AXES
from ortilo_drake.flight.intervals import Interval, Middle, middle_of, share_interval
from ortilo_drake.flight.lost import NOT_LOST
from ortilo_drake.flight.players import flown_by
from ortilo_drake.flight.store import Count, Error
from ortilo_drake.scenario import Scenario
from ortilo_drake.studies.maps.chunks import fly_figures
from ortilo_drake.studies.sensitivity.loss_level import (
    BATCH,
    NO_LEVEL,
    Flown,
    LossLevel,
    is_settled,
    ladder,
    loses_more,
    loss_level,
    next_level,
)
from ortilo_drake.studies.sensitivity.mismatches import Mismatch, Settings, all_together, mismatches_of
from ortilo_drake.theory.consistency.consistency import nees_interval

COMPILED_AT_ONCE = 16  # flights in one job of a worker


@dataclass(frozen=True)
class Outcome:
    """The outcome of a flight in a study of mismatches: the seed of all noise, and whether it was lost.

    mse is the mean squared error of the estimate per axis [m^2] up to a loss, see metrics.estimation_mse; nees is the
    mean of metrics.position_nees up to a loss, 3 if the filter is consistent. player names the one of players.py that
    flew.
    """

    seed: Count
    lost: bool
    mse: dict[str, Error]
    nees: float
    player: str = ""


def outcome(seed: int, figures: Sequence[float]) -> Outcome:
    """Return a flight's outcome from its figures of flight/figures.py, which end where it diverged."""
    found = dict(zip(FIGURES, map(float, figures), strict=False))
    return Outcome(seed, found["cause"] != NOT_LOST, {axis: found[f"mse_{axis}"] for axis in AXES}, found["nees"])


def fly_outcomes_of(scenario_json: str, seeds: list[int], folder: str, player: str) -> list[Outcome]:
    """Fly some seeds and return their outcomes. Runs in a worker: the arguments are plain data."""
    return list(map(outcome, seeds, fly_figures(scenario_json, seeds, folder, player)))


fly_outcomes = partial(fly_kept, Outcome, fly_outcomes_of, at_once=COMPILED_AT_ONCE)


LOST_SHARE: Final = 0.05
NONE: Final = "none"
WITHOUT: Final = 7  # multiple of a row's flights that fly without mismatch, unless too many are lost
SEARCH: Final = 3  # largest multiple of a row's flights in the search for a limit


@dataclass(frozen=True)
class MismatchRow:
    """Flights under one mismatch at one value; its name has the value's unit, and is 'none' without a mismatch.

    lost_share is Wilson's 95 % interval of the share lost [1]. mse is the median of the estimate's mean squared error
    per axis [m^2], with the lost flights as worst and without them. nees is the position's mean over the kept flights,
    3 if the filter is consistent, None if all were lost; nees_interval is its 95 % interval by Student's t, None for
    fewer than two flights. nees_with_lost is over all flights, lost ones up to their losses; infinite if one diverged.
    """

    mismatch: str
    value: float
    flights: int
    lost: int
    lost_share: Interval
    mse: dict[str, Middle]
    nees: float | None
    nees_interval: Interval | None
    nees_with_lost: float


@dataclass(frozen=True)
class Limit:
    """The value of a mismatch, whose name has the unit, at which 5 % of the flights are lost, and its 95 % interval.

    See loss_level.py for None and 0.
    """

    mismatch: str
    value: float | None
    interval: tuple[float | None, float | None]


@dataclass(frozen=True)
class Sensitivity:
    """The result of the study of sensitivity of a scenario, as `ortilo sensitivity --json` writes it.

    rows are without mismatch, then with each mismatch alone at its given values. limits are for each mismatch alone,
    then for all together. flown_by names the players that flew.
    """

    scenario: str
    rows: list[MismatchRow]
    limits: list[Limit]
    flown_by: str


Want = tuple[Settings, Iterable[int]]


def sensitivity(
    vary: Callable[[Settings], Scenario],
    flights: int,
    out: Path,
    workers: int = 1,
    say: Callable[[str], None] = lambda part: None,
    progress: Callable[[int], None] | None = None,
    player: str = "fastest",
) -> Sensitivity:
    """Fly a scenario under each mismatch that changes anything for it; `say` gets what is flown as it begins.

    All rows fly the same seeds, 0 to flights - 1. A search flies each further seed at one level, so that its flights
    are independent, and at most SEARCH times as many. `vary` returns the scenario with settings laid over it; its
    cameras are flown projected. out, workers, progress and player are as in fly_kept.
    """
    players = set[str]()

    def fly(wanted: Sequence[Want]) -> list[list[Outcome]]:
        asked = [(vary(under).projected(), seeds) for under, seeds in wanted]
        outcomes = fly_outcomes(asked, out, workers, progress, player=player)
        players.update(its.player for found in outcomes for its in found)
        return outcomes

    scenario = vary(())
    mismatches = mismatches_of(scenario)
    mismatches = (*mismatches, all_together(mismatches))
    at = [(mismatch, value) for mismatch in mismatches for value in mismatch.given]
    say("at given values")
    calm, *outcomes = fly([((), range(flights)), *((m.settings(value), range(flights)) for m, value in at)])
    rows = [
        _row(NONE, 0.0, calm),
        *(_row(m.name, value, found) for (m, value), found in zip(at, outcomes, strict=True)),
    ]
    say("without mismatch")
    without = _without(fly, flights, calm)
    searched = [mismatch for mismatch in mismatches if mismatch.largest is not None]
    limits = dict.fromkeys((mismatch.name for mismatch in searched), NO_LEVEL)
    if without is not None:
        known = {m.name: [Flown(r.value, r.flights, r.lost) for r in rows if r.mismatch == m.name] for m in searched}
        limits = search(fly, searched, without, known, range(flights, (1 + SEARCH) * flights), say)
    by = flown_by([scenario.projected()], players)
    return Sensitivity(scenario.name, rows, [Limit(name, *level) for name, level in limits.items()], by)


def _without(fly: Callable[[Sequence[Want]], list[list[Outcome]]], flights: int, calm: list[Outcome]) -> Flown | None:
    """Fly without mismatch and return what is lost, which all searches need; None if that is more than LOST_SHARE."""
    most, decided = WITHOUT * flights, loses_more(len(calm), _lost(calm), LOST_SHARE)
    while decided is None and len(calm) < most:
        (calm,) = fly([((), range(min(len(calm) + 2 * BATCH, most)))])
        decided = loses_more(len(calm), _lost(calm), LOST_SHARE)
    if decided:
        return None
    (calm,) = fly([((), range(most))])
    return Flown(0.0, most, _lost(calm))


def search(
    fly: Callable[[Sequence[Want]], list[list[Outcome]]],
    mismatches: Sequence[Mismatch],
    without: Flown,
    given: dict[str, list[Flown]],
    seeds: Sequence[int],
    say: Callable[[str], None],
) -> dict[str, LossLevel]:
    """Return, for each mismatch with a largest value, the level at which LOST_SHARE is lost.

    All searches run together: a round flies a batch for each search that is not settled, with the same seeds; each seed
    is flown at one level of each mismatch. So the workers share the flights of a round, and what is flown does not
    depend on their number. `without` are the flights without mismatch, `given` those at given values, by mismatch.
    """
    flown = {m.name: {row.level: row for row in given[m.name] if row.level > 0.0} for m in mismatches}
    levels = {m.name: ladder(m.careful, m.largest or m.careful) for m in mismatches}

    def found(name: str) -> LossLevel:
        return loss_level(without, list(flown[name].values()), LOST_SHARE)

    for start in range(0, len(seeds), BATCH):
        batch = seeds[start : start + BATCH]
        going = [m for m in mismatches if not is_settled(found(m.name), levels[m.name])]
        if not going:
            break
        say(f"search for {len(going)} limits")
        at = [next_level(without, list(flown[m.name].values()), levels[m.name], LOST_SHARE) for m in going]
        outcomes = fly([(m.settings(value), batch) for m, value in zip(going, at, strict=True)])
        for mismatch, value, came in zip(going, at, outcomes, strict=True):
            _, flights, lost = flown[mismatch.name].get(value, Flown(value, 0, 0))
            flown[mismatch.name][value] = Flown(value, flights + len(came), lost + _lost(came))
    return {m.name: found(m.name) for m in mismatches}


def _lost(outcomes: Sequence[Outcome]) -> int:
    return sum(flown.lost for flown in outcomes)


def _row(mismatch: str, value: float, outcomes: Sequence[Outcome]) -> MismatchRow:
    kept, lost = [flown for flown in outcomes if not flown.lost], _lost(outcomes)
    nees = np.array([flown.nees for flown in kept])
    return MismatchRow(
        mismatch=mismatch,
        value=value,
        flights=len(outcomes),
        lost=lost,
        lost_share=share_interval(lost, len(outcomes)),
        mse={axis: middle_of([flown.mse[axis] for flown in kept], lost) for axis in AXES},
        nees=float(nees.mean()) if kept else None,
        nees_interval=nees_interval(nees),
        nees_with_lost=float(np.nan_to_num(np.mean([flown.nees for flown in outcomes]), nan=np.inf)),
    )
