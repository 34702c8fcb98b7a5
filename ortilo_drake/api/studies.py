"""Studies of the command line in Python, `ortilo map` and `ortilo tables`, and the matrices of a scenario's parts."""

from __future__ import annotations  # help() shows types by their names

import io
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd
from pydrake.systems.framework import System

from ortilo_drake.model.as_data import as_data
from ortilo_drake.model.typed_yaml import InputError, validate
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.scenario.load import Settings, as_settings
from ortilo_drake.scenario.plain import plain_value
from ortilo_drake.studies.linearization.linearize import Linearization
from ortilo_drake.studies.linearization.linearize import linearize as linearize_part
from ortilo_drake.studies.maps.map_flights import fly_map
from ortilo_drake.studies.maps.map_report import map_csv, map_text, theory_of
from ortilo_drake.studies.maps.sweep import Sweep, load_sweep
from ortilo_drake.studies.paper_tables.flown_tables import fly_tables, scenarios_of_tables
from ortilo_drake.studies.paper_tables.report import table_text
from ortilo_drake.studies.paper_tables.tables import STATISTICS, Tables, make_tables


@dataclass(frozen=True, repr=False)
class Study:
    """The result of a study; print and notebooks show the report.

    Attributes:
        text: the report, as the command prints it, in Markdown.
        table: the figures of the study.
        data: the whole result, as the command's --json writes it.
    """

    text: str
    table: pd.DataFrame
    data: dict[str, Any]

    def __repr__(self) -> str:
        return self.text

    def _repr_markdown_(self) -> str:
        return self.text


def linearize(
    scenario: str | Path | Scenario,
    part: str,
    settings: Settings = (),
    *,
    reference: np.ndarray | None = None,
    lag: str = "down",
    **changes: Any,
) -> Linearization:
    """Return the matrices of a part of a scenario's diagram, linearised by Drake along a reference.

        >>> import ortilo_drake as od
        >>> plant = od.linearize("nominal_imu_uwb", "plant")
        >>> float(plant.frame("A").loc["x_dot", "theta"])  # x_ddot = g theta [m/s^2 per rad]
        9.81
        >>> plant.units["x_dot"], plant.units["f_T"]
        ('m/s', 'N')

    Drake's own Linearize refuses the closed loop that flies (make_closed_loop): the loop has several groups of discrete
    states, which are updated at several rates. So the closed loop here is the loop of one tick in which every sensor's
    message arrives.

    Args:
        scenario: a ready-made scenario's name, a .yaml file, or a Scenario.
        part: 'plant' and 'rotors_and_plant' are continuous; 'sampled_plant', 'estimator' and 'closed_loop' advance by a
            tick; 'servo' has no state. The estimator is the filter with its gain frozen at the steady state, from
            [y; u; reference] to [xhat; i]. The closed loop joins sampled plant, servo and estimator, from the reference
            to x.
        settings: 'vehicle.mass=3.0' with the value in YAML, a list of such texts, or a dict of values by key.
        reference: r, r_dot, r_ddot (9) [m, m/s, m/s^2] at the operating point; by default hover at the origin.
        lag: 'up' or 'down', the one of the rotors' two time constants that 'rotors_and_plant' uses.
        changes: settings by keyword, with two underscores for a dot: `vehicle__mass=3.0`.

    Returns:
        A, B, C, D in deviations from the operating point; tick h [s], None for a part that is continuous or has no
        state; names `states`, `inputs`, `outputs`, and `units` by name. `frame("A")` is A with named rows and columns.

    Raises:
        InputError: if the scenario or the part is wrong; or if the part has no matrices: servo, estimator and closed
            loop have matrices only with the LQ servo and the Kalman filter.
    """
    if isinstance(scenario, System):
        raise InputError(
            f"scenario: a {type(scenario).__name__}: must be a scenario or its name; Drake's Linearize takes diagrams, "
            "with one group of discrete states"
        )
    return linearize_part(load_scenario(scenario, settings, **changes), part, reference, lag)


def map(
    sweep: str | Path | Mapping[str, Any],
    *,
    out: str | Path | None = None,
    workers: int = 1,
    progress: Callable[[int], None] = lambda flown: None,
    player: str = "fastest",
) -> Study:
    """Fly a map as `ortilo map` does: a number of flights at each point of a design over any settings.

        >>> import ortilo_drake as od
        >>> hover = {"planner": {"kind": "hover", "duration": 0.5}, "settle": 0.0}
        >>> found = od.map({"scenario": "nominal_imu_uwb", "settings": hover, "flights": 2,
        ...                 "axes": {"command_link.loss": [0.0, 0.5]}})
        >>> list(found.table["lost"])
        [0, 0]

    Args:
        sweep: a sweep file, or the content of one as a dict, see docs/how_to/maps.md.
        out: folder for the figures of flights; flights already there are not flown again. By default nothing is kept.
        workers: number of worker processes; with 1 this process flies. The flights do not depend on it.
        progress: called with the number of flights that came in.
        player: as in fly; the report names the player.

    Returns:
        Report and data; the table has a row for each point: settings, flights, lost flights, interval of the lost
        share, median error and quartiles [m], largest distance from the path [m], NEES of the position, arrivals.

    Raises:
        InputError: if the sweep or a point's scenario is wrong, the player cannot fly it, or a flight cannot be flown
            or kept.
    """
    source = "sweep" if isinstance(sweep, Mapping) else str(sweep)
    chosen = validate(Sweep, plain_value(source, sweep), source) if source == "sweep" else load_sweep(Path(source))
    with _folder(out) as folder:
        found = fly_map(chosen, source, folder / "flights", workers, progress, player)
    return Study(map_text(found, theory_of(found)), pd.read_csv(io.StringIO(map_csv(found))), as_data(found))


def tables(
    *beside: str | Path,
    flights: int = 20,
    preset: str = "tuned",
    only: str | None = None,
    settings: Settings = (),
    out: str | Path | None = None,
    workers: int = 1,
    progress: Callable[[str], None] = lambda name: None,
    player: str = "fastest",
    **changes: Any,
) -> Study:
    """Fly the paper's two scenarios, or one of them, as `ortilo tables` does; compare its tables I and II with ours.

    The camera is rendered as in the scenarios; `camera__kind="projected"` flies a hundred times as fast.

    Args:
        beside: further scenarios for the same tables: names of ready-made scenarios, or .yaml files.
        flights: number of flights of each scenario, with the seeds from 0.
        preset: 'tuned', 'nominal', 'paper' or 'printed', see docs/concepts.md.
        only: 'imu_uwb' or 'imu_uwb_yolo', to leave the other out.
        settings: changes to all scenarios: 'vehicle.mass=3.0', a list of such texts, or a dict of values by key.
        out: folder for the flights; flights already there are not flown again. By default nothing is kept.
        workers: number of worker processes; with 1 this process flies. The flights do not depend on it.
        progress: called with the name of the scenario of each flight that came in.
        player: as in fly; the report names the player.
        changes: settings by keyword, with two underscores for a dot: `vehicle__mass=3.0`.

    Returns:
        Report and data. The table has a row for each scenario and statistic. Its columns are mean squared errors in x,
        y, z and of the path [m^2]: first of the flights that were not lost; then of all flights, with lost ones as
        worst (infinite where the statistic is a lost flight, NaN in the row of the mean); then those of the paper.

    Raises:
        InputError: if a scenario or the preset is wrong, or a flight cannot be flown or kept.
    """
    if flights < 1:
        raise InputError(f"flights: {flights}: must be 1 or more")
    scenarios = scenarios_of_tables(preset, as_settings(settings, changes), beside=beside, only=only)
    with _folder(out) as folder:
        found = make_tables(preset, fly_tables(scenarios, flights, folder / "flights", workers, progress, player))
    return Study(table_text(found), _statistics(found), as_data(found))


def _statistics(found: Tables) -> pd.DataFrame:
    rows = {}
    for name, ours in found.estimation.items():
        paper = found.paper.estimation.get(name, {}) | {"path": found.paper.path.get(name, {})}
        for statistic in STATISTICS:
            row = {axis: of[statistic] for axis, of in (ours | {"path": found.path[name]}).items()}
            every = found.with_lost[name]
            row |= {f"{axis} with lost": every[axis].get(statistic) for axis in row}
            row |= {f"paper {axis}": of.get(statistic) for axis, of in paper.items()}
            rows[name, statistic] = row
    table = pd.DataFrame.from_dict(rows, orient="index").astype(float)
    return table.rename_axis(["scenario", "statistic"])


@contextmanager
def _folder(out: str | Path | None) -> Iterator[Path]:
    """Yield the given folder, or a temporary folder that is deleted afterwards."""
    if out is not None:
        yield Path(out)
        return
    with TemporaryDirectory(prefix="ortilo-") as folder:
        yield Path(folder)
