"""Every element of every ready-made scenario as a Drake system of its own: what Drake asks of a system.

It clones, keeps in its Context all that evolves, depends within a tick on what its functions read and on nothing else,
and on AutoDiffXd gives the values of floats. Each is tried on what it reads and keeps in ticks of a flight.
"""

from functools import lru_cache
from typing import Any, Final, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.autodiffutils import AutoDiffXd, ExtractValue
from pydrake.symbolic import Variable
from pydrake.systems.framework import Diagram, DiagramBuilder

from ortilo_drake.diagrams.single_parts import make_lq_servo
from ortilo_drake.diagrams.wiring.whole import boxes_of
from ortilo_drake.diagrams.wiring.world import world_boxes
from ortilo_drake.loop.diagram import Added, add_wiring, system_of
from ortilo_drake.loop.element import OUTSIDE, Box, Values, outside
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.model.signals import N_U, N_X
from ortilo_drake.model.vehicle import M100
from ortilo_drake.scenario import Scenario, load_scenario, scenario_names
from ortilo_drake.world.vehicle.quadrotor import plant_box

H, SEED = 1.0 / 30.0, 5
TICKS = (0, 3, 6, 7)  # the first, others in which all sensors send, and one in which they do not

# Elements whose plain source does not run on AutoDiffXd, and why; one's own by the names of their boxes.
FLOATS_ALONE: Final = {
    "projected_camera": "writes its boxes to arrays of floats",
    "fix_of_boxes": "chooses and solves on arrays of floats",
    "fix_of_cosines": "chooses and solves on arrays of floats",
    "learning_fix_of_boxes": "chooses and solves on arrays of floats",
    "belief_at_stamp": "looks its belief up by the tick of a stamp, a whole number",
    "replay_filter": "puts a message into the tick of its stamp, a whole number",
    "told_replay_filter": "likewise",
    "tight_handler": "asks np.isfinite, which knows floats alone",
    "tight": "asks np.isfinite, which knows floats alone",
    "own_fix flow_fix": "writes its fix to an array of floats",
}
# Elements whose values on AutoDiffXd are off by so much: an iteration takes one step more, its last one.
ITERATES: Final = dict.fromkeys(
    (
        "multilateration",
        "learning_multilateration",
        "tested_multilateration",
        "scaled_multilateration",
    ),
    1e-8,
)


class Moment(NamedTuple):
    """What a system reads and keeps in a tick of a flight."""

    k: int
    inputs: list[np.ndarray]
    state: np.ndarray


class Flight(NamedTuple):
    """The elements of a scenario, a system each, and moments of a flight of each, by the names of their boxes."""

    wiring: Wiring
    systems: dict[str, Any]
    moments: dict[str, list[Moment]]


@lru_cache
def scenario_of(name: str) -> Scenario:
    return load_scenario(name, ("camera.kind=projected",))


def built(wiring: Wiring, fused: bool = False) -> tuple[Diagram, Added]:
    """Return a Diagram that shows all that is said, each box's by its name."""
    builder = DiagramBuilder()
    added = add_wiring(
        builder,
        wiring,
        {name: name for name, box in wiring.boxes.items() if box.element is not OUTSIDE},
        H,
        fused=fused,
    )
    for name, port in added.outputs.items():
        builder.ExportOutput(port, name)
    return builder.Build(), added


@lru_cache
def flight_of(name: str) -> Flight:
    wiring = Wiring(boxes_of(scenario_of(name), TICKS[-1] + 1))
    diagram, added = built(wiring)
    moments, context = {box: list[Moment]() for box in added.systems}, diagram.CreateDefaultContext()
    added.set_seed(context, SEED)
    for k in range(TICKS[-1] + 1):
        context.SetTime(k * H)
        for box, system in added.systems.items() if k in TICKS else ():
            its = system.GetMyContextFromRoot(context)
            inputs = [port.Eval(its).copy() for port in inputs_of(system)]
            moments[box].append(Moment(k, inputs, state_in(its)))
        advance(diagram, context)
    return Flight(wiring, {name: system for name, system in added.systems.items() if hasattr(system, "boxes")}, moments)


def kind_of(box: Box) -> str:
    """Return the name of a box's element; of one's own parts with that of the box."""
    name = box.element.name
    return f"{name} {box.name}" if name.startswith("own") else name


def advance(diagram: Diagram, context: Any) -> None:
    """Take the states of a Diagram to the next tick."""
    context.get_mutable_discrete_state().SetFrom(diagram.EvalUniquePeriodicDiscreteUpdate(context))


def state_in(context: Any) -> Any:
    kept = context.num_discrete_state_groups()
    return context.get_discrete_state_vector().CopyToVector() if kept else np.zeros(0)


def put(system: Any, context: Any, moment: Moment, T: type = float) -> None:
    """Put a system into a moment; of another scalar than floats along with a derivative."""

    def of_scalar(values: np.ndarray) -> Any:
        return values if T is float else np.array([AutoDiffXd(float(value), np.array([1.0])) for value in values])

    context.SetTime(moment.k * H)
    for i, values in enumerate(moment.inputs):
        system.get_input_port(i).FixValue(context, of_scalar(values))
    if moment.state.size:
        context.SetDiscreteState(of_scalar(moment.state))


def inputs_of(system: Any) -> list[Any]:
    """Return the input ports but for that of chance, the last one, which need not be connected."""
    ports = [system.get_input_port(i) for i in range(system.num_input_ports())]
    return [port for port in ports if port.get_name() != "chance"]


def ports_of(system: Any) -> list[Any]:
    """Return the output ports but for those of what is computed in between."""
    ports = [system.get_output_port(i) for i in range(system.num_output_ports())]
    return [
        port for port in ports if not port.get_name().removeprefix("wrapped_").startswith("said_")
    ]  # a clone's are wrapped


def said(system: Any, context: Any) -> np.ndarray:
    """Return what all output ports say, one after the other."""
    return np.concatenate([*(port.Eval(context) for port in ports_of(system)), np.zeros(0)])


def stepped(system: Any, context: Any) -> np.ndarray:
    """Return the state of the next tick; of what keeps none nothing."""
    if system.GetUniquePeriodicDiscreteUpdateAttribute() is None:
        return np.zeros(0)
    return np.array(system.EvalUniquePeriodicDiscreteUpdate(context).value())


@pytest.fixture(params=scenario_names())
def flight(request: pytest.FixtureRequest) -> Flight:
    return flight_of(request.param)


def context_of(system: Any, seed: int) -> Any:
    context = system.CreateDefaultContext()
    system.set_seed_in(context, seed)
    return context


@pytest.mark.family("nominal_imu_uwb_yolo")
def test_a_clone_says_and_does_the_same(flight: Flight) -> None:
    for name, system in flight.systems.items():
        other = system.Clone()
        contexts = context_of(system, SEED), other.CreateDefaultContext()
        contexts[1].SetTimeStateAndParametersFrom(contexts[0])  # with the seed
        for moment in flight.moments[name]:
            found = []
            for one, context in zip((system, other), contexts, strict=True):
                put(one, context, moment)
                found.append([said(one, context), stepped(one, context)])
            for mine, its in zip(*found, strict=True):
                np.testing.assert_array_equal(mine, its, err_msg=name)


@pytest.mark.family("nominal_imu_uwb_yolo")
def test_two_contexts_do_not_disturb_each_other(flight: Flight) -> None:
    """Each goes its way from the state of a moment, under its seed and its inputs."""
    for name, system in flight.systems.items():

        def way(i: int, name: str = name, system: Any = system) -> Any:
            context, moments = context_of(system, SEED + i), flight.moments[name]
            put(system, context, moments[i])
            for moment in moments[i:] + moments[:i]:
                state = moment._replace(state=state_in(context))
                put(system, context, state)
                yield said(system, context)
                after = stepped(system, context)
                if after.size:
                    context.SetDiscreteState(after)
                yield after

        alone = [list(way(0)), list(way(1))]
        for pair in zip(*alone, zip(way(0), way(1), strict=True), strict=True):
            np.testing.assert_array_equal(pair[0], pair[2][0], err_msg=name)
            np.testing.assert_array_equal(pair[1], pair[2][1], err_msg=name)


@pytest.mark.family("nominal_imu_uwb_yolo")
def test_an_output_depends_within_a_tick_on_what_out_reads(flight: Flight) -> None:
    for name, system in flight.systems.items():
        element, wires = flight.wiring.boxes[name].element, flight.wiring.wires
        reads = set() if element.out is None else set(element.inputs_of(element.out))
        reads = {port for port in reads if wires[name, port].box != name}
        inputs = {i: port.get_name() for i, port in enumerate(inputs_of(system))}
        shown = {int(port.get_index()) for port in ports_of(system)}
        found = {(inputs[i], o) for i in inputs for o in shown if system.HasDirectFeedthrough(i, o)}
        assert found == {(port, o) for port in reads for o in shown}, name


@pytest.mark.family("nominal_imu_uwb_yolo")
def test_on_autodiff_it_says_the_values_of_floats(flight: Flight) -> None:
    for name, system in flight.systems.items():
        kind = kind_of(flight.wiring.boxes[name])
        if kind in FLOATS_ALONE:
            continue
        other, off = system.ToAutoDiffXd(), ITERATES.get(kind, 1e-13)
        contexts = context_of(system, SEED), context_of(other, SEED)
        for moment in flight.moments[name]:
            for one, context, T in zip((system, other), contexts, (float, AutoDiffXd), strict=True):
                put(one, context, moment, T)
            for what in (said, stepped):
                mine, its = what(system, contexts[0]), what(other, contexts[1])
                values = ExtractValue(its[:, None])[:, 0] if its.size else its
                np.testing.assert_allclose(values, mine, rtol=off, atol=off, err_msg=name)


@pytest.mark.long
def test_what_floats_alone_can_do_is_listed_no_longer_than_it_must_be() -> None:
    """Each element of the list is refused by Drake's scalar, so that the list does not outlive its reasons."""
    left = set(FLOATS_ALONE)
    for flight in map(flight_of, scenario_names()):
        for name, system in flight.systems.items():
            kind = kind_of(flight.wiring.boxes[name])
            if kind not in left:
                continue
            other = system.ToAutoDiffXd()
            context = context_of(other, SEED)
            try:
                for moment in flight.moments[name]:
                    put(other, context, moment, AutoDiffXd)
                    said(other, context), stepped(other, context)
            except (TypeError, AttributeError, ValueError, RuntimeError):
                left.discard(kind)
    assert not left


def evaluated(expressions: Any, variables: np.ndarray, values: np.ndarray) -> np.ndarray:
    environment = dict(zip(variables.ravel(), values.ravel(), strict=True))
    return np.array([expression.Evaluate(environment) for expression in np.ravel(expressions)])


def variables_of(name: str, size: int) -> np.ndarray:
    return np.array([Variable(f"{name}_{i}") for i in range(size)])


@pytest.mark.parametrize("kinematics", ["small_angle", "linear", "rigid_body"])
def test_the_plants_step_is_an_expression_whose_value_is_that_of_floats(kinematics: str) -> None:
    random = np.random.default_rng(1)
    x, u, d = random.uniform(-0.4, 0.4, N_X), np.array([27.0, 0.1, -0.2, 0.05]), random.uniform(-0.1, 0.1, 6)
    wiring = Wiring([plant_box(M100, kinematics, x, H), outside("control", N_U), outside("disturbance", 6)])
    system = system_of(wiring, H)
    symbols: Any = system.ToSymbolic()
    contexts = system.CreateDefaultContext(), symbols.CreateDefaultContext()
    names = {"x": x, "control": u, "disturbance": d}
    variables = {name: variables_of(name, len(values)) for name, values in names.items()}
    for one, context, given_ in ((system, contexts[0], names), (symbols, contexts[1], variables)):
        context.SetDiscreteState(given_["x"])
        for name in ("control", "disturbance"):
            one.GetInputPort(name).FixValue(context, given_[name])
    after = stepped(symbols, contexts[1])
    values = evaluated(after, np.concatenate([*variables.values()]), np.concatenate([*names.values()]))
    np.testing.assert_allclose(values, stepped(system, contexts[0]), rtol=1e-12, atol=1e-14)
    assert np.max(np.abs(values - x)) > 1e-3


def test_the_servos_control_is_an_expression_whose_value_is_that_of_floats() -> None:
    servo = make_lq_servo(scenario_of("nominal_imu_uwb"))
    symbols, random = servo.ToSymbolic(), np.random.default_rng(2)
    contexts, variables, values = (servo.CreateDefaultContext(), symbols.CreateDefaultContext()), [], []
    for i in range(servo.num_input_ports()):
        values.append(random.uniform(-0.3, 0.3, servo.get_input_port(i).size()))
        variables.append(variables_of(f"z{i}", len(values[-1])))
        servo.get_input_port(i).FixValue(contexts[0], values[-1])
        symbols.get_input_port(i).FixValue(contexts[1], variables[-1])
    control = symbols.GetOutputPort("control").Eval(contexts[1])
    found = evaluated(control, np.concatenate(variables), np.concatenate(values))
    np.testing.assert_allclose(found, servo.GetOutputPort("control").Eval(contexts[0]), rtol=1e-12, atol=1e-14)


def world_wiring(name: str) -> Wiring:
    """Return the world of a scenario; the control comes from outside."""
    scenario = scenario_of(name)
    boxes, _ = world_boxes(scenario, scenario.load_room(), np.array([8.0, 1.0, 1.5]), whole_imu=True)
    return Wiring([*boxes, outside("servo", N_U)])


@lru_cache
def grains(name: str) -> tuple[Wiring, list[tuple[Diagram, Added]]]:
    wiring = world_wiring(name)
    return wiring, [built(wiring), built(wiring, fused=True)]


WORLDS = ("nominal_imu_uwb_yolo", "realistic_flow", "rotors")


@pytest.mark.family
@pytest.mark.parametrize("name", WORLDS)
@given(seed=st.integers(0, 2**31), k=st.integers(0, 600))
@settings(max_examples=10, deadline=None)
def test_elements_in_one_system_say_and_do_what_a_system_each_does(name: str, seed: int, k: int) -> None:
    wiring, both = grains(name)
    random, found = np.random.default_rng(seed), []
    control = np.array([27.0, 0.0, 0.0, 0.0]) + random.uniform(-0.1, 0.1, N_U)
    states = {
        (box.name, state): start + random.uniform(-0.1, 0.1, np.shape(start)) for box in wiring.boxes.values()
        for state, start in box.given.start.items()
    }  # fmt: skip
    for diagram, added in both:
        context = diagram.CreateDefaultContext()
        added.set_seed(context, seed)
        context.SetTime(k * H)
        diagram.GetInputPort("servo").FixValue(context, control)
        for (box, state), values in states.items():
            added.give(context, {box: Values(start={state: values})})
        told = {port: diagram.GetOutputPort(port).Eval(context).copy() for port in added.outputs}
        advance(diagram, context)
        told |= {str(key): added.state_of(context, *key) for key in states}
        found.append(told)
    assert found[0].keys() == found[1].keys()
    for key, values in found[0].items():
        np.testing.assert_array_equal(values, found[1][key], err_msg=key)


@pytest.mark.family
@pytest.mark.parametrize("name", WORLDS)
def test_elements_in_one_system_depend_on_what_a_system_each_depends_on(name: str) -> None:
    """Drake finds by itself what the outputs of a Diagram depend on; one system has to say so."""
    _, both = grains(name)
    found = []
    for diagram, _added in both:
        outputs = range(diagram.num_output_ports())
        found.append({diagram.get_output_port(o).get_name() for o in outputs if diagram.HasDirectFeedthrough(0, o)})
    assert found[0] == found[1]
