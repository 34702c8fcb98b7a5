"""The input of a map: a scenario, axes, a design of points, and the number of flights at each."""

import itertools
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final, Literal, TypeVar

import numpy as np
from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator
from scipy.stats import qmc

from ortilo_drake.model.inputs.problems import TAGS, shown
from ortilo_drake.model.typed_yaml import Frozen, InputError, load_yaml
from ortilo_drake.scenario import Scenario, load_scenario


def _no_group(value: Any) -> Any:
    if value is None or isinstance(value, dict | list | tuple):
        mend = "" if value is None else "; put a group into settings and vary a key of it"
        raise ValueError(f"{shown(value)}: must be a number, a word, true or false{mend}")
    return value


Value = Annotated[bool | int | float | str, BeforeValidator(_no_group)]
Name = Annotated[str, Field(pattern=r"^[a-z_]+(\.[a-zA-Z_0-9]+)*$")]
MOST_POINTS: Final = 100_000


class Range(Frozen):
    """Values from a start to a stop."""

    start: Annotated[float, Field(allow_inf_nan=False)]
    """the first value, in the setting's unit."""
    stop: Annotated[float, Field(allow_inf_nan=False)]
    """the last value, above the start."""
    count: Annotated[int, Field(ge=2, le=1000)] = 11
    """number of values in a grid."""
    scale: Literal["linear", "log"] = "linear"
    """spacing of the values: even, or even in their logarithm."""
    whole: bool = False
    """whether the setting takes whole numbers only."""

    @model_validator(mode="after")
    def _goes_up(self) -> "Range":
        if self.stop <= self.start:
            raise ValueError(f".stop: {self.stop}: must be above the start, {self.start}")
        if self.scale == "log" and self.start <= 0.0:
            raise ValueError(f".start: {self.start}: must be above 0 on a logarithmic scale")
        return self

    def at(self, share: np.ndarray) -> list[float]:
        """Return the values at shares (n) of the way from start to stop, 0 to 1."""
        low, high = np.log([self.start, self.stop]) if self.scale == "log" else (self.start, self.stop)
        values = low + np.asarray(share) * (high - low)
        values = np.clip(np.exp(values) if self.scale == "log" else values, self.start, self.stop)
        return [int(v) if self.whole else float(v) for v in (np.rint(values) if self.whole else values)]


Values = Annotated[tuple[Value, ...], Field(min_length=1, max_length=1000)]


def _group_or_not(value: Any) -> str:
    return TAGS[isinstance(value, dict | Frozen)]


# The form is told from the value before the check, so that an error is about the form that was meant.
Axis = Annotated[Annotated[Values, Tag(TAGS[0])] | Annotated[Range, Tag(TAGS[1])], Discriminator(_group_or_not)]


class Grid(Frozen):
    """Every combination of the axes' values."""

    kind: Literal["grid"] = "grid"


class Scattered(Frozen):
    """Points scattered over the ranges, evenly also over any few of the axes."""

    kind: Literal["latin_hypercube", "sobol"]
    """'latin_hypercube', or 'sobol' (Sobol's sequence, scrambled)."""
    points: Annotated[int, Field(ge=2, le=MOST_POINTS)]
    """number of points; a power of 2 with 'sobol'."""
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 0
    """seed of their places."""


class Sensitivity(Frozen):
    """Saltelli's points for Sobol's indices: points (axes + 2) of them."""

    kind: Literal["sensitivity"]
    """'sensitivity'."""
    points: Annotated[int, Field(ge=2, le=2**14)]
    """points in each of the samples, a power of 2."""
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 0
    """seed of their places."""


class Until(Frozen):
    """Flights until the share of lost flights is known well enough."""

    half_width: Annotated[float, Field(gt=0.0, lt=0.5)]
    """half the width of the 95 % interval of the share of lost flights at which a point is done [1]."""
    at_most: Annotated[int, Field(ge=1, le=10_000_000)]
    """most flights at a point."""


_Fixed = Annotated[int, Field(ge=1, le=10_000_000)]
Flights = Annotated[Annotated[_Fixed, Tag(TAGS[0])] | Annotated[Until, Tag(TAGS[1])], Discriminator(_group_or_not)]


class OverScenario(Frozen):
    """The scenario that a file of a study is about."""

    scenario: str = "imu_uwb"
    """a ready-made scenario's name, or a .yaml file, relative to this file."""
    settings: dict[Name, Any] = Field(default={})
    """settings laid over the scenario in all flights, such as {camera.kind: projected}."""


Over = TypeVar("Over", bound=OverScenario)


class Sweep(OverScenario):
    """A sweep file."""

    axes: Annotated[dict[Name, Axis], Field(min_length=1, max_length=20)]
    """values of each setting: a list, or a range."""
    design: Annotated[Grid | Scattered | Sensitivity, Field(discriminator="kind")] = Grid()
    """choice of the points."""
    flights: Flights = 100
    """number of flights at each point, with seeds from `seed` on; or how precise the share lost must be."""
    seed: Annotated[int, Field(ge=0, lt=2**40)] = 0
    """the first seed."""
    whole: Annotated[int, Field(ge=0, le=10_000)] = 0
    """number of each point's flights that are kept whole, as netCDF; Drake flies these."""

    @model_validator(mode="after")
    def _has_points(self) -> "Sweep":
        if self.design.kind != "grid":
            for key, axis in self.axes.items():
                if not isinstance(axis, Range):
                    raise ValueError(f"axes.{key}: must be a range, start and stop, for design {self.design.kind}")
            if self.design.kind != "latin_hypercube" and self.design.points & (self.design.points - 1):
                raise ValueError(f"design.points: {self.design.points}: must be a power of 2")
        if (n := self.count) > MOST_POINTS:
            raise ValueError(f"axes: {n} points: must be at most {MOST_POINTS}")
        return self

    @property
    def most_flights(self) -> int:
        """The largest number of flights at a point."""
        return self.flights if isinstance(self.flights, int) else self.flights.at_most

    @property
    def count(self) -> int:
        """The number of points."""
        if isinstance(self.design, Grid):
            return int(np.prod([len(axis) if isinstance(axis, tuple) else axis.count for axis in self.axes.values()]))
        points = self.design.points
        return points if isinstance(self.design, Scattered) else points * (len(self.axes) + 2)


def points_of(sweep: Sweep) -> list[dict[str, Value]]:
    """Return the settings of each point, in order; for Saltelli's points: A, B, then A with each column from B."""
    axes, design = sweep.axes, sweep.design
    if isinstance(design, Grid):
        values = [list(a) if isinstance(a, tuple) else a.at(np.linspace(0.0, 1.0, a.count)) for a in axes.values()]
        return [dict(zip(axes, point, strict=True)) for point in itertools.product(*values)]
    d = len(axes)
    if isinstance(design, Scattered):
        sampler = qmc.LatinHypercube(d, rng=design.seed) if design.kind == "latin_hypercube" else None
        shares = sampler.random(design.points) if sampler else _sobol(d, design.points, design.seed)
    else:
        both = _sobol(2 * d, design.points, design.seed)
        A, B = both[:, :d], both[:, d:]
        shares = np.vstack([A, B, *(np.where(np.arange(d) == i, B, A) for i in range(d))])
    columns = [axis.at(shares[:, i]) for i, axis in enumerate(axes.values()) if isinstance(axis, Range)]
    return [dict(zip(axes, point, strict=True)) for point in zip(*columns, strict=True)]


def _sobol(d: int, n: int, seed: int) -> np.ndarray:
    return np.asarray(qmc.Sobol(d, rng=seed).random(n))


def load_sweep(path: Path) -> Sweep:
    """Read a sweep file; InputError naming file, field, value and what is allowed."""
    return load_over(Sweep, path)


def load_over(kind: type[Over], path: Path) -> Over:
    """Read a study's file; a relative path of its scenario starts at the file's folder. InputError as load_sweep."""
    read = load_yaml(kind, path)
    if read.scenario.endswith((".yaml", ".yml")):
        read = read.model_copy(update={"scenario": str(path.parent / read.scenario)})
    return read


def scenario_at(of: OverScenario, point: Mapping[str, Any], source: str) -> Scenario:
    """Return the scenario of a study at a point; InputError naming study, field, value and what is allowed."""
    try:
        return load_scenario(of.scenario, (*of.settings.items(), *point.items()))
    except InputError as error:
        raise InputError(f"{source}: {error}") from None
