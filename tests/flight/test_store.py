"""What is kept: whatever is done to a file, its figures are those that were written, or it is told and not used."""

import io
import logging
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Annotated, Any, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from made_up_summaries import made_up_summary
from pydantic import Field
from pydrake.trajectories import PiecewisePolynomial

from ortilo_drake.flight.ensemble import fly_kept, kept_file
from ortilo_drake.flight.flight import flight_dataset
from ortilo_drake.flight.saved_flight import FLIGHT, save_flight, summary_in
from ortilo_drake.flight.store import in_folder, keep, keep_json, kept, kept_json, sealed, unsealed
from ortilo_drake.flight.summary import Loss, Summary, summary_text
from ortilo_drake.hil.restart import checkpoint
from ortilo_drake.model.typed_yaml import validate
from ortilo_drake.scenario import load_scenario
from ortilo_drake.studies.faults.fault_flights import Course
from ortilo_drake.studies.maps import map_flights
from ortilo_drake.studies.maps.chunks import chunk_file, columns_of, read_chunk, write_chunk
from ortilo_drake.studies.maps.map_flights import fly_map
from ortilo_drake.studies.maps.map_report import map_csv
from ortilo_drake.studies.maps.sweep import Sweep
from ortilo_drake.studies.rare import rare_flights
from ortilo_drake.studies.rare.subset import Climb, Plan
from ortilo_drake.studies.sensitivity.sensitivity_flights import Outcome

SCENARIO = load_scenario("nominal_imu_uwb", seed=3)
COLUMNS, SEEDS = columns_of(SCENARIO), range(40)
PLAN = Plan((1.0, 2.0), ((0.5, 0.4), (0.25, 0.2)), 2000, 1, True)
CLIMB = Climb(0.125, (0.5, 0.25), (0.3, 0.4), 1900, 0)
COURSES = [Course(7, None, [0.25, 0.5], [3.0, float("nan")]), Course(8, 1.5, [0.25], [2.0])]


def figures(n: int = len(SEEDS)) -> np.ndarray:
    """Return figures as flights may have them, some lost."""
    rng = np.random.default_rng(4)
    found = rng.gamma(2.0, size=(n, len(COLUMNS)))
    found[:, 0], found[:, 1] = rng.integers(1, 900, n), rng.integers(-1, 4, n)
    counts = [i for i, name in enumerate(COLUMNS) if name.startswith(("arrived_", "due_"))]
    found[:, counts] = rng.integers(0, 900, (n, len(counts)))
    found[0, 1], found[0, 5], found[0, 9] = -1, np.nan, np.nan  # a path that turns back, a P that is not definite
    found[1, 1], found[1, 2:10] = 0, np.nan  # diverged at once
    return found


def made_up_flight(summary: Summary) -> Any:
    logged = np.random.default_rng(0).normal(size=(9, sum(SCENARIO.measurement.logged_sizes().values())))
    flight = flight_dataset(SCENARIO, SCENARIO.h * np.arange(9), logged, None)
    flight.attrs["summary"] = summary_text(summary)
    return flight


SUMMARY = replace(made_up_summary((0.1, 0.2, 0.3)), lost=Loss(1.25, "tumbled"))
PATH = PiecewisePolynomial.CubicHermite([0.0, 1.0, 3.0], np.eye(3), np.zeros((3, 3)))
STATE = checkpoint.Checkpoint(7, 100, np.linspace(-1.0, 1.0, 60))


class Kind(NamedTuple):
    """A kind of kept file: its name, what writes it and what reads it: something to compare, None if not used."""

    name: str
    write: Callable[[Path], None]
    read: Callable[[Path], Any]


def in_json(name: str, value: Any, kind: Any) -> Kind:
    return Kind(
        name,
        lambda file: keep_json(file, value, in_folder(file)),
        lambda file: repr(found) if (found := kept_json(file, kind, in_folder(file))) is not None else None,
    )


def read_chunk_bytes(file: Path) -> bytes | None:
    found = read_chunk(file.parent, SEEDS, COLUMNS)
    return None if found is None else found.tobytes()


def read_path(file: Path) -> Any:
    found = checkpoint.load_path(file.with_name("c.npz"), 7)
    return found and found.vector_values([0.0, 0.7, 3.0]).tolist()


def read_state(file: Path) -> Any:
    found = checkpoint.load_checkpoint(file, 7, 110, 1.0 / 30.0, 60)
    return found and (found.tick, found.state.tolist())


KINDS = {
    "map": Kind(
        chunk_file(Path(), SEEDS).name,
        lambda file: write_chunk(file.parent, SEEDS, COLUMNS, figures()),
        read_chunk_bytes,
    ),
    "rare, plan": in_json("plan.json", PLAN, Plan),
    "rare, climb": in_json("climb.json", CLIMB, Climb),
    "rare, count": in_json("counted.json", 12, int),
    "faults": in_json("courses.json", COURSES, list[Course]),
    "sensitivity": in_json("outcomes.json", [Outcome(1, True, {"x": 0.5, "y": 0.25}, 3.0)], list[Outcome]),
    "virtual time": in_json("3.json", SUMMARY, Summary),
    "flight": Kind(
        "f.nc",
        lambda file: save_flight(made_up_flight(SUMMARY), file),
        lambda file: (found := kept(file, FLIGHT, summary_in)) and repr(found),
    ),
    "checkpoint": Kind("c.npz", lambda file: checkpoint.save_checkpoint(file, STATE), read_state),
    "session": Kind(
        "c.npz", lambda file: checkpoint.save_checkpoint(file, STATE), lambda file: checkpoint.session_of(file) or None
    ),
    "path": Kind(
        "c.path.npz", lambda file: checkpoint.save_path(file.with_name("c.npz"), 7, PATH), read_path
    ),
}  # fmt: skip


def damaged(data: bytes, at: int, bit: int, how: str) -> bytes:
    at %= len(data)
    match how:
        case "cut":
            return data[:at]
        case "left out":
            return data[:at] + data[at + 1 + bit :]
        case "longer":
            return data + data[at : at + 1 + bit]
    return data[:at] + bytes([data[at] ^ 1 << bit]) + data[at + 1 :]


@pytest.mark.family
@pytest.mark.parametrize("name", KINDS)
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    at=st.integers(0, 2**40), bit=st.integers(0, 7), how=st.sampled_from(["flip"] * 5 + ["cut", "left out", "longer"])
)
def test_damage_is_told_in_one_line_and_never_used(
    name: str, tmp_path: Path, caplog: pytest.LogCaptureFixture, at: int, bit: int, how: str
) -> None:
    kind = KINDS[name]
    file = tmp_path / kind.name
    if not file.exists():
        kind.write(file)
        (tmp_path / "whole").write_bytes(file.read_bytes())
        assert kind.read(file) is not None
        assert not caplog.records
    whole = (tmp_path / "whole").read_bytes()
    file.write_bytes(whole)
    before = kind.read(file)
    caplog.clear()
    file.write_bytes(damaged(whole, at, bit, how))
    found = kind.read(file)
    told = [record.getMessage() for record in caplog.records]
    if file.read_bytes() == whole:
        assert (found, told) == (before, [])
    else:
        assert found is None
        assert len(told) == 1
        assert told[0].startswith(f"{file}: ")
        assert "\n" not in told[0]


@given(st.binary(), st.text())
def test_what_is_sealed_is_read_back(data: bytes, of: str) -> None:
    of = of.encode("utf-8", "replace").decode()
    assert unsealed(sealed(data, of), of) == data
    with pytest.raises(ValueError, match="damaged"):
        unsealed(sealed(data, of), of + "2")
    with pytest.raises(ValueError, match="damaged"):
        unsealed(data, of)


def test_a_kept_chunk_is_plain_parquet_to_others(tmp_path: Path) -> None:
    write_chunk(tmp_path, SEEDS, COLUMNS, figures())
    found = pd.read_parquet(tmp_path)  # the folder
    assert found["seed"].tolist() == list(SEEDS)
    np.testing.assert_array_equal(found[list(COLUMNS)].to_numpy(), figures())


def test_a_file_under_anothers_name_is_not_used(tmp_path: Path) -> None:
    for folder in ("a-11111111", "b-22222222"):
        write_chunk(tmp_path / folder, SEEDS, COLUMNS, figures())
    chunk_file(tmp_path / "a-11111111", SEEDS).replace(chunk_file(tmp_path / "b-22222222", SEEDS))
    assert read_chunk(tmp_path / "b-22222222", SEEDS, COLUMNS) is None


# --- whole files whose figures cannot be ------------------------------------------------------------------------


def refused(caplog: pytest.LogCaptureFixture, found: Any) -> str:
    assert found is None
    (record,) = caplog.records
    return record.getMessage()


@pytest.mark.parametrize(
    ("name", "row", "value", "said"),
    [
        ("cause", 3, 99.0, "cause: is 99 of seed 3"),
        ("cause", 3, 0.5, "cause: is 0.5"),
        ("cause", 3, np.nan, "cause: is nan"),
        ("ticks", 2, -1.0, "ticks: is -1"),
        ("due_uwb", 2, 7.5, "due_uwb: is 7.5"),
        ("arrived_uwb", 2, np.inf, "arrived_uwb: is inf"),
        ("mse_x", 5, -1e-9, "mse_x: is -1e-09 of seed 5"),
        ("mse_y", 0, np.nan, "mse_y: is nan of seed 0"),  # it is not lost
        ("max_path_distance", 0, np.nan, "max_path_distance: is nan"),
    ],
)
def test_figures_that_no_flight_has_are_told(
    name: str, row: int, value: float, said: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    wrong = figures()
    wrong[row, COLUMNS.index(name)] = value
    write_chunk(tmp_path, SEEDS, COLUMNS, wrong)
    assert said in refused(caplog, read_chunk(tmp_path, SEEDS, COLUMNS))


def table(**changes: Any) -> pa.Table:
    columns = {"seed": list(SEEDS)} | dict(zip(COLUMNS, figures().T, strict=True)) | changes
    return pa.table({name: column for name, column in columns.items() if column is not None})


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"nees": None}, "must be seed, ticks"),
        ({"nees": ["3"] * 40}, "must be seed, ticks"),
        ({"nees": np.ones(40, dtype=np.float32)}, "must be seed, ticks"),
        ({"more": np.ones(40)}, "must be seed, ticks"),
        ({"seed": list(range(1, 41))}, "seed: must be 0 to 39"),
        ({}, "player: must be one of fastest, engine"),
    ],
)
def test_tables_that_are_no_chunk_are_told(
    changes: dict[str, Any], said: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    buffer, file = io.BytesIO(), chunk_file(tmp_path, SEEDS)
    pq.write_table(table(**changes), buffer)
    keep(file, buffer.getvalue(), in_folder(file))
    assert said in refused(caplog, read_chunk(tmp_path, SEEDS, COLUMNS))


@pytest.mark.parametrize(
    ("kind", "text", "said"),
    [
        (Climb, '{"probability": 7.0, "kept": [], "accepted": [], "flights": 1, "met": 0}', "probability: "),
        (Climb, '{"probability": NaN, "kept": [], "accepted": [], "flights": 1, "met": 0}', "probability: "),
        (Climb, '{"probability": 0.5, "kept": [1.5], "accepted": [], "flights": 1, "met": 0}', "kept.0: "),
        (Climb, '{"probability": 0.5, "kept": [0.5], "accepted": [null], "flights": 1, "met": 0}', "accepted.0: "),
        (Climb, '{"probability": 0.5, "kept": [0.5], "accepted": [], "flights": -1, "met": 0}', "flights: "),
        (Climb, '{"probability": 0.5, "kept": [0.5], "accepted": [], "flights": 1.5, "met": 0}', "flights: "),
        (Climb, '{"probability": "0.5", "kept": [], "accepted": [], "flights": 1, "met": 0}', "probability: "),
        (Climb, '{"kept": [], "accepted": [], "flights": 1, "met": 0}', "probability: Field required"),
        (Plan, '{"levels": [Infinity], "steps": [[0.5, 0.5]], "flights": 1, "met": 0, "reached": true}', "levels.0: "),
        (Plan, '{"levels": [1.0], "steps": [[0.5, 0.5]], "flights": 1, "met": true, "reached": true}', "met: "),
        (Annotated[int, Field(ge=0, le=500)], "501", "less than or equal to 500"),
        (Annotated[int, Field(ge=0, le=500)], "-1", "greater than or equal to 0"),
        (list[Course], '[{"seed": 1, "lost": -1.0, "square": [], "nees": []}]', "0.lost: "),
        (list[Course], '[{"seed": 1, "lost": null, "square": [-0.5], "nees": []}]', "0.square.0: "),
        (list[Outcome], '[{"seed": -1, "lost": true, "mse": {}, "nees": 3.0}]', "0.seed: "),
        (list[Outcome], '[{"seed": 1, "lost": false, "mse": {"x": -0.5}, "nees": 3.0}]', "0.mse.x: "),
        (list[Outcome], '[{"seed": 1, "lost": 2, "mse": {}, "nees": 3.0}]', "0.lost: "),
        (Summary, summary_text(SUMMARY).replace("tumbled", "melted"), "lost.cause: "),
        (Summary, summary_text(SUMMARY).replace('"time": 1.25', '"time": NaN'), "lost.time: "),
        (Summary, "[" * 5000, "recursion"),
        (Summary, '"\\ud800"', ""),
        (Summary, "", ""),
    ],
)
def test_records_that_cannot_be_are_told(
    kind: Any, text: str, said: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    keep(tmp_path / "1.json", text.encode(), "this")
    line = refused(caplog, kept_json(tmp_path / "1.json", kind, "this"))
    assert said in line
    assert "\n" not in line
    assert line.endswith(": flown again")


# --- the studies ------------------------------------------------------------------------------------------------


def flip(file: Path, share: float) -> None:
    data = bytearray(file.read_bytes())
    data[int(share * len(data))] ^= 4
    file.write_bytes(data)


@pytest.mark.parametrize("share", np.linspace(0.0, 0.999, 12).tolist())
def test_a_damaged_chunk_of_a_map_is_flown_again(
    share: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(map_flights, "fly_figures", lambda text, seeds, folder, player: figures(len(seeds)))
    sweep = validate(
        Sweep, {"scenario": "nominal_imu_uwb", "axes": {"uwb.link.loss": [0.0, 0.5]}, "flights": 40}, "sweep"
    )
    flown: list[int] = []
    before = map_csv(fly_map(sweep, "sweep", tmp_path, 1))
    one, _ = sorted(tmp_path.rglob("*.parquet"))
    whole = one.read_bytes()
    flip(one, share)
    monkeypatch.setattr(
        map_flights, "fly_figures", lambda text, seeds, folder, player: flown.append(len(seeds)) or figures(len(seeds))
    )
    assert map_csv(fly_map(sweep, "sweep", tmp_path, 1)) == before
    assert flown == [40]
    assert one.read_bytes() == whole
    assert len(caplog.records) == 1


@pytest.mark.parametrize("share", [0.02, 0.5, 0.99])
def test_a_damaged_piece_of_a_rare_event_is_flown_again(
    share: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    ran: list[str] = []

    def noted(name: str, result: Any) -> Callable[..., Any]:
        return lambda *_: ran.append(name) or result

    monkeypatch.setattr(rare_flights, "_engine_of", lambda text: SimpleNamespace(drawn={}, ticks=3, numbers=3))
    monkeypatch.setattr(rare_flights, "plan_climb", noted("plan", PLAN))
    monkeypatch.setattr(rare_flights, "climb_flights", noted("climb", CLIMB))
    monkeypatch.setattr(rare_flights, "count_flights", noted("count", 0))
    asked = (SCENARIO, rare_flights.Event(1.5), 1000, 2, tmp_path, 1, 600)
    before = rare_flights.rare_flights(*asked)
    assert ran == ["plan", "climb", "climb", "count", "count"]
    files = sorted(tmp_path.rglob("*.json"))
    assert len(files) == 5
    for file in files:
        ran.clear()
        caplog.clear()
        flip(file, share)
        assert rare_flights.rare_flights(*asked) == before
        assert ran == [next(n for n in ("count", "climb", "plan") if n in file.stem.replace("_repetition_", "_climb_"))]
        assert len(caplog.records) == 1


def test_a_damaged_file_of_courses_is_flown_again(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    flown: list[int] = []

    def fly(text: str, seeds: list[int], folder: str, player: str) -> list[Course]:
        flown.extend(seeds)
        return [Course(seed, None, [0.1 * seed], [3.0]) for seed in seeds]

    with caplog.at_level(logging.WARNING):
        before = fly_kept(Course, fly, [(SCENARIO, range(5))], tmp_path)
        assert fly_kept(Course, fly, [(SCENARIO, range(5))], tmp_path) == before
        assert (flown, caplog.records) == ([0, 1, 2, 3, 4], [])
        flip(kept_file(tmp_path, SCENARIO), 0.3)
        assert fly_kept(Course, fly, [(SCENARIO, range(5))], tmp_path) == before
    assert flown == [0, 1, 2, 3, 4] * 2
    assert len(caplog.records) == 1
