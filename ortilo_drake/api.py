"""The laboratory in Python: what `import ortilo_drake as od` offers.

    flight = od.fly("imu_uwb_yolo", seed=3, camera__kind="projected", uwb__link__loss=0.3)
    flight.error, flight.lost, flight.summary(), flight.plot()
    od.compare("imu_uwb", "imu_uwb_yolo", camera__kind="projected", seeds=range(5))

Settings are those of a scenario file, by keyword: two underscores stand for the dot of `--set uwb.link.loss=0.3`.
"""

import csv
import io
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import Any, Self, overload
from weakref import finalize

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.figure import Figure
from pydrake.math import RollPitchYaw

from ortilo_drake.diagrams.closed_loop import make_closed_loop as make_closed_loop
from ortilo_drake.flight import ensemble, flight, metrics, saved_flight
from ortilo_drake.flight.files import write_text
from ortilo_drake.flight.signals import OUTPUTS
from ortilo_drake.interop.log.writer import LogWriter
from ortilo_drake.scenario import InputError, Scenario, with_settings
from ortilo_drake.scenario import load_scenario as load
from ortilo_drake.views.figures import draw_flight


class Flight:
    """One flight.

    Args:
        data: its Dataset over ticks, see flight.flight_dataset.

    Attributes:
        data: that Dataset: truth, estimate, covariance, control, reference, measurement, innovation, arrival, ...
    """

    def __init__(self, data: xr.Dataset):
        self.data = data

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read what to_netcdf or `ortilo fly --out` wrote; InputError if it is damaged or no flight."""
        return cls(saved_flight.load_flight(Path(path)))

    @property
    def scenario(self) -> Scenario:
        """The scenario flown, its seed included."""
        return flight.scenario_of(self.data)

    @property
    def seed(self) -> int:
        """The seed of all noise."""
        return int(self.data.attrs["seed"])

    @property
    def lost(self) -> dict[str, Any] | None:
        """Time [s] and cause of the loss, None of a flight that reached its end."""
        found: dict[str, Any] | None = json.loads(self.data.attrs["lost"])
        return found

    @property
    def error(self) -> xr.DataArray:
        """The estimate of the position less the truth at every tick (tick, axis) [m]."""
        axes = list(flight.AXES)
        estimate = self.data["estimate"].sel(xbar=axes).rename(xbar="axis")
        return (estimate - self.data["truth"].sel(state=axes).rename(state="axis")).rename("error")

    def summary(self) -> dict[str, Any]:
        """Return the figures that `ortilo fly --json` writes."""
        return metrics.summary(self.data)

    def plot(self) -> Figure:
        """Return a figure of the path, the errors in their 3-sigma bands and the arrivals."""
        return draw_flight(self.data)

    def to_netcdf(self, path: str | Path) -> Path:
        """Write the flight as netCDF with a digest; return the path."""
        saved_flight.save_flight(self.data, Path(path))
        return Path(path)

    def to_csv(self, path: str | Path) -> Path:
        """Write a row for each tick: time [s], true state, estimate, control, reference; return the path."""
        columns = {"time": self.data["time"].values}
        for name, along in (
            ("truth", "state"),
            ("estimate", "xbar"),
            ("control", "control_name"),
            ("reference", "axis"),
        ):
            columns |= {f"{name}.{part}": self.data[name].sel({along: part}).values for part in self.data[along].values}
        text = io.StringIO()
        rows = csv.writer(text, lineterminator="\n")
        rows.writerow(columns)
        rows.writerows(zip(*(values.tolist() for values in columns.values()), strict=True))
        write_text(Path(path), text.getvalue())
        return Path(path)

    def to_tum(self, path: str | Path, of: str = "estimate") -> Path:
        """Write a trajectory in the format of TUM's RGB-D benchmark, which evo reads; return the path.

        A line a tick: t x y z qx qy qz qw, p_WB [m] and the attitude R_WB.

        Args:
            path: the file.
            of: 'estimate' or 'truth'.
        """
        if of not in ("estimate", "truth"):
            raise InputError(f"of: {of!r}: must be 'estimate' or 'truth'")
        lines = []
        for t, x in zip(self.data["time"].values, self.data[of].values, strict=True):
            q = RollPitchYaw(x[3:6]).ToQuaternion()
            lines.append(" ".join(f"{value:.9f}" for value in (t, *x[:3], q.x(), q.y(), q.z(), q.w())))
        write_text(Path(path), "\n".join(lines) + "\n")
        return Path(path)

    def to_mcap(self, folder: str | Path) -> Path:
        """Write truth, estimates, control and reference as a log for ROS 2 and Foxglove to a new folder; return it.

        A flight does not keep the sensors' messages: `ortilo fly --log` writes those too.
        """
        with LogWriter(Path(folder), self.scenario) as log:
            for k, row in enumerate(logged_rows(self.data)):
                log.write_tick(k, row.pop("state"), {}, row)
        return Path(folder)

    def __repr__(self) -> str:
        error = float(np.sqrt(np.nanmean(np.sum(self.error.values**2, axis=1))))
        end = f"lost at {self.lost['time']:.1f} s: {self.lost['cause']}" if self.lost else "reached its end"
        seconds = float(self.data["time"].values[-1])
        return f"<Flight {self.scenario.name}, seed {self.seed}: {seconds:.1f} s, {end}, RMS error {error:.3f} m>"


def logged_rows(data: xr.Dataset) -> Iterator[dict[str, np.ndarray]]:
    """Yield, tick by tick, the signals of closed_loop.LOGGED that a flight was made of."""
    there = data["measurement"].notnull().values
    y, delta = np.where(there, data["measurement"].values, 0.0), data["arrival"].values.astype(float)
    V2 = data["measurement_covariance"].values.reshape(len(y), -1)
    references = [data[name].values for name in ("reference", "reference_velocity", "reference_acceleration")]
    parts = {
        "state": data["truth"].values,
        "control": data["control"].values,
        "measurement": np.hstack([y, delta, V2]),
        "estimate": data["estimate"].values,
        "covariance": data["covariance"].values.reshape(len(y), -1),
        "reference": np.hstack(references),
    }
    assert all(parts[name].shape[1] == size for name, size in OUTPUTS.items())
    for k in range(len(y)):
        yield {name: values[k] for name, values in parts.items()}


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


def _plain(value: Any) -> Any:
    """Return what JSON can hold of NumPy's numbers and arrays and of paths."""
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else str(value)


def load_scenario(scenario: str | Path | Scenario, *, seed: int | None = None, **settings: Any) -> Scenario:
    """Return a scenario by name, from a file or as it is, with settings laid over it.

    Args:
        scenario: a ready-made scenario's name, the path of a .yaml file, or a scenario.
        seed: the seed of all noise, if not the scenario's own.
        settings: changes, `uwb__link__loss=0.3` for uwb.link.loss.

    Raises:
        InputError: naming the field, its value and what is allowed.
    """
    changes = tuple(f"{key.replace('__', '.')}={json.dumps(value, default=_plain)}" for key, value in settings.items())
    if not isinstance(scenario, Scenario):
        return load(scenario, changes, seed)
    return with_settings(scenario, changes, seed)


def fly(
    scenario: str | Path | Scenario = "imu_uwb_yolo",
    *,
    seed: int | None = None,
    progress: Callable[[int], None] | None = None,
    **settings: Any,
) -> Flight:
    """Fly a scenario once.

    Args:
        scenario: as load_scenario.
        seed: as load_scenario.
        progress: called with the number of ticks flown.
        settings: as load_scenario.

    Raises:
        InputError: if the scenario is wrong or cannot be flown.
    """
    return Flight(flight.fly(load_scenario(scenario, seed=seed, **settings), progress))


def fly_many(
    scenario: str | Path | Scenario,
    seeds: Iterable[int],
    *,
    out: str | Path | None = None,
    workers: int = 1,
    progress: Callable[[dict[str, Any]], None] | None = None,
    **settings: Any,
) -> Flights:
    """Fly a scenario once for each seed. Flights that are in the folder already are not flown again.

    Args:
        scenario: as load_scenario.
        seeds: the seeds.
        out: folder for the flights; by default one that goes with the object returned.
        workers: worker processes; 1 flies in this process. The flights do not depend on it.
        progress: called with each summary as it comes in.
        settings: as load_scenario.

    Raises:
        InputError: if the scenario is wrong, or a flight cannot be flown or written.
    """
    chosen, seeds = load_scenario(scenario, **settings), list(seeds)
    where = Path(mkdtemp(prefix="ortilo-") if out is None else out)
    try:
        flights = Flights(chosen, seeds, where, ensemble.fly_many(chosen, seeds, where, workers, progress))
    except BaseException:
        if out is None:
            rmtree(where)
        raise
    if out is None:
        finalize(flights, rmtree, where)
    return flights


def compare(
    *scenarios: str | Path | Scenario,
    seeds: Iterable[int] = range(5),
    out: str | Path | None = None,
    workers: int = 1,
    **settings: Any,
) -> pd.DataFrame:
    """Fly scenarios with the same seeds and the same settings; return a row for each.

    Columns: flights, lost; medians over the flights that were not lost of the mean squared errors in x, y, z and of the
    path error [m^2], and of the NEES of the position (3 if consistent); NaN where all were lost.

    Args:
        scenarios: each as load_scenario.
        seeds: the seeds.
        out: as fly_many.
        workers: as fly_many.
        settings: of all of them, as load_scenario.

    Raises:
        InputError: as fly_many.
    """
    seeds, rows = list(seeds), {}
    for scenario in scenarios:
        flights = fly_many(scenario, seeds, out=out, workers=workers, **settings)
        table = flights.table()
        medians = table[~table["lost"]].drop(columns="lost").astype(float).median()
        rows[flights.scenario.name] = {"flights": len(table), "lost": int(table["lost"].sum())} | medians.to_dict()
    return pd.DataFrame(rows).T.astype({"flights": int, "lost": int})
