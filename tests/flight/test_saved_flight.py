"""Flights on disk: whole or refused in one line, whatever was done to the file; HDF5 sees no damaged byte."""

import hashlib
import io
import json
import os
import pickle
import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import xarray as xr
from made_up_summaries import made_up_summary

from ortilo_drake.flight.flight import flight_dataset, fly, scenario_of
from ortilo_drake.flight.saved_flight import load_flight, save_flight, summary_in
from ortilo_drake.flight.store import unsealed
from ortilo_drake.flight.summary import summary_text
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import load_scenario

TICKS, TAIL = 12, len("\nortilo-drake flight, sha256 \n") + 64
SCENARIO = load_scenario("nominal_imu_uwb", seed=3)
SUMMARY = made_up_summary((0.1, 0.2, 0.3))


def made_up() -> xr.Dataset:
    """Return a Dataset laid out as a flight is, of random numbers."""
    logged = np.random.default_rng(0).normal(size=(TICKS, sum(SCENARIO.measurement.logged_sizes().values())))
    flight = flight_dataset(SCENARIO, SCENARIO.h * np.arange(TICKS), logged, None)
    flight.attrs |= {"real_time_factor": 2.5, "summary": summary_text(SUMMARY)}
    return flight


def digest_line(data: bytes) -> bytes:
    return b"\nortilo-drake flight, sha256 " + hashlib.sha256(data).hexdigest().encode() + b"\n"


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("saved") / "flight.nc"
    save_flight(made_up(), path)
    return path.read_bytes()


@pytest.fixture
def saved(tmp_path: Path, data: bytes) -> Path:
    (tmp_path / "flight.nc").write_bytes(data)
    return tmp_path / "flight.nc"


def refusal(path: Path) -> str:
    with pytest.raises(InputError) as refused:
        load_flight(path)
    line = str(refused.value)
    assert line.startswith(f"{path}: ")
    assert "\n" not in line
    assert len(line) < 400
    return line


@pytest.mark.long
def test_the_file_is_plain_netcdf_with_a_digest_behind_it(saved: Path, data: bytes) -> None:
    assert data[-TAIL:] == digest_line(data[:-TAIL])
    flight = made_up()
    for engine in (None, "h5netcdf"):
        with xr.open_dataset(saved, engine=engine) as plain:
            xr.testing.assert_identical(plain, flight)
    with h5py.File(saved) as file:
        np.testing.assert_array_equal(file["truth"][:], flight["truth"].values)
    xr.testing.assert_identical(load_flight(saved), flight)
    assert summary_in(unsealed(saved.read_bytes(), "flight")) == SUMMARY


def test_a_copy_without_the_digest_is_refused_and_told_why(saved: Path) -> None:
    saved.write_bytes(saved.read_bytes()[:-TAIL])
    assert "the line with its digest is missing" in refusal(saved)


# --- damage: the digest is wrong, and HDF5 must not see the file ------------------------------------------------


@pytest.fixture
def unseen_by_hdf5(monkeypatch: pytest.MonkeyPatch) -> None:
    def seen(*_: Any, **__: Any) -> None:
        raise AssertionError("HDF5 was given a damaged file")

    monkeypatch.setattr(h5py, "File", seen)
    monkeypatch.setattr(xr, "open_dataset", seen)


DAMAGE: dict[str, Callable[[bytes], bytes]] = {
    "empty": lambda data: b"",
    "one byte": lambda data: data[:1],
    "the magic number": lambda data: data[:8],
    "the first half": lambda data: data[: len(data) // 2],
    "all but the last byte": lambda data: data[:-1],
    "all but the digest": lambda data: data[:-TAIL],
    "all but half the digest": lambda data: data[: -TAIL // 2],
    "the digest alone": lambda data: data[-TAIL:],
    "the second half": lambda data: data[len(data) // 2 :],
    "a byte more before": lambda data: b"\0" + data,
    "a byte more behind": lambda data: data + b"\0",
    "a line break more": lambda data: data + b"\n",
    "twice": lambda data: data + data,
    "the digest twice": lambda data: data + data[-TAIL:],
    "zeros": lambda data: bytes(len(data)),
    "zeros and the digest": lambda data: bytes(len(data) - TAIL) + data[-TAIL:],
    "ones and the digest": lambda data: b"\xff" * (len(data) - TAIL) + data[-TAIL:],
    "a hole": lambda data: data[:4096] + bytes(4096) + data[8192:],
    "a hole at the end": lambda data: data[:-5000] + bytes(5000 - TAIL) + data[-TAIL:],
    "a page left out": lambda data: data[:4096] + data[8192:],
    "two pages exchanged": lambda data: data[:4096] + data[8192:12288] + data[4096:8192] + data[12288:],
    "the magic number changed": lambda data: b"\x89HDG" + data[4:],
    "version of the header": lambda data: data[:8] + b"\x07" + data[9:],
    "sizes in the header": lambda data: data[:9] + b"\xff\xff" + data[11:],
    "end of file in the header": lambda data: data[:28] + b"\xff" * 8 + data[36:],
    "another's digest": lambda data: data[:-TAIL] + digest_line(b"another"),
    "digest in capitals": lambda data: data[:-65] + data[-65:].upper(),
    "line ends of Windows": lambda data: data.replace(b"\n", b"\r\n"),
    "as text": lambda data: data.decode("latin-1").encode(),
    "netCDF-3": lambda data: b"CDF\x01" + bytes(2000),
    "text": lambda data: b"time,x,y\n" * 500,
    "YAML": lambda data: b"name: nominal_imu_uwb\n",
    "a ZIP": lambda data: b"PK\x03\x04" + bytes(500),
    "a pickle": lambda data: pickle.dumps([os.getcwd]),
}  # fmt: skip


@pytest.mark.parametrize("damage", DAMAGE)
def test_damage_is_told_before_hdf5_sees_it(saved: Path, data: bytes, damage: str, unseen_by_hdf5: None) -> None:
    saved.write_bytes(DAMAGE[damage](data))
    assert "damaged" in refusal(saved)


def test_no_flip_truncation_or_overwriting_passes(saved: Path, data: bytes, unseen_by_hdf5: None) -> None:
    rng = np.random.default_rng(12)
    for k in range(200):
        at = int(rng.integers(len(data)))
        damaged = bytearray(data)
        match k % 3:
            case 0:
                damaged[at] ^= 1 << int(rng.integers(8))
            case 1:
                del damaged[at:]
            case 2:
                damaged[at : at + 64] = rng.bytes(len(damaged[at : at + 64]))
        saved.write_bytes(bytes(damaged))
        assert "damaged" in refusal(saved)


# --- what is no file --------------------------------------------------------------------------------------------


def test_what_is_no_file_is_refused_at_once(tmp_path: Path) -> None:
    assert refusal(tmp_path / "gone.nc").endswith("cannot be read: No such file or directory")
    assert refusal(tmp_path).endswith("cannot be read: Is a directory")
    os.mkfifo(tmp_path / "pipe.nc")
    assert refusal(tmp_path / "pipe.nc").endswith("cannot be read: is no regular file")
    (tmp_path / "endless.nc").symlink_to("/dev/zero")  # only read
    assert refusal(tmp_path / "endless.nc").endswith("cannot be read: is no regular file")


def test_a_file_too_large_is_refused_before_it_is_read(tmp_path: Path) -> None:
    path = tmp_path / "huge.nc"
    with path.open("wb") as file:
        file.truncate(2**40)  # a hole, which takes no space
    assert "at most 2048 MiB are read" in refusal(path)


# --- foreign files: the digest is right, the contents are not a flight's -------------------------------------------


def sealed(path: Path, dataset: xr.Dataset, **encoding: Any) -> None:
    data = bytes(dataset.to_netcdf(engine="h5netcdf", **encoding))
    path.write_bytes(data + digest_line(data))


def without(name: str) -> Callable[[xr.Dataset], xr.Dataset]:
    return lambda flight: flight.drop_vars(name)


def with_attribute(name: str, value: Any) -> Callable[[xr.Dataset], xr.Dataset]:
    return lambda flight: flight.assign_attrs({name: value})


def without_attribute(name: str) -> Callable[[xr.Dataset], xr.Dataset]:
    def dropped(flight: xr.Dataset) -> xr.Dataset:
        del flight.attrs[name]
        return flight

    return dropped


def other_seed(flight: xr.Dataset) -> xr.Dataset:
    return flight.assign_attrs(scenario=json.dumps(json.loads(flight.attrs["scenario"]) | {"seed": 4}))


FOREIGN: dict[str, tuple[Callable[[xr.Dataset], xr.Dataset], str]] = {
    "another's": (lambda f: xr.Dataset({"t2m": ("station", [1.0])}), "scenario: is 'None', must be text"),
    "nothing": (lambda f: xr.Dataset(), "scenario: is 'None', must be text"),
    "another's variables": (lambda f: xr.Dataset({"t2m": ("station", [1.0])}, attrs=f.attrs), "truth: is missing"),
    "no truth": (without("truth"), "truth: is missing"),
    "no arrival": (without("arrival"), "arrival: is missing"),
    "no time": (without("time"), "time: is missing"),
    "no names": (without("state"), "state: is missing"),
    "no ticks": (lambda f: f.isel(tick=slice(0, 0)), "time: must be finite and ascending"),
    "fewer states": (lambda f: f.isel(state=slice(0, 6)), "truth: is "),
    "one axis": (lambda f: f.isel(axis=0, drop=True), "reference: is "),
    "turned": (lambda f: f.transpose(..., "tick"), "truth: is "),
    "renamed": (lambda f: f.rename(tick="time_step"), "truth: is "),
    "other order": (lambda f: f.isel(state=slice(None, None, -1)), "state: must be x, y, z, "),
    "other names": (lambda f: f.assign_coords(sensor=["a", "b", "c"]), "sensor: must be uwb, camera, imu"),
    "single precision": (lambda f: f.assign(truth=f["truth"].astype(np.float32)), "truth: holds float32"),
    "integers": (lambda f: f.assign(control=f["control"].astype(int)), "control: holds int64"),
    "words": (lambda f: f.assign(control=f["control"].astype(str)), "control: holds "),
    "numbers for flags": (lambda f: f.assign(arrival=f["arrival"].astype(float)), "arrival: holds float64"),
    "dates": (lambda f: f.assign(truth=f["truth"].assign_attrs(units="days since 2000-01-01")), "holds datetime"),
    "time backwards": (lambda f: f.assign_coords(time=-f["time"]), "time: must be finite and ascending"),
    "time unknown": (lambda f: f.assign_coords(time=np.nan * f["time"]), "time: must be finite and ascending"),
    "no scenario": (without_attribute("scenario"), "scenario: is 'None', must be text"),
    "scenario a number": (with_attribute("scenario", 3.0), "scenario: is '3.0', must be text"),
    "scenario many": (with_attribute("scenario", ["a", "b"]), "scenario: is "),
    "scenario no JSON": (with_attribute("scenario", "nominal_imu_uwb"), "Expecting value"),
    "scenario a list": (with_attribute("scenario", "[]"), "scenario: "),
    "scenario nested deeply": (with_attribute("scenario", "[" * 20_000), "recursion"),
    "scenario of another program": (with_attribute("scenario", '{"altitude": 3}'), "scenario: altitude: unknown key"),
    "scenario out of range": (with_attribute("scenario", '{"control_rate": -1}'), "scenario: control_rate"),
    "scenario with NaN": (with_attribute("scenario", '{"control_rate": NaN}'), "scenario: control_rate"),
    "scenario of another seed": (other_seed, "seed: is 3, that of its scenario is 4"),
    "no seed": (without_attribute("seed"), "seed: is 'None', must be an integer"),
    "seed a text": (with_attribute("seed", "three"), "seed: is 'three', must be an integer"),
    "seed a fraction": (with_attribute("seed", 3.0), "seed: is '3.0', must be an integer"),
    "no word of its loss": (without_attribute("lost"), "lost: is 'None', must be text"),
    "lost a number": (with_attribute("lost", 0), "lost: is '0', must be text"),
    "lost no JSON": (with_attribute("lost", "tumbled"), "Expecting value"),
    "lost without a cause": (with_attribute("lost", '{"time": 1.0}'), "cause"),
    "lost at a word": (with_attribute("lost", '{"time": "late", "cause": "x"}'), "lost: must be null, or"),
    "speed a text": (with_attribute("real_time_factor", "fast"), "real_time_factor: must be a number"),
}  # fmt: skip


@pytest.mark.family
@pytest.mark.parametrize("kind", FOREIGN)
def test_a_foreign_dataset_is_refused_by_what_is_wrong(tmp_path: Path, kind: str) -> None:
    change, expected = FOREIGN[kind]
    sealed(tmp_path / "foreign.nc", change(made_up()))
    assert expected in refusal(tmp_path / "foreign.nc")


@pytest.mark.long
def test_a_flight_with_registered_sensors_is_read_back(tmp_path: Path) -> None:
    flight = fly(load_scenario("flow", ("settle=0", "planner={kind: hover, duration: 0.5}"), 3))
    save_flight(flight, tmp_path / "flow.nc")
    found = load_flight(tmp_path / "flow.nc")
    xr.testing.assert_identical(found, flight)
    assert found["sensor"].values.tolist() == ["uwb", "camera", "imu", "altimeter", "flow"]
    assert found["output"].values.tolist()[9:] == ["z_alt", "x_dot_flow", "y_dot_flow"]
    assert scenario_of(found) == load_scenario("flow", ("settle=0", "planner={kind: hover, duration: 0.5}"), 3)
    fewer = flight.isel(sensor=slice(0, 4))
    sealed(tmp_path / "fewer.nc", fewer)
    assert "measurement_covariance: is " in refusal(tmp_path / "fewer.nc")


@pytest.mark.long
def test_more_than_a_flight_needs_is_kept(tmp_path: Path) -> None:
    flight = made_up().assign(wind=("tick", np.zeros(TICKS))).assign_attrs(remark="windy")
    save_flight(flight, tmp_path / "more.nc")
    xr.testing.assert_identical(load_flight(tmp_path / "more.nc"), flight)


def a_link(file: h5py.File, folder: Path) -> None:
    del file["truth"]
    file["truth"] = h5py.ExternalLink(str(folder / "secret.h5"), "/truth")


def a_soft_link(file: h5py.File, folder: Path) -> None:
    file["shortcut"] = h5py.SoftLink("/truth")


def a_group(file: h5py.File, folder: Path) -> None:
    file.create_group("more")


def a_virtual_array(file: h5py.File, folder: Path) -> None:
    layout = h5py.VirtualLayout(shape=(TICKS, 12), dtype=float)
    layout[:] = h5py.VirtualSource(str(folder / "secret.h5"), "truth", shape=(TICKS, 12))
    del file["truth"]
    file.create_virtual_dataset("truth", layout)


def an_external_array(file: h5py.File, folder: Path) -> None:
    del file["truth"]
    file.create_dataset("truth", (TICKS, 12), float, external=[(str(folder / "secret.h5"), 0, h5py.h5f.UNLIMITED)])


def a_huge_array(file: h5py.File, folder: Path) -> None:
    file.create_dataset("huge", (2**40,), float, chunks=(2**20,), fillvalue=1.0)  # not one chunk is there


def a_huge_chunk(file: h5py.File, folder: Path) -> None:
    file.create_dataset("chunk", (8,), float, chunks=(2**28,), maxshape=(None,), compression="gzip")


def a_compound(file: h5py.File, folder: Path) -> None:
    file["pairs"] = np.zeros(3, dtype=[("a", float), ("b", int)])


def a_reference(file: h5py.File, folder: Path) -> None:
    file["to"] = file["truth"].ref


def an_opaque_array(file: h5py.File, folder: Path) -> None:
    file["pickled"] = np.void(b"\x80\x04\x95\x1e\x00\x00\x00")


def ragged_rows(file: h5py.File, folder: Path) -> None:
    file.create_dataset("rows", (2,), h5py.vlen_dtype(float))


@pytest.mark.family
@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (a_link, "truth: is a link to elsewhere"),
        (a_soft_link, "shortcut: is a link to elsewhere"),
        (a_group, "more: is a group"),
        (a_virtual_array, "truth: is kept in another file"),
        (an_external_array, "truth: is kept in another file"),
        (a_huge_array, "bytes, at most 2147483648"),
        (a_huge_chunk, "bytes, at most 2147483648"),
        (a_compound, "pairs: holds "),
        (a_reference, "to: holds object, neither numbers nor words"),
        (an_opaque_array, "pickled: holds |V7"),
        (ragged_rows, "rows: holds object, neither numbers nor words"),
    ],
)
def test_a_file_that_leads_elsewhere_or_holds_more_than_numbers_is_refused(
    tmp_path: Path, change: Callable[[h5py.File, Path], None], expected: str
) -> None:
    with h5py.File(tmp_path / "secret.h5", "w") as secret:
        secret["truth"] = np.ones((TICKS, 12))
    packed = io.BytesIO(bytes(made_up().to_netcdf(engine="h5netcdf")))
    with h5py.File(packed, "r+") as file:
        change(file, tmp_path)
    path = tmp_path / "odd.nc"
    path.write_bytes(packed.getvalue() + digest_line(packed.getvalue()))
    assert expected in refusal(path)


# --- a full disk --------------------------------------------------------------------------------------------------

FULL_DISK = """
import resource, sys
from pathlib import Path
sys.path[:0] = [sys.argv[2], str(Path(sys.argv[2]).parent)]
from test_saved_flight import InputError, made_up, save_flight
flight = made_up()
resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000))
try:
    save_flight(flight, Path(sys.argv[1]))
except InputError as error:
    print(error)
"""


@pytest.mark.processes
def test_a_full_disk_is_told_in_one_line_and_leaves_nothing(tmp_path: Path) -> None:
    assert resource.getrlimit(resource.RLIMIT_FSIZE)[1] == resource.RLIM_INFINITY
    command = (sys.executable, "-c", FULL_DISK, str(tmp_path / "flight.nc"), str(Path(__file__).parent))
    ended = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert (ended.returncode, ended.stderr) == (0, "")  # HDF5 ended the process by signal 11 here
    assert ended.stdout == f"{tmp_path}/flight.nc: cannot be written: File too large\n"
    assert list(tmp_path.iterdir()) == []


def test_a_flight_saved_before_the_columns_of_p_had_names_is_given_them(tmp_path: Path) -> None:
    flight = made_up()
    save_flight(flight.drop_vars("xbar_column"), tmp_path / "old.nc")
    xr.testing.assert_identical(load_flight(tmp_path / "old.nc"), flight)
