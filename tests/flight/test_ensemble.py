"""Many flights: resumable, independent of the number of workers, nothing half-written."""

import json
import os
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from ortilo_drake.flight import ensemble
from ortilo_drake.flight.ensemble import flight_file, flight_folder, flights_of, fly_many
from ortilo_drake.flight.flight import fly
from ortilo_drake.flight.metrics import summary
from ortilo_drake.flight.saved_flight import load_flight, save_flight
from ortilo_drake.flight.summary import Summary, read_summary
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import load_scenario, with_seed

SCENARIO = load_scenario(
    "nominal_imu_uwb_yolo",
    ("camera.kind=projected", "planner={kind: hover, point: [8, 1, 1.5], duration: 1}", "settle=0.0"),
)


def without_speed(summaries: list[Summary]) -> list[Summary]:
    return [replace(s, real_time_factor=1.0) for s in summaries]


def written(out: Path) -> dict[str, int]:
    return {str(p.relative_to(out)): p.stat().st_mtime_ns for p in out.rglob("*") if p.is_file()}


@pytest.fixture
def flown(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return the seeds that are flown in this process, as they are."""
    seeds: list[int] = []

    def recorded(text: str, seed: int, out: str, player: str) -> Summary:
        seeds.append(seed)
        return original(text, seed, out, player)

    original = ensemble.fly_and_save
    monkeypatch.setattr(ensemble, "fly_and_save", recorded)
    return seeds


@pytest.mark.long
def test_each_seed_is_one_file_that_holds_its_flight_and_summary(tmp_path: Path) -> None:
    found = fly_many(SCENARIO, [4, 2], tmp_path)
    assert [s.seed for s in found] == [4, 2]
    folder = flight_folder(tmp_path, SCENARIO)
    assert sorted(p.name for p in folder.iterdir()) == ["seed_000002.nc", "seed_000004.nc"]
    for seed, one in zip([4, 2], found, strict=True):
        flight = load_flight(flight_file(tmp_path, SCENARIO, seed))
        assert read_summary(flight.attrs["summary"]) == one == summary(flight)
        alone = fly(with_seed(SCENARIO, seed))
        xr.testing.assert_equal(flight, alone)


@pytest.mark.long
def test_a_second_run_flies_nothing_and_gives_the_same(tmp_path: Path, flown: list[int]) -> None:
    first = fly_many(SCENARIO, range(3), tmp_path)
    before = written(tmp_path)
    seen: list[Summary] = []
    assert fly_many(SCENARIO, range(3), tmp_path, progress=seen.append) == first == seen
    assert written(tmp_path) == before
    assert flown == [0, 1, 2]


def test_the_scenarios_own_seed_does_not_matter(tmp_path: Path, flown: list[int]) -> None:
    first = fly_many(SCENARIO, range(2), tmp_path)
    assert fly_many(with_seed(SCENARIO, 99), range(2), tmp_path) == first
    assert flown == [0, 1]


def flipped(data: bytes) -> bytes:
    """Return the bytes with one bit of the middle one changed: xarray reads such a file, or HDF5 ends the process."""
    middle = len(data) // 2
    return data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :]


@pytest.mark.long
@pytest.mark.parametrize(
    "damage", ["deleted", "truncated", "emptied", "one bit", "text", "without a summary", "another's"]
)
def test_only_a_missing_or_damaged_flight_is_flown_again_and_told(
    tmp_path: Path, flown: list[int], damage: str, caplog: pytest.LogCaptureFixture
) -> None:
    first = fly_many(SCENARIO, range(3), tmp_path)
    before = written(tmp_path)
    path = flight_file(tmp_path, SCENARIO, 1)
    whole = path.read_bytes()
    match damage:
        case "deleted":
            path.unlink()
        case "truncated":
            path.write_bytes(whole[:-1000])
        case "emptied":
            path.write_bytes(b"")
        case "one bit":
            path.write_bytes(flipped(whole))
        case "text":
            path.write_text("not a flight\n")
        case "another's":
            path.write_bytes(flight_file(tmp_path, SCENARIO, 2).read_bytes())
        case "without a summary":
            flight = load_flight(path)
            del flight.attrs["summary"]
            save_flight(flight, path)
    assert without_speed(fly_many(SCENARIO, range(3), tmp_path)) == without_speed(first)
    assert flown == [0, 1, 2, 1]
    changed = {name for name, mtime in written(tmp_path).items() if before[name] != mtime}
    assert changed == {str(path.relative_to(tmp_path))}
    told = [record.getMessage() for record in caplog.records]
    assert len(told) == (0 if damage == "deleted" else 1)
    assert all(line.startswith(f"{path}: ") and line.endswith(": flown again") for line in told)
    caplog.clear()
    fly_many(SCENARIO, range(3), tmp_path)
    assert (flown, caplog.records) == ([0, 1, 2, 1], [])


@pytest.mark.long
def test_an_interrupted_run_keeps_what_it_flew_and_goes_on_there(tmp_path: Path, flown: list[int]) -> None:
    def stop_after_two(one: Summary) -> None:
        if one.seed == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fly_many(SCENARIO, range(4), tmp_path, progress=stop_after_two)
    assert len(written(tmp_path)) == 2
    assert [s.seed for s in fly_many(SCENARIO, range(4), tmp_path)] == [0, 1, 2, 3]
    assert flown == [0, 1, 2, 3]


def test_a_write_that_fails_leaves_no_partial_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(InputError, match=r"seed_000000\.nc: cannot be written: No space left on device"):
        fly_many(SCENARIO, [0], tmp_path)
    assert written(tmp_path) == {}


def test_what_a_killed_run_left_half_written_is_removed(tmp_path: Path, flown: list[int]) -> None:
    folder = flight_folder(tmp_path, SCENARIO)
    folder.mkdir()
    half = folder / ".ortilo-0123456789abcdef.partial"
    half.write_bytes(b"half a flight")
    two_days_ago = time.time() - 2 * 86400.0
    os.utime(half, (two_days_ago, two_days_ago))
    fly_many(SCENARIO, [0], tmp_path)
    assert [p.name for p in folder.iterdir()] == ["seed_000000.nc"]


@pytest.mark.parametrize(
    "setting", ["settle=0.1", "estimator.V.imu=[0.0002, 0.0001, 0.0001]", "name=other", "world.kinematics=rigid_body"]
)
def test_other_settings_get_a_folder_of_their_own(setting: str) -> None:
    other = load_scenario(
        "nominal_imu_uwb_yolo",
        ("camera.kind=projected", "planner={kind: hover, point: [8, 1, 1.5], duration: 1}", "settle=0.0", setting),
    )
    assert flight_folder(Path(), other) != flight_folder(Path(), SCENARIO)
    assert flight_folder(Path(), with_seed(SCENARIO, 7)) == flight_folder(Path(), SCENARIO)


@pytest.mark.parametrize("name", ["../../elsewhere", "/tmp/elsewhere", "a/b", "..", ""])
def test_a_name_that_leads_out_of_the_folder_is_refused(name: str) -> None:
    with pytest.raises(InputError, match=f"name: {name!r}"):
        load_scenario("nominal_imu_uwb", (f"name={json.dumps(name)}",))


@pytest.mark.long
def test_saved_flights_are_read_back_in_the_order_asked_for(tmp_path: Path) -> None:
    fly_many(SCENARIO, [0, 1], tmp_path)
    assert [f.attrs["seed"] for f in flights_of(SCENARIO, [1, 0], tmp_path)] == [1, 0]
    with pytest.raises(InputError, match=r"seed_000005\.nc"):
        flights_of(SCENARIO, [0, 5], tmp_path)
    with pytest.raises(InputError, match="none"):
        flights_of(SCENARIO, [], tmp_path)


@pytest.mark.processes
def test_two_workers_fly_the_same_bits_as_one(tmp_path: Path) -> None:
    alone = fly_many(SCENARIO, range(5), tmp_path / "one", workers=1)
    together = fly_many(SCENARIO, range(5), tmp_path / "two", workers=2)
    assert without_speed(together) == without_speed(alone)
    for seed in range(5):
        one, two = (load_flight(flight_file(tmp_path / out, SCENARIO, seed)) for out in ("one", "two"))
        xr.testing.assert_equal(one, two)  # NaN where nothing arrived
        for name in one.data_vars:
            assert np.array_equal(one[name].values, two[name].values, equal_nan=True)
    assert len(written(tmp_path / "two")) == 5
