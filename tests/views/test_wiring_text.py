"""The wiring of every ready-made scenario as text: what is printed is the wiring's, whole, in the order of a tick."""

import re
from functools import cache
from pathlib import Path
from runpy import run_path

import pytest
from rich.cells import cell_len

import ortilo_drake
from ortilo_drake.loop.element import Box
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.scenario import load_scenario, scenario_names
from ortilo_drake.views.blocks import WORLD, blocks_of, signals_between
from ortilo_drake.views.wiring_text import kind_of, wiring_of, wiring_text

LATE = "command_link.delay=1", "commands.filter=acted", "commands.servo=predicted", "estimator.delay=replay"
CASES = {name: (name, ()) for name in scenario_names()} | {"late commands": ("imu_uwb_yolo", LATE)}
READ = re.compile(r"(\w+) = ([\w.]+) \((\d+)\)")
ROOT = Path(ortilo_drake.__file__).parents[1]


richest = pytest.mark.family("late commands")


@cache
def wired(case: str) -> Wiring:
    name, settings = CASES[case]
    return wiring_of(load_scenario(name, settings))


@pytest.fixture(params=CASES)
def wiring(request: pytest.FixtureRequest) -> Wiring:
    return wired(request.param)


def joined(text: str) -> list[list[str]]:
    """Depth 2's rows as their cells, broken ones put together again."""
    rows: list[list[str]] = []
    for line in text.splitlines():
        cells = [line[:4].strip(), line[4:32].strip(), line[32:39].strip(), line[39:].strip()]
        if cells[1]:
            rows.append(cells)
        else:
            rows[-1][3] += f" {cells[3]}"
    return rows


@pytest.mark.family
@pytest.mark.parametrize("depth", [1, 2, 3])
def test_every_line_fits_into_a_hundred_columns(wiring: Wiring, depth: int) -> None:
    lines = wiring_text(wiring, depth).splitlines()
    assert len(lines) > 5
    assert [line for line in lines if cell_len(line) > 100] == []


@richest
def test_a_tick_has_every_box_and_every_wire_with_its_size(wiring: Wiring) -> None:
    rows = [row for row in joined(wiring_text(wiring, 2)) if row[1] in wiring.boxes]
    assert {row[1] for row in rows} == set(wiring.boxes)
    read = {(row[1], port): (said, int(size)) for row in rows for port, said, size in READ.findall(row[3])}
    assert read.keys() == wiring.wires.keys()
    for reader, (said, size) in read.items():
        wire = wiring.wires[reader]
        assert (wire.box, wire.size) == (said.partition(".")[0], size)
        if "." in said:
            assert wiring.boxes[wire.box].parts[said.partition(".")[2]] == (wire.first, wire.size)


@richest
def test_a_box_comes_after_those_it_reads_and_steps_before_those_that_read_it(wiring: Wiring) -> None:
    said, stepped = set[str](), set[str]()
    computed = {name for name, box in wiring.boxes.items() if box.element.out is not None}
    owners = {name for name, box in wiring.boxes.items() if box.element.shows and box.element.step is not None}
    part = ""
    for _, name, _, reads in joined(wiring_text(wiring, 2)):
        if name not in wiring.boxes:
            part = name
            continue
        sources = {source.partition(".")[0] for _, source, _ in READ.findall(reads)}
        sources |= {held for source in sources for held in wiring.boxes[source].holds}
        if part == "in each tick says":
            assert sources & computed <= said
            said.add(name)
        if part == "then steps":
            assert said == computed
            assert (sources - {name}) & owners & stepped == set()
            stepped.add(name)
    assert owners <= stepped


@richest
def test_functions_stand_in_the_file_that_is_named(wiring: Wiring) -> None:
    named = re.findall(r"^  (?:out|step) +(\w+) in (\S+)$", wiring_text(wiring, 3), re.MULTILINE)
    assert len(named) == sum(len(box.element.functions) for box in wiring.boxes.values())
    for function, file in named:
        assert f"def {function}(" in (ROOT / file).read_text(encoding="utf-8"), file


@richest
def test_every_box_is_in_one_block_and_on_its_side(wiring: Wiring) -> None:
    blocks = blocks_of(wiring)
    assert sorted(name for block in blocks.values() for name in block.boxes) == sorted(wiring.boxes)
    for block in blocks.values():
        for name in block.boxes:
            for function in wiring.boxes[name].element.functions.values():
                onboard = ".onboard." in function.__module__
                shared = ".sensors." in function.__module__  # what altimeter and flow say and what is made of it
                assert shared or onboard == (block.column not in WORLD), name


@richest
def test_signals_between_blocks_are_wires_between_their_boxes(wiring: Wiring) -> None:
    blocks = blocks_of(wiring)
    home = {box: block.name for block in blocks.values() for box in block.boxes}
    wires = {(home[wire.box], home[reader]) for (reader, _), wire in wiring.wires.items()}
    wires |= {(home[held], home[holder]) for held, holder in wiring.holders.items()}
    assert signals_between(wiring, blocks).keys() == {(source, reader) for source, reader in wires if source != reader}


def test_the_papers_blocks_are_the_papers() -> None:
    wiring = wired("paper_imu_uwb")
    blocks = blocks_of(wiring)
    assert [*blocks] == ["planner", "servo", "vehicle", "uwb", "imu", "uwb fix", "handler", "filter"]
    assert set(blocks["servo"].boxes) >= {"servo", "true_velocity"}
    signals = signals_between(wiring, blocks)
    assert signals["handler", "filter"] == ["y", "Δ", "V₂"]
    assert signals["filter", "servo"] == ["x̂, P"]
    assert signals["servo", "vehicle"] == signals["servo", "filter"] == ["u"]
    assert signals["planner", "filter"] == ["r"]
    assert ("uwb", "handler") not in signals


@pytest.mark.usefixtures("own_register")
def test_parts_of_ones_own_are_in_the_blocks_of_those_that_they_replace() -> None:
    for example in ("kalman_filter", "cascade_servo"):
        run_path(str(ROOT / "examples" / f"{example}.py"))
    own = {"estimator": {"kind": "own_kalman"}, "servo": {"kind": "cascade"}, "camera.kind": "projected"}
    blocks = blocks_of(wiring_of(load_scenario("nominal_imu_uwb", own)))
    assert blocks["vehicle"].boxes == ("disturbance", "plant", "felt", "acceleration")
    assert "own_filter" in blocks["filter"].boxes
    assert "belief_parts" in blocks["filter"].boxes


def test_a_system_is_named_as_what_it_is() -> None:
    box: Box = wired("paper_imu_uwb").boxes["servo"]
    assert kind_of(box) == "element servo"
    object.__setattr__(box := Box(box.name, box.element, box.size, box.given), "system", Wiring([]))
    assert kind_of(box) == "System Wiring of Drake, no element"
