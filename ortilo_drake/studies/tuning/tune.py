"""Tuning: W and V fitted to recorded flights, as a scenario, with the filter's consistency before and after."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import log
from pathlib import Path

import numpy as np
import xarray as xr
import yaml

from ortilo_drake.flight.metrics import estimation_mse, loss_of, position_nees
from ortilo_drake.flight.players import choose, flown_by, player_of
from ortilo_drake.flight.saved_flight import load_flight
from ortilo_drake.model.hover import discretize, hover_A, hover_B
from ortilo_drake.model.signals import N_X
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, with_seed
from ortilo_drake.studies.consistency.consistency_flights import START, check_same_scenario, finite_part, region_masks
from ortilo_drake.studies.tuning.fit_noise import LIFT_LOST, Likelihood, Number, fit_noise
from ortilo_drake.studies.tuning.noise_likelihood import Record, refilter, used_covariance
from ortilo_drake.studies.tuning.noise_settings import noise_model
from ortilo_drake.theory.consistency.consistency import Average, normalized_square, time_average

BEFORE_LOSS = 1.0  # the last second before a loss is left out: no hover model holds there [s]
SHORTEST = 5.0  # least length of the usable part of a flight [s]
_SUFFIX = "_tuned"


@dataclass(frozen=True)
class FilterFigures:
    """NEES of position by region, NIS by sensor, and the mean squared error (x, y, z) [m^2] of a filter."""

    nees: dict[str, Average | None]
    nis: dict[str, Average | None]
    mse: list[float]


@dataclass(frozen=True)
class FlownFigures:
    """New flights: the number lost; mse (x, y, z) [m^2] and NEES over the seeds lost neither before nor after."""

    lost: int
    mse: list[float] | None
    nees: Average | None


@dataclass(frozen=True)
class Check:
    """Flights before and after a tuning, on seeds that the fit has not seen, and the players that flew."""

    seeds: list[int]
    before: FlownFigures
    after: FlownFigures
    flown_by: str


@dataclass(frozen=True)
class UsedFlight:
    """A flight that the fit used."""

    file: str
    seed: int


@dataclass(frozen=True)
class Tuning:
    """The result of `ortilo tune`; --json writes all but `fitted`, the scenario with the fitted numbers.

    scenario is the name of `fitted`. notes tell which flights were left out or shortened; numbers, counted, tilted and
    log_likelihood are those of NoiseFit. before and after are the figures of the filter as it flew (filter_figures),
    and of the fitted filter on the same measurements.
    """

    scenario: str
    flights: list[UsedFlight]
    notes: list[str]
    numbers: dict[str, Number]
    counted: tuple[str, ...]
    tilted: float
    log_likelihood: Likelihood
    before: FilterFigures
    after: FilterFigures
    fitted: Scenario


def find_flights(places: Sequence[Path]) -> list[Path]:
    """Return the files of flights, those in folders by name; InputError if a place is missing or a folder has none."""
    files: list[Path] = []
    for place in places:
        if place.is_dir():
            found = sorted(place.glob("*.nc"))
            if not found:
                own = place / "map.yaml"
                map_ = f"--map {own} reads this log" if own.exists() else "a log or a recording needs --map MAP.yaml"
                raise InputError(f"{place}: no flights (`ortilo fly --out FLIGHT.nc`) in this folder; {map_}")
            files += found
        else:
            files.append(place)
    unique = list(dict.fromkeys(files))
    if not unique:
        raise InputError("flights: none given")
    return unique


def record_of(flight: xr.Dataset, scenario: Scenario) -> Record:
    """Return the inputs that the filter had in a flight."""
    u = flight["control"].values - np.array([scenario.vehicle.hover_thrust, 0.0, 0.0, 0.0])
    return Record(
        np.ascontiguousarray(np.nan_to_num(flight["measurement"].values)),
        np.ascontiguousarray(flight["arrival"].values, dtype=float),
        np.ascontiguousarray(flight["measurement_covariance"].values),
        np.ascontiguousarray(u),
        flight["estimate"].values[0, :N_X].copy(),
        flight["covariance"].values[0, :N_X, :N_X].copy(),
        scenario.measurement.layout,
    )


def usable_part(flight: xr.Dataset, name: str, h: float) -> tuple[xr.Dataset | None, str | None]:
    """Return the usable part of a flight, None if it is too short, and a note if it is not the whole flight."""
    lost, part = loss_of(flight), finite_part(flight)
    if lost is None and part.sizes["tick"] == flight.sizes["tick"]:
        return (flight, None) if flight.sizes["tick"] * h >= SHORTEST else (None, f"{name}: too short, left out")
    ticks = part.sizes["tick"] - round(BEFORE_LOSS / h)
    cause = "lost" if lost is None else f"lost at {lost.time:.1f} s ({lost.cause})"
    if ticks * h < SHORTEST:
        return None, f"{name}: {cause}, left out"
    return part.isel(tick=slice(0, ticks)), f"{name}: {cause}, used for its first {ticks * h:.1f} s"


def filter_figures(scenario: Scenario, recorded: Scenario, flights: Sequence[xr.Dataset]) -> FilterFigures:
    """Return position's NEES by region, NIS by sensor and MSE of a scenario's filter, run over the recorded inputs."""
    noise = noise_model(scenario, recorded)
    Phi, Gamma = discretize(hover_A(scenario.yaw), hover_B(scenario.vehicle), scenario.h)
    measurement, nees = scenario.measurement, list[np.ndarray]()
    nis: dict[str, list[np.ndarray]] = {sensor: [] for sensor in measurement.sensors}
    squares, masks = [], [region_masks(flight) for flight in flights]
    for flight in flights:
        record = record_of(flight, scenario)
        xhat, P = refilter(record, noise, Phi, Gamma)
        error = xhat - flight["truth"].values
        nees.append(normalized_square(error[:, :3], P[:, :3, :3]))
        squares.append(np.mean(error[:, :3] ** 2, axis=0))
        V2 = used_covariance(record.V2, noise)
        for s, sensor in enumerate(measurement.sensors):
            C = measurement.C_of(sensor)
            e = flight["measurement"].values[:, measurement.rows_of(sensor)] - xhat @ C.T
            nis[sensor].append(normalized_square(e, C @ P @ C.T + V2[:, s, : len(C), : len(C)]))
    everywhere = [mask["all"] for mask in masks]
    return FilterFigures(
        nees={region: time_average(nees, [m[region] for m in masks], 3) for region in masks[0]},
        nis={s: time_average(values, everywhere, len(measurement.C_of(s))) for s, values in nis.items()},
        mse=np.mean(squares, axis=0).tolist(),
    )


def tune(files: Sequence[Path], progress: Callable[[int], None] = lambda evaluations: None) -> Tuning:
    """Fit W and V to flights of one scenario; progress gets the number of likelihoods computed so far.

    InputError if a file is no flight, they are of different scenarios, or there is nothing to fit to.
    """
    loaded = [load_flight(file) for file in files]
    scenario = check_same_scenario(loaded, [str(file) for file in files])
    flights, used, notes = [], [], []
    for file, flight in zip(files, loaded, strict=True):
        part, note = usable_part(flight, str(file), scenario.h)
        if note:
            notes.append(note)
        if part is not None:
            flights.append(part)
            used.append(UsedFlight(str(file), int(flight.attrs["seed"])))
    if not flights:
        raise InputError(f"{files[0]}: no flight of '{scenario.name}' is long enough to fit noise to")
    settle = round(START / scenario.h)
    fit = fit_noise(scenario, [record_of(flight, scenario) for flight in flights], settle, progress)
    if fit.tilted > 0.0:
        notes.append(
            f"{fit.tilted:.1%} of the ticks did not count: the hover model loses more than {LIFT_LOST:.0%} of the lift "
            f"to tilt, or did in the last {START:g} s"
        )
    if scenario.estimator.gates:
        notes.append("the gates hid the worst fixes from the fit: V comes out too small")
    fitted = with_seed(fit.scenario, 0).model_copy(update={"name": f"{scenario.name.removesuffix(_SUFFIX)}{_SUFFIX}"})
    before, after = (filter_figures(s, scenario, flights) for s in (scenario, fitted))
    return Tuning(
        fitted.name, used, notes, fit.numbers, fit.counted, fit.tilted, fit.log_likelihood, before, after, fitted
    )


def check_flights(
    tuning: Tuning, before: Scenario, count: int, progress: Callable[[], None], player: str = "fastest"
) -> Check:
    """Fly the scenario before and after tuning on seeds that the fit has not seen; the player is as in choose."""
    first = max(flight.seed for flight in tuning.flights) + 1
    seeds = list(range(first, first + count))
    flights: dict[str, list[xr.Dataset]] = {"before": [], "after": []}
    for name, scenario in (("before", before), ("after", tuning.fitted)):
        flying = player_of(scenario, player)
        for seed in seeds:
            flights[name].append(finite_part(flying.fly(seed)))
            progress()
    pairs = zip(flights["before"], flights["after"], strict=True)
    both = [k for k, pair in enumerate(pairs) if all(loss_of(flight) is None for flight in pair)]

    def figures(name: str) -> FlownFigures:
        kept = [flights[name][k] for k in both]
        nees = [position_nees(f) for f in kept]
        return FlownFigures(
            lost=sum(loss_of(flight) is not None for flight in flights[name]),
            mse=np.mean([list(estimation_mse(f).values()) for f in kept], axis=0).tolist() if kept else None,
            nees=time_average(nees, [np.ones(len(n), dtype=bool) for n in nees], 3) if kept else None,
        )

    by = flown_by([before], [choose(scenario, player) for scenario in (before, tuning.fitted)])
    return Check(seeds, figures("before"), figures("after"), by)


def overlay_text(tuning: Tuning) -> str:
    """Return the tuned scenario as YAML that flies, the fit's figures in a comment before it."""
    likelihood = tuning.log_likelihood
    lines = [
        f"{tuning.scenario}: W and V by maximum likelihood from {len(tuning.flights)} recorded flights (ortilo tune).",
        f"log-likelihood {likelihood.before:.1f} before, {likelihood.after:.1f} after; counted: "
        + ", ".join(tuning.counted),
        "number: before -> fitted (standard error; by the spread of the flights)",
    ]
    for name, number in tuning.numbers.items():
        if number.stays:
            lines.append(f"  {name}: {number.before:.6g} stays: {number.stays}")
        else:
            robust = "too few flights" if number.robust_error is None else f"{number.robust_error:.2g}"
            changed = f"{number.before:.6g} -> {number.after:.6g}"
            lines.append(f"  {name}: {changed} ({number.standard_error:.2g}; {robust})")
    lines += ["from:", *(f"  {its.file}, seed {its.seed}" for its in tuning.flights), *tuning.notes]
    # A file's name may hold a line break, which would end the comment.
    header = "".join(f"# {line.encode('unicode_escape').decode('ascii')}\n" for line in lines)
    return header + yaml.safe_dump(tuning.fitted.model_dump(mode="json"), sort_keys=False, allow_unicode=False)


def tuning_summary(tuning: Tuning, check: Check | None) -> list[str]:
    """Return a summary of a tuning and, if there was one, its check: what changed and what it gained, a line each."""
    fitted = {name: number for name, number in tuning.numbers.items() if number.stays is None}
    changed = {name: n for name, n in fitted.items() if n.before > 0.0 and n.after > 0.0}
    line = f"{len(fitted)} of {len(tuning.numbers)} numbers were fitted"
    if changed:
        name = max(changed, key=lambda k: abs(log(changed[k].after / changed[k].before)))
        line += f"; changed most: {name}, to {changed[name].after / changed[name].before:.3g} times what it was"
    lines = [line]
    before, after = tuning.before.nees.get("all"), tuning.after.nees.get("all")
    if before and after:
        lines.append(f"mean NEES of the position, 3 if consistent: {before.mean:.2f} -> {after.mean:.2f}")
    lines.append(f"mean squared error of the position: {_change(sum(tuning.before.mse), sum(tuning.after.mse))}")
    if check:
        line = f"on {len(check.seeds)} new seeds: {check.before.lost} -> {check.after.lost} lost"
        if check.before.mse and check.after.mse:
            line += f", mean squared error {_change(sum(check.before.mse), sum(check.after.mse))}"
        lines.append(line)
    return lines


def _change(before: float, after: float) -> str:
    share = f" ({after / before - 1.0:+.0%})" if before > 0.0 else ""
    return f"{before:.6f} -> {after:.6f} m²{share}"
