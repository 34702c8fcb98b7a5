"""The seed in the Context: one world gives the noise of any seed, and two contexts do not disturb each other."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.systems.framework import Context

from ortilo_drake.diagrams.world import World, make_world
from ortilo_drake.scenario import load_scenario

# Every source of noise: loss in bursts, delays drawn, lost commands, rotors pushed by gusts.
BURSTS = "{kind: gilbert_elliott, good_to_bad: 0.3, bad_to_good: 0.4}"
SETTINGS = (
    "camera.kind=projected",
    f"uwb.link={{rate: null, random_delay: 2, loss: {BURSTS}}}",
    f"camera.link={{rate: null, loss: {BURSTS}}}",
    "imu.link.loss={kind: bernoulli, probability: 0.5}",
    "command_link={loss: {kind: bernoulli, probability: 0.5}, when_lost: zero}",
)
TICKS = 12
SEEDS = st.integers(min_value=0, max_value=2**63 - 1)


SOURCES = ("disturbance", "command_link", "uwb", "uwb_link", "camera", "camera_link", "imu", "imu_link")


def a_world() -> World:
    return make_world(load_scenario("nominal_imu_uwb_yolo", SETTINGS))


def prepared(world: World, seed: int = 0) -> Context:
    """Return a context of a seed: the vehicle stands amid the room, told to climb, so that a lost command shows."""
    context = world.CreateDefaultContext()
    world.GetInputPort("control").FixValue(context, [27.0, 0.0, 0.0, 0.0])
    world.SetState(context, np.array([8.0, 1.0, 1.5, *[0.02] * 9]))
    world.SetSeed(context, seed)
    return context


def said(world: World, context: Context, name: str) -> np.ndarray:
    """Return what a source says."""
    system = world.GetSubsystemByName(name)
    port = "applied" if name == "command_link" else name
    return np.array(system.GetOutputPort(port).Eval(system.GetMyContextFromRoot(context)))


def noise(world: World, context: Context, ticks: int = TICKS) -> list[np.ndarray]:
    """Return what every source says at each tick, and the discrete state that it comes to."""
    found = []
    for k in range(ticks):
        context.SetTime(k / 30.0)
        found += [said(world, context, name) for name in SOURCES]
        updated = world.EvalUniquePeriodicDiscreteUpdate(context)
        context.get_mutable_discrete_state().SetFrom(updated)
        found += [updated.value(i).copy() for i in range(updated.num_groups())]
    return found


def assert_same(one: list[np.ndarray], other: list[np.ndarray]) -> None:
    assert [a.tobytes() for a in one] == [a.tobytes() for a in other]


@pytest.mark.long
@given(before=SEEDS, flown=SEEDS)
@settings(max_examples=10)
def test_a_world_whose_seed_is_set_anew_is_one_that_never_had_another(before: int, flown: int) -> None:
    reused, fresh = a_world(), a_world()
    context = prepared(reused, before)
    reused.SetSeed(context, flown)
    assert_same(noise(reused, context), noise(fresh, prepared(fresh, flown)))


def test_every_source_of_noise_has_the_seed_and_none_shares_it_with_another_context() -> None:
    world = a_world()
    one, other, untouched = prepared(world), prepared(world), prepared(world)
    world.SetSeed(one, 2**62 + 1)
    world.SetSeed(other, 2**62)  # the same number as a float
    found = [noise(world, context) for context in (one, other, untouched)]
    assert_same(found[2], noise(world, prepared(world)))
    rows = len(found[0]) // TICKS
    for i, name in enumerate(SOURCES):  # which of those come first in each tick
        heard = [np.concatenate(flown[i::rows]).tobytes() for flown in found]
        assert len(set(heard)) == len(heard), name


@pytest.mark.parametrize("name", ["disturbance", "uwb", "camera", "imu"])
def test_a_seed_set_after_a_message_was_read_changes_that_message(name: str) -> None:
    world = a_world()
    context = prepared(world, 2)
    before = said(world, context, name)
    world.SetSeed(context, 1)
    assert not np.array_equal(said(world, context, name), before)
    world.SetSeed(context, 2)
    np.testing.assert_array_equal(said(world, context, name), before)
