"""Spoilt scenarios, rooms and calibrations: each flies, or is refused in one line that names file and field.

ORTILO_FUZZ_CASES says how many; `make fuzz` takes 20,000. A case is a function of its number alone.
"""

import os
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from schema_mutations import Where, as_settings, as_yaml, places, spoil

from ortilo_drake.diagrams.closed_loop import make_closed_loop
from ortilo_drake.flight.flight import make_simulator
from ortilo_drake.flight.flyable import check_flyable
from ortilo_drake.model.input_error import LONGEST, InputError
from ortilo_drake.model.parts import known_sensors
from ortilo_drake.model.room import ORTILO_ROOM, Room
from ortilo_drake.model.typed_yaml import parse_yaml
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.world.sensors.camera_calibration import CALIBRATION, CameraCalibration

CASES = int(os.environ.get("ORTILO_FUZZ_CASES", "2000"))
BLOCK, FEW = 100, 1  # cases of a test, and how many such tests are not long
BLOCKS = max(1, CASES // BLOCK)
FLOWN = 8  # of so many accepted cases one is flown
TICKS = 12  # that far
MODELS = (Scenario, Room, CameraCalibration)
ROOMS_WAY = {"start": [0.0, 0.0], "goal": [21.0, -3.2]}  # of the fields of a room, those that the file leaves out
FIELDS = {field for model in MODELS for field in model.model_fields}
NO_FIELD = ("line ", "not valid YAML", "the file", "must hold settings")

FLIGHTS = (
    ("nominal_imu_uwb_yolo", "planner={kind: hover, point: [8, 1, 1.5], duration: 0.5}"),
    ("rotors", "planner={kind: waypoints, points: [[0, 0, 1.5], [0.4, 0.2, 1.5]]}"),
    ("uwb_walls", "planner={kind: hover, point: [8, 1, 1.5], duration: 0.5}"),
    ("bursty_link", "planner={kind: waypoints, points: [[0, 0, 1.5], [0.4, 0.2, 1.5]]}"),
    ("paper_imu_uwb_yolo", "planner={kind: gcs, goal: [0.5, 0.1]}"),
    ("outage", "estimator.delay=replay"),
    ("realistic_flow", "planner={kind: hover, point: [8, 1, 1.5], duration: 0.5}"),
)


@cache
def flights() -> list[Any]:
    """Return the ready-made scenarios in full, with boxes for pictures."""
    return [load_scenario(name, (change, "camera.kind=projected")).model_dump(mode="json") for name, change in FLIGHTS]


@cache
def data_of(path: Path) -> Any:
    return parse_yaml(path.read_text(encoding="utf-8"), path.name)


def plain(data: Any) -> str:
    return yaml.dump(data, Dumper=getattr(yaml, "CSafeDumper", yaml.SafeDumper))


def make_case(number: int, folder: Path) -> tuple[Path, tuple[str, ...], list[Where]]:
    """Return a scenario file, settings to lay over it, and which places of what it reads are spoilt."""
    rng = np.random.default_rng([12, number])
    scenario, kind = flights()[rng.integers(len(FLIGHTS))], rng.random()
    settings: tuple[str, ...] = ()
    if kind < 0.7:
        data, spoilt = spoil(scenario, Scenario, rng)
        if kind < 0.2 and isinstance(data, dict):
            settings = tuple(as_settings(spoilt, data))
        text = plain(scenario) if settings else as_yaml(data, rng)
    else:
        model, file, key = (Room, ORTILO_ROOM, "room") if kind < 0.9 else (CameraCalibration, CALIBRATION, "file")
        data, spoilt = spoil(data_of(file) | (ROOMS_WAY if key == "room" else {}), model, rng)
        (folder / "part.yaml").write_text(as_yaml(data, rng), encoding="utf-8", errors="surrogatepass")
        named = {"kind": "measured", "file": "part.yaml"}
        text = plain(scenario | ({"room": "part.yaml"} if key == "room" else {"camera": {"errors": named}}))
    (folder / "case.yaml").write_text(text, encoding="utf-8", errors="surrogatepass")
    return folder / "case.yaml", settings, spoilt


def check_line(line: str, folder: Path, spoilt: list[Where]) -> None:
    """Assert that a refusal is one printable line that names where it comes from, and the field."""
    assert line.isprintable()
    assert len(line) <= LONGEST
    rest = line
    for source in (f"{folder}/case.yaml: ", f"{folder}/part.yaml: ", "--set "):
        rest = rest.removeprefix(source)
    field = rest.partition(":")[0].partition(".")[0].partition(" ")[0]
    given = {str(part) for way in spoilt for part in way}
    whole = (
        rest.startswith(NO_FIELD)
        or "cannot be read: " in rest
        or ": unknown key (" in rest
        or (rest != line and line.startswith("--set "))
    )
    assert whole or field in FIELDS | given or " ... " in line, line


def run_case(number: int, folder: Path) -> str:
    """Return what became of a case: 'refused', 'accepted' or 'flown'."""
    file, settings, spoilt = make_case(number, folder)
    try:
        scenario = load_scenario(file, settings)
        check_flyable(scenario)
    except InputError as error:
        check_line(str(error), folder, spoilt)
        return "refused"
    if number % FLOWN or scenario.is_rendered:
        return "accepted"
    # What passed is not refused now: an InputError here fails the test.
    make_simulator(make_closed_loop(scenario), scenario).AdvanceTo((TICKS + 0.5) * scenario.h)
    return "flown"


@pytest.mark.long
@pytest.mark.parametrize("block", [pytest.param(k, marks=[pytest.mark.long] * (k >= FEW)) for k in range(BLOCKS)])
def test_a_spoilt_file_flies_or_is_refused_in_one_line(block: int, tmp_path: Path) -> None:
    became: dict[str, int] = {}
    for number in range(block * BLOCK, (block + 1) * BLOCK):
        try:
            outcome = run_case(number, tmp_path)
        except BaseException as error:
            error.add_note(f"case {number}: {', '.join(map(str, make_case(number, tmp_path)[1:]))}")
            raise
        became[outcome] = became.get(outcome, 0) + 1
    assert became["refused"] > BLOCK / 4
    assert BLOCK - became["refused"] > BLOCK / 20


@pytest.mark.long
def test_every_place_of_the_schema_is_spoilt_in_some_case(tmp_path: Path) -> None:
    root = Scenario.model_json_schema()
    there = {place.path[0] for data in flights() for place in places(root, data, root) if place.path}
    assert there - set(known_sensors()) == set(Scenario.model_fields) - set(known_sensors())
    missing = {*Scenario.model_fields, *Room.model_fields}
    for number in range(1000):
        missing -= {way[0] for way in make_case(number, tmp_path)[2]}
        if not missing:
            break
    assert missing == set()
