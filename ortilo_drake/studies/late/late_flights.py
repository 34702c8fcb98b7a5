"""The same flights with late measurements ignored, dropped and replayed: the three ways of estimator.delay."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
import scipy  # not scipy.stats: that takes a second to import, and loads by itself when it is used

from ortilo_drake.flight.ensemble import fly_many
from ortilo_drake.flight.players import flown_by
from ortilo_drake.flight.summary import Summary
from ortilo_drake.model.signals import SENSORS
from ortilo_drake.model.typed_yaml import validate
from ortilo_drake.scenario import Scenario

MODES: Final = ("ignore", "drop", "replay")
ERRORS: Final = ("path_mse", "path_distance_mse", "estimation_mse")


@dataclass(frozen=True)
class LateLinks:
    """Loss and delay of the sensors' links, the same for all, and of the command link.

    Messages and commands are lost independently, with these probabilities. The delays are fixed, in ticks; a sensor's
    message has an additional one, drawn uniformly up to random_delay ticks.
    """

    loss: float = 0.2
    delay: int = 1
    random_delay: int = 1
    command_loss: float = 0.0
    command_delay: int = 0


@dataclass(frozen=True)
class ModeReport:
    """The flights of a mode: how many, how many were lost, medians of ERRORS [m^2], mean NEES (3 if consistent)."""

    mode: str
    flights: int
    lost: int
    path_mse: float
    path_distance_mse: float
    estimation_mse: float
    nees: float


@dataclass(frozen=True)
class Pairs:
    """A mode compared with another, seed by seed: in how many it has the smaller error, of how many pairs.

    The ratio is the median of its error over the other's, p the one-sided Wilcoxon signed-rank probability of
    logarithms that differ so much in its favour by chance.
    """

    better: int
    pairs: int
    ratio: float
    p: float


@dataclass(frozen=True)
class LateReport:
    """The three modes, each flown on the same seeds, of a scenario at a control rate [Hz].

    links holds loss and delay, or names what stood between the halves. `against` compares 'replay' with each other
    mode, by ERRORS. flown_by names the players that flew, empty for flights of two processes.
    """

    scenario: str
    control_rate: float
    seeds: list[int]
    links: LateLinks | str
    modes: dict[str, ModeReport]
    against: dict[str, dict[str, Pairs]]
    flown_by: str


# 40 ms +- 20 ms: a message sent at t_k arrives 20 to 60 ms later and is used one or two ticks later at 30 Hz, two to
# six at 100 Hz.
AT_30_HZ: Final = LateLinks()
AT_100_HZ: Final = LateLinks(delay=2, random_delay=4)
# The same with the commands lost as often and 33 or 40 ms late, as behind a relay that stands between the halves.
BOTH_WAYS_AT_30_HZ: Final = replace(AT_30_HZ, command_loss=0.2, command_delay=1)
BOTH_WAYS_AT_100_HZ: Final = replace(AT_100_HZ, command_loss=0.2, command_delay=4)


def late_scenario(scenario: Scenario, links: LateLinks, mode: str) -> Scenario:
    """Return a scenario behind these links, with the mode as estimator.delay; rates and blackouts stay.

    InputError if a link or the mode is not allowed.
    """
    data = scenario.model_dump(mode="json")
    for link in (*(data[sensor]["link"] for sensor in SENSORS), data["report_link"]):
        link["loss"] = {"kind": "bernoulli", "probability": links.loss}
        link["delay"], link["random_delay"] = links.delay, links.random_delay
    data["command_link"]["loss"] = {"kind": "bernoulli", "probability": links.command_loss}
    data["command_link"]["delay"] = links.command_delay
    data["estimator"]["delay"] = mode
    return validate(Scenario, data, scenario.name)


def late_flights(
    scenario: Scenario,
    seeds: Iterable[int],
    out: Path,
    links: LateLinks = AT_30_HZ,
    workers: int = 1,
    progress: Callable[[ModeReport], None] | None = None,
    player: str = "fastest",
) -> LateReport:
    """Fly the same seeds in each of the modes and return how they compare.

    `links` replaces the loss and delay of the scenario's links; its seed and estimator.delay are not used. Flights are
    kept in the folder `out`; 1 worker flies in this process; `progress` gets each mode's report; `player` is as in
    fly_many. InputError if a flight cannot be flown, or if a link is not allowed.
    """
    seeds, flown, reports = list(seeds), {}, {}
    scenarios = {mode: late_scenario(scenario, links, mode) for mode in MODES}
    for mode in MODES:
        flown[mode] = fly_many(scenarios[mode], seeds, out, workers, player=player)
        reports[mode] = mode_report(mode, flown[mode])
        if progress:
            progress(reports[mode])
    against = {mode: paired(flown["replay"], flown[mode]) for mode in ("ignore", "drop")}
    by = flown_by(scenarios.values(), (its.player or "unknown" for of_mode in flown.values() for its in of_mode))
    return LateReport(scenario.name, scenario.control_rate, seeds, links, reports, against, by)


def errors_of(summaries: list[Summary], name: str) -> np.ndarray:
    """Return an error of ERRORS over flights [m^2], the estimation's summed over the axes; NaN where there is none."""
    if name == "estimation_mse":
        return np.array([sum(s.mse.values()) for s in summaries])
    return np.array([np.nan if (error := getattr(s, name)) is None else error for s in summaries])


def mode_report(mode: str, summaries: list[Summary]) -> ModeReport:
    """Return the figures of a mode's flights."""
    medians = {name: float(np.nanmedian(errors_of(summaries, name))) for name in ERRORS}
    lost = sum(s.lost is not None for s in summaries)
    return ModeReport(mode, len(summaries), lost, **medians, nees=float(np.mean([s.nees for s in summaries])))


def paired(ours: list[Summary], theirs: list[Summary]) -> dict[str, Pairs]:
    """Compare two modes seed by seed, for each of ERRORS.

    A lost flight's errors are those up to its loss, which favours a mode that loses flights.
    """
    compared = {}
    for name in ERRORS:
        a, b = errors_of(ours, name), errors_of(theirs, name)
        both = np.isfinite(a) & np.isfinite(b)
        logarithm = np.log(a[both] / b[both])
        p = float(scipy.stats.wilcoxon(logarithm, alternative="less").pvalue) if np.any(logarithm) else 1.0
        better, ratio = int(np.sum(logarithm < 0.0)), float(np.exp(np.median(logarithm)))
        compared[name] = Pairs(better, int(both.sum()), ratio, p)
    return compared
