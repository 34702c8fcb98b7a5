"""Many flights of a scenario, and comparisons of scenarios by their flights."""

from __future__ import annotations  # help() shows types by their names

import math
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import Any, overload
from weakref import finalize

import pandas as pd

from ortilo_drake.api.flight import Flight
from ortilo_drake.flight import ensemble
from ortilo_drake.flight.intervals import Middle, middle_of, share_interval
from ortilo_drake.flight.processes.workers import kept_workers
from ortilo_drake.flight.summary import Summary
from ortilo_drake.scenario import InputError, Scenario, load_scenario
from ortilo_drake.scenario.load import Settings, as_settings
from ortilo_drake.scenario.plain import plain_value
from ortilo_drake.views.numbers import count, of_all_and_kept


class Flights(Sequence[Flight]):
    """The flights of one scenario, read from their files one at a time.

    Attributes:
        scenario: the scenario; its seed means nothing.
        summaries: a summary of each flight, as Flight.summary returns it.
    """

    def __init__(self, scenario: Scenario, seeds: list[int], out: Path, summaries: list[dict[str, Any]]):
        self.scenario, self.summaries = scenario, summaries
        self._seeds, self._out = seeds, out

    def __len__(self) -> int:
        return len(self._seeds)

    @overload
    def __getitem__(self, index: int) -> Flight: ...
    @overload
    def __getitem__(self, index: slice) -> list[Flight]: ...
    def __getitem__(self, index: int | slice) -> Flight | list[Flight]:
        if isinstance(index, slice):
            return [self[k] for k in range(*index.indices(len(self)))]
        return Flight.load(ensemble.flight_file(self._out, self.scenario, self._seeds[index]))

    def table(self) -> pd.DataFrame:
        """Return a row for each flight, by seed: lost or not, mean squared errors [m^2], path errors, position NEES."""
        return pd.DataFrame([_row(summary) for summary in self.summaries]).set_index("seed")

    def __repr__(self) -> str:
        lost = sum(summary["lost"] is not None for summary in self.summaries)
        return f"<Flights {self.scenario.name}: {len(self)}, {lost} lost>"


def _row(summary: dict[str, Any]) -> dict[str, Any]:
    mse = {f"mse {axis}": value for axis, value in summary["mse"].items()}
    path = {"path mse": summary["path_mse"], "farthest from path": summary["max_path_distance"]}
    return {"seed": summary["seed"], "lost": summary["lost"] is not None} | mse | path | {"nees": summary["nees"]}


def fly_many(
    scenario: str | Path | Scenario,
    seeds: Iterable[int],
    settings: Settings = (),
    *,
    out: str | Path | None = None,
    workers: int = 1,
    progress: Callable[[dict[str, Any]], None] | None = None,
    player: str = "fastest",
    **changes: Any,
) -> Flights:
    """Fly a scenario once for each seed. Flights already in the folder are not flown again.

    Args:
        scenario: a ready-made scenario's name, a .yaml file, or a Scenario.
        seeds: the seeds.
        settings: 'vehicle.mass=3.0' with the value in YAML, a list of such texts, or a dict of values by key.
        out: folder for the flights; by default a temporary folder, deleted together with the returned object.
        workers: number of worker processes; with 1 this process flies. The flights do not depend on it.
        progress: called with the summary of each flight as it ends.
        player: as in fly; each summary names its player.
        changes: settings by keyword, with two underscores for a dot: `vehicle__mass=3.0`.

    Raises:
        InputError: if the scenario is wrong, the player cannot fly it, or a flight cannot be flown or written.
    """

    def tell(summary: Summary) -> None:
        if progress:
            progress(asdict(summary))

    chosen, seeds = load_scenario(scenario, settings, **changes), _listed(seeds)
    where = Path(mkdtemp(prefix="ortilo-") if out is None else out)
    try:
        summaries = ensemble.fly_many(chosen, seeds, where, workers, tell, player)
        flights = Flights(chosen, seeds, where, [asdict(summary) for summary in summaries])
    except BaseException:
        if out is None:
            rmtree(where)
        raise
    if out is None:
        finalize(flights, rmtree, where)
    return flights


def _listed(seeds: Iterable[int]) -> list[int]:
    if not isinstance(seeds, Iterable):
        raise InputError(f"seeds: {seeds!r}: must be several, as range({seeds!r}) or [{seeds!r}]")
    found = [plain_value("seeds", seed) for seed in seeds]
    wrong = [seed for seed in found if not isinstance(seed, int) or isinstance(seed, bool)]
    if wrong:
        raise InputError(f"seeds: {wrong[0]!r}: must be integers")
    return found


class Comparison(pd.DataFrame):
    """A DataFrame that prints all its columns on any screen, each median with its interval in brackets."""

    @property
    def _constructor(self) -> type[Comparison]:
        return Comparison

    def __repr__(self) -> str:
        if not set(_FIGURES) <= set(self.columns):  # a selection of columns
            return self.to_string(float_format=lambda value: f"{value:.4g}")
        rows = [_shown(row) for row in self.to_dict("records")]
        text = pd.DataFrame(rows, index=self.index).to_string()
        return f"{text}\n{_FOOTNOTE}" if "[?]" in text else text


_UNITS = {"mse x": "m^2", "mse y": "m^2", "mse z": "m^2", "path mse": "m^2", "farthest from path": "m", "nees": "1"}
_FIGURES = tuple(_UNITS)
_FOOTNOTE = "[?]: too few flights: the 95 % interval of a median needs six."
_ENDS = ("", " low", " high", " kept", " kept low", " kept high")


def _shown(row: dict[Hashable, Any]) -> dict[str, str]:
    """Return the cells of a row of a Comparison as text."""
    shown = {"lost": count(row["lost"], row["flights"])}
    for name in _FIGURES:
        median, low, high, kept, kept_low, kept_high = (float(row[name + end]) for end in _ENDS)
        ends, kept_ends = (
            None if math.isnan(low) else (low, high),
            None if math.isnan(kept_low) else (kept_low, kept_high),
        )
        middle = Middle(_known(median), ends, _known(kept), kept_ends)
        shown[f"{name} [{_UNITS[name]}]"] = of_all_and_kept(middle, row["lost"])
    return shown | {"player": row["player"]}


def _known(value: float) -> float | None:
    return None if math.isnan(value) else value


def _medians(table: pd.DataFrame) -> dict[str, float | None]:
    """Return the columns of a Comparison that are medians or interval ends, from the table of flights."""
    found: dict[str, float | None] = {}
    for name in _FIGURES:
        kept, lost = table[~table["lost"]][name].dropna().astype(float).tolist(), int(table["lost"].sum())
        middle = middle_of(kept, lost if kept or table["lost"].all() else 0)
        ends, kept_ends = middle.interval or (None, None), middle.kept_interval or (None, None)
        values = (middle.median, *ends, middle.kept, *kept_ends)
        found |= {name + end: value for end, value in zip(_ENDS, values, strict=True)}
    return found


def compare(
    *scenarios: str | Path | Scenario,
    seeds: Iterable[int] = range(5),
    out: str | Path | None = None,
    workers: int = 1,
    settings: Settings = (),
    player: str = "fastest",
    **changes: Any,
) -> Comparison:
    """Fly scenarios with the same seeds and settings; return a table with a row for each scenario, named after it.

    The rows stand in the order of the scenarios; two scenarios of one name have a row each. The columns are the numbers
    `flights` and `lost`; 'lost low' and 'lost high', the Wilson 95 % interval of the lost share; `player`; and six
    columns for each figure: the mean squared errors in x, y, z and the path error [m^2], the largest distance from the
    path [m] and the NEES of the position (3 if consistent). The first is the median over all flights. A lost flight
    counts as infinite, so the median is infinite where half or more are lost. ' low' and ' high' are its 95 % interval,
    NaN for fewer than six flights. ' kept', ' kept low' and ' kept high' are the same over the flights that were not
    lost, NaN where all were lost. The table prints medians with their intervals in brackets, [?] for too few flights.

    Args:
        scenarios: each a ready-made scenario's name, a .yaml file, or a Scenario.
        seeds: the seeds.
        out: folder for the flights; flights already there are not flown again. By default no flight is kept.
        workers: number of worker processes; with 1 this process flies. The flights do not depend on it.
        settings: changes to all scenarios: 'vehicle.mass=3.0', a list of such texts, or a dict of values by key.
        player: as in fly.
        changes: settings by keyword, with two underscores for a dot: `vehicle__mass=3.0`.

    Raises:
        InputError: if no scenario is given, one is wrong, the player cannot fly it, or a flight cannot be written.
    """
    if not scenarios:
        raise InputError("scenarios: none given: must be one or more")
    seeds, rows, names = _listed(seeds), [], []
    laid_over = as_settings(settings, changes)  # once: an iterator can be read only once
    with kept_workers():
        for scenario in scenarios:
            flights = fly_many(scenario, seeds, laid_over, out=out, workers=workers, player=player)
            table = flights.table()
            lost = int(table["lost"].sum())
            low, high = share_interval(lost, len(table)) if len(table) else (math.nan, math.nan)
            flown_by = ", ".join(sorted({summary["player"] for summary in flights.summaries}))
            counted = {"flights": len(table), "lost": lost, "lost low": low, "lost high": high}
            rows.append(counted | _medians(table) | {"player": flown_by})
            names.append(flights.scenario.name)
    found = Comparison(rows, index=names)
    return found.astype({name + end: float for name in _FIGURES for end in _ENDS})
