"""Many flights of a scenario, and scenarios compared by their flights."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import Any, overload
from weakref import finalize

import pandas as pd

from ortilo_drake.api.flight import Flight
from ortilo_drake.flight import ensemble
from ortilo_drake.flight.processes.workers import kept_workers
from ortilo_drake.flight.summary import Summary
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.scenario.load import Settings, as_settings
from ortilo_drake.scenario.plain import plain_value


class Flights(Sequence[Flight]):
    """Flights of one scenario, read from their files one at a time.

    Attributes:
        scenario: the scenario, with any seed.
        summaries: a summary of each, as Flight.summary gives it.
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
        """Return a row for each flight: whether it was lost, mean squared errors [m^2], NEES of the position."""
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
    """Fly a scenario once for each seed. Flights that are in the folder already are not flown again.

    Args:
        scenario: as load_scenario.
        seeds: the seeds.
        settings: as load_scenario.
        out: folder for the flights; by default one that goes with the object returned.
        workers: worker processes; 1 flies in this process. The flights do not depend on it.
        progress: called with each summary as it comes in.
        player: as fly; each summary says who flew.
        changes: as load_scenario.

    Raises:
        InputError: if the scenario is wrong, the player cannot fly it, or a flight cannot be flown or written.
    """

    def tell(summary: Summary) -> None:
        if progress:
            progress(asdict(summary))

    chosen, seeds = load_scenario(scenario, settings, **changes), [plain_value("seeds", seed) for seed in seeds]
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


class Comparison(pd.DataFrame):
    """A table that prints whole, however narrow the screen; otherwise a DataFrame."""

    @property
    def _constructor(self) -> type["Comparison"]:
        return Comparison

    def __repr__(self) -> str:
        return self.to_string(float_format=lambda value: f"{value:.4g}")


def compare(
    *scenarios: str | Path | Scenario,
    seeds: Iterable[int] = range(5),
    out: str | Path | None = None,
    workers: int = 1,
    settings: Settings = (),
    player: str = "fastest",
    **changes: Any,
) -> Comparison:
    """Fly scenarios with the same seeds and the same settings; return a row for each, named after it.

    The rows stand in the order of the scenarios; two of one name have a row each.
    Columns: flights, lost; medians over the flights that were not lost of the mean squared errors in x, y, z and of the
    path error [m^2], and of the NEES of the position (3 if consistent), NaN where all were lost; player, who flew.

    Args:
        scenarios: each as load_scenario.
        seeds: the seeds.
        out: as fly_many.
        workers: as fly_many.
        settings: of all of them, as load_scenario.
        player: as fly.
        changes: of all of them, as load_scenario.

    Raises:
        InputError: as fly_many.
    """
    seeds, rows, names = list(seeds), [], []
    laid_over = as_settings(settings, changes)  # once: an iterator has no second turn
    with kept_workers():
        for scenario in scenarios:
            flights = fly_many(scenario, seeds, laid_over, out=out, workers=workers, player=player)
            table = flights.table()
            medians = table[~table["lost"]].drop(columns="lost").astype(float).median()
            flown_by = ", ".join(sorted({summary["player"] for summary in flights.summaries}))
            counted = {"flights": len(table), "lost": int(table["lost"].sum())}
            rows.append(counted | medians.to_dict() | {"player": flown_by})
            names.append(flights.scenario.name)
    return Comparison(rows, index=names)
