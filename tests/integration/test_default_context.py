"""A closed loop as Drake's own tools take it: its default Context flies, its random ones have noise of their own."""

import numpy as np
import pytest
from pydrake.common import RandomGenerator
from pydrake.systems.analysis import MonteCarloSimulation, Simulator
from pydrake.systems.framework import Context, System

from ortilo_drake.diagrams.closed_loop import make_closed_loop
from ortilo_drake.diagrams.world import make_world
from ortilo_drake.flight.flight import make_simulator
from ortilo_drake.scenario import load_scenario

HOVER = "planner={kind: hover, point: [3.0, 1.0, 1.5], duration: 3.0}"
SHORT = ("nominal_imu_uwb", (HOVER,))


@pytest.mark.family
@pytest.mark.parametrize("fused", [False, True])
@pytest.mark.parametrize(
    ("name", "settings"), [SHORT, ("imu_uwb", (HOVER,)), ("nominal_imu_uwb", (HOVER, "world.plant=continuous"))]
)
def test_a_default_context_hovers_at_the_start_truth_and_belief_together(
    name: str, settings: tuple[str, ...], fused: bool
) -> None:
    loop = make_closed_loop(load_scenario(name, settings), fused=fused)
    simulator = Simulator(loop)
    context = simulator.get_context()
    r_0 = [3.0, 1.0, 1.5]
    for port in ("state", "estimate"):
        np.testing.assert_array_equal(loop.GetOutputPort(port).Eval(context)[:3], r_0)
        np.testing.assert_array_equal(loop.GetOutputPort(port).Eval(context)[3:12], np.zeros(9))
    simulator.AdvanceTo(2.0)
    positions = loop.FindLog(context).data()[:3].T
    assert len(positions) == 61
    assert np.abs(positions - r_0).max() < 0.3
    assert np.abs(loop.GetOutputPort("estimate").Eval(context)[:3] - r_0).max() < 0.3


def test_a_default_context_is_that_of_the_flight() -> None:
    scenario = load_scenario(*SHORT)
    flown = make_simulator(make_closed_loop(scenario), scenario)
    own = Simulator(make_closed_loop(scenario))
    logs = []
    for simulator in (flown, own):
        simulator.AdvanceTo(0.5)
        logs.append(simulator.get_system().FindLog(simulator.get_context()).data().tobytes())
    assert logs[0] == logs[1]


def test_all_that_draws_has_the_scenario_s_seed_where_drake_integrates_the_vehicle() -> None:
    link = "command_link.loss={kind: bernoulli, probability: 0.3}"
    world = make_world(load_scenario("flow", ("seed=3", "altimeter.link.rate=60", link)))
    context = world.CreateDefaultContext()
    drawing = {system.get_name(): system for system in world.GetSystems() if hasattr(system, "seed_in")}
    assert {"command_link", "altimeter", "altimeter_link"} <= drawing.keys()
    assert {name: its.seed_in(its.GetMyContextFromRoot(context)) for name, its in drawing.items()} == dict.fromkeys(
        drawing, 3
    )


def test_monte_carlo_simulation_draws_the_noise_and_one_generator_the_same() -> None:
    scenario = load_scenario(*SHORT)

    def make(generator: RandomGenerator) -> Simulator:
        return Simulator(make_closed_loop(scenario, fused=True))

    def x_of(system: System, context: Context) -> float:
        return float(system.GetOutputPort("state").Eval(context)[0])

    def samples(seed: int) -> list[float]:
        found = MonteCarloSimulation(
            make_simulator=make, output=x_of, final_time=0.5, num_samples=4, generator=RandomGenerator(seed)
        )
        return [result.output for result in found]

    first, again, others = samples(1), samples(1), samples(2)
    assert first == again
    assert len({*first, *others}) == 8
