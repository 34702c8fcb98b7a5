"""What crosses from the world to the onboard half: messages, and of the scenario the Belief alone."""

import ast
import gc
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

import numpy as np
import pytest
from numba import njit
from numba.core.dispatcher import Dispatcher
from pydantic import BaseModel
from pydrake.systems.framework import LeafSystem

import ortilo_drake
from ortilo_drake.diagrams.onboard import NO_PARTS, Parts, make_onboard
from ortilo_drake.flight.stepped_halves import OnboardHalf, WorldHalf
from ortilo_drake.hil.wire.handshake import scenario_digest
from ortilo_drake.scenario import Belief, Link, Scenario, Truth, load_scenario
from ortilo_drake.scenario.truth import SensorTruth

PACKAGE = Path(ortilo_drake.__file__).parent
SHORT = "planner={kind: waypoints, points: [[0, 0, 1.5], [1.2, 0.6, 1.5]]}"
BASE = ("sensors=[uwb, camera, imu, altimeter, flow]", "camera.kind=projected", SHORT)
# All that only the world draws by, beside its truth.
WORLDS = (
    "world={kinematics: rigid_body, disturbance: {force_density: 0.0913}}",
    "imu={angle_density: 0.00548, rate_density: 0.00365, specific_force_density: 0.0365}",
    "imu.link={loss: 0.1, delay: 2}",
    "uwb={noise: {kind: constant, sd: 0.2}, max_distance: 50}",
    "camera.errors={kind: parametric}",
    "altimeter.link={loss: 0.1, delay: 1}",
    "command_link={loss: 0.01, delay: 1}",
    "failsafe.timeout=0.7",
    "settle=5.0",
)


def numbers(model: type[BaseModel], above: str) -> list[tuple[str, Any]]:
    """Return every key of a model of groups, and another value for it than the default."""
    found: list[tuple[str, Any]] = []
    for name, field in model.model_fields.items():
        key, default = f"{above}.{name}", field.get_default()
        if isinstance(default, BaseModel):
            found += numbers(type(default), key)
        elif isinstance(default, float):
            found.append((key, 1.5 if default == 2.0 else default + 5e-4))
        elif default:
            found.append((key, [0.01 * (i + 1) for i in range(len(default))]))
    return found


EVERY_TRUTH = (
    *numbers(Truth, "truth"),
    ("truth.sensors.altimeter", {"bias": [0.1], "bias_sd": [0.01], "factor": [1.01], "slow_sd": [0.05]}),
    ("truth.sensors.flow", {"factor_sd": [0.02, 0.02, 0.0, 0.0, 0.0], "slow_time": 3.0}),
)


def scenarios() -> tuple[Scenario, Scenario]:
    """Return two scenarios that differ in every truth, in the seed, and in all that only the world draws by."""
    return load_scenario("flow", BASE), load_scenario("flow", (*BASE, *WORLDS, *EVERY_TRUTH), seed=99)


def leaves(data: Any, name: str = "") -> dict[str, Any]:
    if not isinstance(data, dict):
        return {name: data}
    return {k: v for key, value in data.items() for k, v in leaves(value, f"{name}.{key}".lstrip(".")).items()}


def test_the_two_scenarios_differ_in_every_truth() -> None:
    one, other = (leaves(scenario.truth.model_dump(mode="json")) for scenario in scenarios())
    assert [key for key in one if one[key] == other[key]] == []
    assert {key for key in other if key.startswith("sensors.")} == {
        f"sensors.{sensor}.{name}" for sensor in ("altimeter", "flow") for name in SensorTruth.model_fields
    }


def test_another_world_leaves_the_belief_as_it_is() -> None:
    one, other = scenarios()
    assert one != other
    assert one.belief.model_dump_json() == other.belief.model_dump_json()
    assert one.belief == one.belief.belief
    assert not isinstance(one.belief, Scenario)
    assert scenario_digest(one) == scenario_digest(other)
    kept = one.belief.model_dump(mode="json")
    assert not kept.keys() & {"truth", "seed", "world", "command_link", "failsafe", "settle"}
    for sensor, more in (
        ("imu", {"standstill"}),
        ("uwb", {"kind", "pairs", "packets", "round", "behind_walls"}),
        ("camera", {"kind", "width", "latency", "calibration"}),
    ):
        assert kept[sensor].keys() == {"link", *more}
        assert kept[sensor]["link"].keys() == {"rate"}
    registered = load_scenario("flow", (*BASE, "altimeter.link={rate: 15.0, loss: 0.1, delay: 2}")).belief
    assert registered.settings_of("altimeter").link == Link(rate=15.0)
    # What the team itself decides is in it.
    for setting in (
        "estimator.delay=replay",
        "vehicle.mass=3.0",
        "uwb.link.rate=15",
        "imu.standstill=9",
        "altimeter.sd=0.1",
    ):
        assert load_scenario("flow", (*BASE, setting)).belief != one.belief


def parameters_of(half: OnboardHalf) -> list[Any]:
    """Return every number that an onboard half starts with, with the shape of its Diagram."""
    context = half.context
    groups = [
        context.get_numeric_parameter(i).CopyToVector().tolist() for i in range(context.num_numeric_parameter_groups())
    ]
    states = [context.get_discrete_state(i).CopyToVector().tolist() for i in range(context.num_discrete_state_groups())]
    return [half.diagram.GetGraphvizString().replace(hex(id(half)), ""), groups, states]


@pytest.mark.long
def test_another_world_leaves_the_onboard_half_and_its_answers_as_they_are() -> None:
    one, other = scenarios()
    halves = [OnboardHalf(scenario) for scenario in (one, other, one.belief)]
    first, *rest = (parameters_of(half)[1:] for half in halves)
    assert all(found == first for found in rest)
    world = WorldHalf(one)
    for _ in range(20):
        messages = world.sample()
        answers = []
        for half in halves:
            half.receive(messages)
            answers.append({name: value.tobytes() for name, value in half.outputs().items()})
            half.advance()
        assert answers[0] == answers[1] == answers[2]
        world.advance(np.frombuffer(answers[0]["control"]))


def reached(root: Any) -> list[Any]:
    """Return every Python object that can be reached from one, but through modules, classes and functions' globals.

    A compiled function counts as the function that it was compiled from: through its compiler all others of the
    process can be reached, with the frames and the errors that any of them keeps.
    """
    found: dict[int, Any] = {}
    pending = [root]
    while pending:
        thing = pending.pop()
        if id(thing) in found or isinstance(thing, type | ModuleType):
            continue
        found[id(thing)] = thing
        if isinstance(thing, Dispatcher):
            pending.append(thing.py_func)
        elif isinstance(thing, FunctionType):
            cells = [cell.cell_contents for cell in thing.__closure__ or ()]
            pending += [*cells, thing.__defaults__, thing.__kwdefaults__]
        else:
            pending += gc.get_referents(thing)
    return list(found.values())


def test_what_a_compiler_keeps_is_not_searched() -> None:
    compiled = njit(lambda x: x)
    compiled.kept = load_scenario("nominal_imu_uwb")  # as numba keeps the frames of a compilation that failed
    assert not [thing for thing in reached([compiled]) if isinstance(thing, Belief)]
    assert compiled.py_func in reached([compiled])


def systems_in(diagram: Any) -> list[Any]:
    """Return a Diagram's systems, and theirs."""
    inner = list(getattr(diagram, "GetSystems", list)())
    return [diagram, *(found for system in inner for found in systems_in(system))]


class Curious(LeafSystem):
    """A servo that keeps what it is given to be made of, in a closure."""

    def __init__(self, scenario: Belief):
        super().__init__()
        self.told = lambda: scenario
        self.DeclareVectorInputPort("estimate", 15)
        self.DeclareVectorInputPort("reference", 9)
        self.DeclareVectorOutputPort("control", 4, lambda context, output: None)


@pytest.mark.family
@pytest.mark.parametrize("name", ["nominal_imu_uwb", "nominal_imu_uwb_yolo", "flow"])
def test_no_scenario_can_be_reached_from_the_onboard_half(name: str) -> None:
    scenario = load_scenario(name, ("truth.imu.yaw=0.1", "camera.kind=projected", SHORT))
    for parts, is_told in ((NO_PARTS, False), (Parts(servo=Curious), True)):
        systems = systems_in(make_onboard(scenario, parts=parts))
        things = [thing for system in systems for thing in reached(vars(system))]
        assert any(isinstance(thing, Belief) for thing in things) == is_told
        assert any(isinstance(thing, np.ndarray) for thing in things)
        assert not [thing for thing in things if isinstance(thing, Scenario | Truth)]


def imported(file: Path) -> set[str]:
    """Return the modules and names that a file imports, dotted."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def test_what_is_built_onboard_imports_nothing_of_the_world() -> None:
    files = [
        *(PACKAGE / "onboard").rglob("*.py"),
        *((PACKAGE / "diagrams") / f"{n}.py" for n in ("onboard", "estimator")),
    ]
    assert len(files) > 30
    forbidden = (
        "ortilo_drake.world",
        "ortilo_drake.diagrams.world",
        "ortilo_drake.scenario.truth",
        "ortilo_drake.scenario.world",
        "ortilo_drake.scenario.Scenario",
        "ortilo_drake.scenario.scenario",
        "ortilo_drake.scenario.Truth",
        "ortilo_drake.scenario.World",
    )
    for file in files:
        wrong = {name for name in imported(file) if any(name == f or name.startswith(f"{f}.") for f in forbidden)}
        assert not wrong, file
