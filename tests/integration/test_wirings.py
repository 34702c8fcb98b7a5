"""The wiring of every ready-made scenario is whole: all that is read is there, in the size that its reader takes."""

from functools import lru_cache

import numpy as np
import pytest

from ortilo_drake.diagrams.wiring.onboard import belief_in
from ortilo_drake.diagrams.wiring.whole import boxes_of, signals_of
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.model.signals import N_U, N_X, N_XBAR, REFERENCE_SIZE
from ortilo_drake.scenario import Scenario, load_scenario, scenario_names

TICKS = 3
KNOWN = N_XBAR + N_XBAR**2
REPLAYED = ("estimator.delay=replay", "uwb.link.delay=2")
ROBUST = "estimator.robust={}"
VARIANTS = [
    *((name, ()) for name in scenario_names()),
    ("nominal_imu_uwb", REPLAYED),
    ("nominal_imu_uwb", (ROBUST, "sensors=[imu]")),
    ("nominal_imu_uwb", ("sensors=[]",)),
    ("imu_uwb", (*REPLAYED, ROBUST)),
    (
        "realistic_flow",
        (*REPLAYED, ROBUST, "multilateration.exclude={clock: true}", "multilateration.noise_scale=null"),
    ),
]


richest = pytest.mark.family(" ".join((VARIANTS[-1][0], *VARIANTS[-1][1])))


@lru_cache
def flown(name: str, changes: tuple[str, ...]) -> Scenario:
    return load_scenario(name, ("camera.kind=projected", *changes))


@lru_cache
def wired(name: str, changes: tuple[str, ...]) -> Wiring:
    return Wiring(boxes_of(flown(name, changes), TICKS))


def size_of(wiring: Wiring, said: str) -> int:
    name, _, part = said.partition(".")
    box = wiring.boxes[name]
    return box.parts[part][1] if part else box.size


@pytest.fixture(params=VARIANTS, ids=lambda variant: " ".join((variant[0], *variant[1])))
def variant(request: pytest.FixtureRequest) -> tuple[str, tuple[str, ...]]:
    found: tuple[str, tuple[str, ...]] = request.param
    return found


@richest
def test_signals_have_the_sizes_of_a_flights_log(variant: tuple[str, tuple[str, ...]]) -> None:
    scenario, wiring = flown(*variant), wired(*variant)
    sizes = {signal: size_of(wiring, said) for signal, said in signals_of(list(wiring.boxes.values())).items()}
    known = {"state": N_X, "control": N_U, "reference": REFERENCE_SIZE, "belief": KNOWN}
    assert sizes == known | scenario.measurement.sizes


@richest
def test_parts_lie_within_what_their_box_says(variant: tuple[str, tuple[str, ...]]) -> None:
    for box in wired(*variant).boxes.values():
        for first, size in box.parts.values():
            assert 0 <= first <= first + size <= box.size


@richest
def test_a_tick_reads_nothing_before_it_is_said(variant: tuple[str, tuple[str, ...]]) -> None:
    """A box that computes what it says comes after those that do and that it reads; nobody reads a stepped state."""
    wiring = wired(*variant)
    said: set[str] = set()
    computing = {box.name for box in wiring.out_order}
    for box in wiring.out_order:
        read = {wiring.wires[box.name, port].box for port in box.element.inputs_of(box.element.functions["out"])}
        each = {held for name in read for held in wiring.boxes[name].holds or (name,)}
        assert each & computing <= said, box.name
        said.add(box.name)
    stepped: set[str] = set()
    for box in wiring.step_order:
        read = {wiring.wires[box.name, port].box for port in box.element.inputs_of(box.element.functions["step"])}
        assert not {name for name in read & stepped if wiring.boxes[name].element.shows}, box.name
        stepped.add(box.name)
    assert computing | stepped >= {name for name, box in wiring.boxes.items() if box.element.functions}


@richest
def test_the_filter_takes_what_the_handler_hands_over(variant: tuple[str, tuple[str, ...]]) -> None:
    """Values, arrivals and covariances by its own layout, and whatever is opened of its P."""
    wiring = wired(*variant)
    filters = wiring.boxes["filter"]
    if not filters.element.name.endswith("filter"):  # the tight one takes messages
        return
    first, block = filters.given.tables["layout_first"], filters.given.tables["layout_block"]
    sizes = {port: wiring.wires["filter", port].size for port in filters.element.inputs}
    assert (sizes["y"], sizes["delta"], sizes["V2"]) == (first[-1], len(first) - 1, block[-1])
    if "stamps" in sizes:
        assert sizes["stamps"] == sizes["delta"]
    n = sizes["opening"]
    assert size_of(wiring, "filter.belief" if filters.parts else "filter") == n + n**2
    assert (sizes["control"], sizes["reference"]) == (N_U, REFERENCE_SIZE)


@richest
def test_fixes_are_solved_about_a_belief_of_the_vehicle(variant: tuple[str, tuple[str, ...]]) -> None:
    wiring = wired(*variant)
    for name, box in wiring.boxes.items():
        if name.endswith("_fix") or name == "handler":
            sizes = {wiring.wires[name, port].size for port in box.element.inputs if port == "belief"}
            assert sizes <= {KNOWN}, name


@richest
def test_every_message_that_flies_reaches_the_handler_or_filter(variant: tuple[str, tuple[str, ...]]) -> None:
    scenario, wiring = flown(*variant), wired(*variant)
    if "messages" not in wiring.boxes:
        return
    handed, handler = wiring.boxes["messages"], wiring.boxes["handler"]
    begins = handler.given.tables["incoming_start"]
    flies = [name in scenario.sensors for name in scenario.measurement.sensors]
    np.testing.assert_array_equal(begins >= 0, flies)
    assert sorted(begins[begins >= 0].tolist()) == [first for first, _ in handed.parts.values()]


@pytest.mark.parametrize(
    ("name", "changes", "there", "belief"),
    [
        ("nominal_imu_uwb", (), {"uwb_fix", "no_opening", "no_force"}, "filter"),
        (
            "nominal_imu_uwb",
            REPLAYED,
            {"uwb_fix", "uwb_belief_at_stamp", "beliefs_at_stamp", "no_opening", "no_force"},
            "filter.belief",
        ),
        ("imu_uwb", (), {"uwb_fix", "imu_rows", "vehicle_belief", "no_opening"}, "vehicle_belief.belief"),
        (
            "imu_uwb",
            ("estimator.robust={stuck: null}",),
            {"uwb_fix", "imu_rows", "vehicle_belief", "robust_gate"},
            "vehicle_belief.belief",
        ),
        (
            "imu_uwb",
            (*REPLAYED, ROBUST),
            {
                "uwb_stuck_gate",
                "imu_stuck_gate",
                "uwb_belief_at_stamp",
                "beliefs_at_stamp",
                "uwb_vehicle_at_stamp",
                "uwb_fix",
                "robust_gate",
                "imu_rows",
                "vehicle_belief",
            },
            "vehicle_belief.belief",
        ),
    ],
)
def test_there_is_what_a_scenario_asks_for(name: str, changes: tuple[str, ...], there: set[str], belief: str) -> None:
    boxes = wired(name, changes).boxes
    optional = {"no_opening", "no_force", "vehicle_belief", "imu_rows", "robust_gate", "beliefs_at_stamp"}
    optional |= {
        f"{sensor}_{what}"
        for sensor in ("uwb", "imu")
        for what in ("stuck_gate", "belief_at_stamp", "vehicle_at_stamp", "fix")
    }
    assert optional & set(boxes) == there
    assert belief_in(list(boxes.values())) == belief
