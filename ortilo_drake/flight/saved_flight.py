"""Flights on disk: netCDF-4 followed by a digest.

The HDF5 library may end the process on a damaged file or a full disk. So a file is made in memory, and the digest of
flight/store.py is checked before HDF5 sees any bytes. HDF5 reads a file up to the length in its header and ignores the
rest, so h5py, netCDF-C and xarray open the file as it is. (With a digest in front, in HDF5's user block, xarray would
not recognise the format. A digest in an attribute would be read by HDF5. A digest in a second file would be lost when
the flight is copied.)
"""

import io
import json
import sys
import warnings
from contextlib import AbstractContextManager, nullcontext
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np
import xarray as xr

from ortilo_drake.flight.flight import flight_dataset
from ortilo_drake.flight.store import LARGEST, keep, reason_of, unsealed
from ortilo_drake.flight.summary import Summary, read_summary
from ortilo_drake.model.input_files import read_bytes
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario
from ortilo_drake.scenario.scenario import scenario_from_json

FLIGHT: Final = "flight"  # the origin `of` of flight/store.py, the same for every file name


def save_flight(flight: xr.Dataset, path: Path) -> None:
    """Write a flight to a netCDF file with a digest; InputError if the file cannot be written."""
    encoding = {name: {"zlib": True, "complevel": 1} for name in flight.data_vars}
    with _no_lock_of_dask():
        data = bytes(flight.to_netcdf(engine="h5netcdf", encoding=encoding))
    keep(path, data, FLIGHT)


def _no_lock_of_dask() -> AbstractContextManager[Any]:
    """Keep xarray in a Dask worker from asking the scheduler for a lock on the memory that xarray writes to."""
    dask = sys.modules.get("dask")
    return nullcontext() if dask is None else dask.config.set(scheduler="synchronous")


def load_flight(path: Path) -> xr.Dataset:
    """Read a flight that save_flight wrote; InputError if the file is missing or damaged, or is not such a flight."""
    data = read_bytes(path, LARGEST)
    try:
        data = unsealed(data, FLIGHT)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None
    try:
        _require_plain_arrays(data)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a foreign file may cause any warning; it is refused below
            with xr.open_dataset(io.BytesIO(data), engine="h5netcdf") as dataset:
                flight = dataset.load()
        if "xbar" in flight and "xbar_column" not in flight:  # a file from before the columns of P had names
            flight = flight.assign_coords(xbar_column=flight["xbar"].values)
        _require_flight(flight)
    except Exception as error:  # xarray, h5netcdf and h5py raise a dozen kinds of errors for foreign files
        raise InputError(f"{path}: not a flight: {reason_of(error)}") from None
    return flight


def summary_in(data: bytes) -> Summary:
    """Return the summary in the netCDF bytes of a flight of fly_many, without its arrays; ValueError if none."""
    with h5py.File(io.BytesIO(data), "r") as file:
        if "summary" not in file.attrs:
            raise ValueError("has no summary")
        return read_summary(file.attrs["summary"])


def _require_plain_arrays(data: bytes) -> None:
    """Refuse an HDF5 file that links to other files, holds more than arrays of numbers and words, or is too large."""
    size = 0
    with h5py.File(io.BytesIO(data), "r") as file:
        for name in file:
            if not isinstance(file.get(name, getlink=True), h5py.HardLink):
                raise InputError(f"{name}: is a link to elsewhere")
            found = file[name]
            if not isinstance(found, h5py.Dataset):
                raise InputError(f"{name}: is a group")
            if found.is_virtual or found.external:
                raise InputError(f"{name}: is kept in another file")
            words = h5py.check_string_dtype(found.dtype) is not None
            if not words and found.dtype.kind not in "biuf":
                raise InputError(f"{name}: holds {found.dtype}, neither numbers nor words")
            at_once = int(np.prod(found.chunks, dtype=float)) if found.chunks else 0
            size += max(found.size, at_once) * found.dtype.itemsize
    if size > LARGEST:
        raise InputError(f"its arrays take {size} bytes, at most {LARGEST}")


@lru_cache(maxsize=16)
def _pattern(scenario: Scenario) -> xr.Dataset:
    """Return a flight of one tick, as the pattern of a flight's variables, dimensions and attributes."""
    return flight_dataset(scenario, np.zeros(1), np.zeros((1, sum(scenario.measurement.logged_sizes().values()))), None)


def _require_flight(flight: xr.Dataset) -> None:
    """Refuse a Dataset without the layout of flight_dataset; further variables and attributes are allowed."""
    scenario = _scenario_in(flight.attrs)
    for name, wanted in _pattern(scenario).variables.items():
        if name not in flight.variables:
            raise InputError(f"{name}: is missing")
        found = flight[name]
        shape = tuple(found.sizes[d] if d == "tick" and d in found.dims else n for d, n in wanted.sizes.items())
        if found.dims != wanted.dims or found.shape != shape:
            raise InputError(f"{name}: is {dict(found.sizes)}, must be {dict(wanted.sizes)}, with any number of ticks")
        if wanted.dtype.kind == "U":
            if found.values.tolist() != wanted.values.tolist():
                raise InputError(f"{name}: must be {', '.join(wanted.values)}")
        elif found.dtype != wanted.dtype:
            raise InputError(f"{name}: holds {found.dtype}, must be {wanted.dtype}")
    time = flight["time"].values
    if len(time) == 0 or not np.isfinite(time).all() or (np.diff(time) <= 0.0).any():
        raise InputError("time: must be finite and ascending, at least one tick")


def _scenario_in(attributes: dict[Any, Any]) -> Scenario:
    """Return the scenario in the attributes of a flight; check the other attributes as well."""
    for name, kind, called in (
        ("scenario", str, "text"),
        ("seed", int | np.integer, "an integer"),
        ("lost", str, "text"),
    ):
        if not isinstance(attributes.get(name), kind):
            raise InputError(f"{name}: is {str(attributes.get(name))[:40]!r}, must be {called}")
    scenario = scenario_from_json(attributes["scenario"], attributes.get("format"), "scenario")
    if scenario.seed != attributes["seed"]:
        raise InputError(f"seed: is {attributes['seed']}, that of its scenario is {scenario.seed}")
    lost = json.loads(attributes["lost"])
    if lost is not None and not (isinstance(lost["time"], float) and isinstance(lost["cause"], str)):
        raise InputError("lost: must be null, or a time and a cause")
    if not isinstance(attributes.get("player", ""), str):
        raise InputError("player: must be text")
    if not isinstance(attributes.get("real_time_factor", 1.0), float):
        raise InputError("real_time_factor: must be a number")
    return scenario
