"""The seed in the Context: one world gives the noise of any seed, and two contexts do not disturb each other."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.systems.framework import Context, Diagram

from ortilo_drake.diagrams.world import make_world
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.world.seeded_system import Seeded, set_seed

# Every source of noise: loss in bursts, delays drawn, lost commands, rotors pushed by gusts.
BURSTS = "{kind: gilbert_elliott, good_to_bad: 0.3, bad_to_good: 0.4}"
SETTINGS = (
    "camera.kind=projected",
    f"uwb.link={{rate: null, random_delay: 2, loss: {BURSTS}}}",
    f"camera.link={{rate: null, loss: {BURSTS}}}",
    "imu.link.loss={kind: bernoulli, probability: 0.5}",
    "command_link={loss: {kind: bernoulli, probability: 0.5}, when_lost: zero}",
)
SEEDS = st.integers(min_value=0, max_value=2**63 - 1)


def scenario(seed: int = 0) -> Scenario:
    return load_scenario("nominal_imu_uwb_yolo", SETTINGS, seed)


def sources(world: Diagram) -> list[Seeded]:
    return [system for system in world.GetSystems() if isinstance(system, Seeded)]


def prepared(world: Diagram) -> Context:
    """Return a context in which the vehicle stands still amid the room and is told to hover."""
    context = world.CreateDefaultContext()
    world.GetInputPort("control").FixValue(context, [2.7 * 9.81, 0.0, 0.0, 0.0])
    plant = world.GetSubsystemByName("quadrotor")
    plant.SetState(plant.GetMyMutableContextFromRoot(context), [8.0, 1.0, 1.5, *[0.02] * 9])
    return context


def noise(world: Diagram, context: Context, ticks: int = 12) -> list[np.ndarray]:
    """Return what every source says at each tick, and the discrete state that it comes to."""
    found = []
    for k in range(ticks):
        context.SetTime(k / 30.0)
        for system in sources(world):
            found.append(system.get_output_port().Eval(system.GetMyContextFromRoot(context)).copy())
        updated = world.EvalUniquePeriodicDiscreteUpdate(context)
        context.get_mutable_discrete_state().SetFrom(updated)
        found += [updated.value(i).copy() for i in range(updated.num_groups())]
    return found


def assert_same(one: list[np.ndarray], other: list[np.ndarray]) -> None:
    assert [a.tobytes() for a in one] == [a.tobytes() for a in other]


@given(built=SEEDS, flown=SEEDS)
@settings(max_examples=10)
def test_a_world_with_a_seed_set_is_the_world_built_with_it(built: int, flown: int) -> None:
    reused, fresh = (make_world(scenario(seed)) for seed in (built, flown))
    context = prepared(reused)
    set_seed(reused, context, flown)
    assert_same(noise(reused, context), noise(fresh, prepared(fresh)))


def test_every_source_of_noise_has_the_seed_and_none_shares_it_with_another_context() -> None:
    world = make_world(scenario(5))
    assert {system.get_name() for system in sources(world)} == {
        "disturbance", "command_link", "uwb", "uwb_link", "projected_camera", "camera_link", "imu", "imu_link"
    }  # fmt: skip
    one, other, untouched = prepared(world), prepared(world), prepared(world)
    set_seed(world, one, 2**62 + 1)
    set_seed(world, other, 2**62)  # the same number as a float
    found = [noise(world, context) for context in (one, other, untouched)]
    assert_same(found[2], noise(world, prepared(world)))
    for a, b in ((0, 1), (0, 2), (1, 2)):
        assert [x.tobytes() for x in found[a]] != [x.tobytes() for x in found[b]]


@pytest.mark.parametrize("name", ["disturbance", "uwb", "projected_camera", "imu"])
def test_a_seed_set_after_a_message_was_read_changes_that_message(name: str) -> None:
    world = make_world(scenario())
    context, source = prepared(world), world.GetSubsystemByName(name)
    its_context = source.GetMyContextFromRoot(context)
    before = source.get_output_port().Eval(its_context).copy()
    set_seed(world, context, 1)
    assert not np.array_equal(source.get_output_port().Eval(its_context), before)
    set_seed(world, context, 0)
    np.testing.assert_array_equal(source.get_output_port().Eval(its_context), before)
