"""The seed of a system's noise: two of a kind differ by stream or by place, and Drake's generator draws it."""

from typing import Any

import numpy as np
import pytest
from pydrake.autodiffutils import AutoDiffXd
from pydrake.common import RandomGenerator
from pydrake.systems.framework import DiagramBuilder

from ortilo_drake.diagrams.imu import make_imu
from ortilo_drake.loop.shell import add_chance, seed_of

H, TICKS = 1.0 / 30.0, 2000
CORRELATED = 5.0 / np.sqrt(TICKS * 9)  # standard errors of what is not


def noise_of(diagram: Any, names: tuple[str, ...], context: Any = None, ticks: int = TICKS) -> list[np.ndarray]:
    """Return the noise of IMUs at rest in a Diagram, of unit deviation, one after the other."""
    context = context or diagram.CreateDefaultContext()
    systems = [diagram.GetSubsystemByName(name) for name in names]
    for system in systems:
        for port, size in enumerate((12, 3)):
            system.get_input_port(port).FixValue(system.GetMyMutableContextFromRoot(context), np.zeros(size))
    rows = np.zeros((ticks, len(names), 9))
    for k in range(ticks):
        context.SetTime(k * H)
        for i, system in enumerate(systems):
            rows[k, i] = system.get_output_port(0).Eval(system.GetMyContextFromRoot(context))[2:]
    unit = (rows - [*[0.0] * 8, 9.81]) / np.repeat([0.01, 0.01, 0.05], 3)
    return [unit[:, i].ravel() for i in range(len(names))]


def two_imus(names: tuple[str, str], streams: tuple[str, str] = ("imu", "imu"), seeds: tuple[int, int] = (3, 3)) -> Any:
    builder = DiagramBuilder()
    for name, stream, seed in zip(names, streams, seeds, strict=True):
        builder.AddNamedSystem(name, make_imu(seed=seed, stream=stream))
    return builder.Build()


@pytest.mark.family
@pytest.mark.parametrize("streams", [("imu", "imu"), ("imu", "second")])
def test_two_imus_of_one_seed_in_one_diagram_are_not_correlated(streams: tuple[str, str]) -> None:
    names = ("imu", "other")
    one, other = noise_of(two_imus(names, streams), names)
    assert abs(np.corrcoef(one, other)[0, 1]) < CORRELATED
    assert np.std(other) == pytest.approx(1.0, abs=5.0 / np.sqrt(2 * one.size))


@pytest.mark.long
def test_streams_alone_tell_two_imus_apart_and_without_them_their_noise_is_the_same() -> None:
    def noise(stream: str) -> np.ndarray:
        builder = DiagramBuilder()
        builder.AddSystem(make_imu(seed=3, stream=stream))
        return noise_of(builder.Build(), ("imu",))[0]

    assert np.corrcoef(noise("imu"), noise("imu"))[0, 1] == pytest.approx(1.0)
    assert abs(np.corrcoef(noise("imu"), noise("second"))[0, 1]) < CORRELATED


def test_a_place_keeps_its_noise_whatever_else_is_in_the_diagram_and_on_other_scalars() -> None:
    alone = DiagramBuilder()
    alone.AddNamedSystem("other", make_imu(seed=3))
    diagram = alone.Build()
    (found,) = noise_of(diagram, ("other",), ticks=5)
    np.testing.assert_array_equal(noise_of(two_imus(("imu", "other")), ("imu", "other"), ticks=5)[1], found)
    clone = diagram.Clone()
    np.testing.assert_array_equal(noise_of(clone, ("other",), ticks=5)[0], found)
    converted = diagram.ToAutoDiffXd()
    its = converted.GetSubsystemByName("other")
    context = converted.CreateDefaultContext()
    for port, size in (("state", 12), ("acceleration", 3)):
        own = its.GetMyMutableContextFromRoot(context)
        its.GetInputPort(port).FixValue(own, np.array([AutoDiffXd(0.0)] * size))
    said = its.GetOutputPort("imu").Eval(its.GetMyContextFromRoot(context))[2]
    assert said.value() / 0.01 == found[0]


@pytest.mark.long
def test_drakes_generator_draws_the_seed_and_a_default_context_has_its_own() -> None:
    builder = DiagramBuilder()
    imu = builder.AddSystem(make_imu(seed=3))
    builder.Connect(add_chance(builder, H), imu.GetInputPort("chance"))
    diagram = builder.Build()

    def drawn(generator: RandomGenerator) -> np.ndarray:
        context = diagram.CreateDefaultContext()
        diagram.SetRandomContext(context, generator)
        return noise_of(diagram, ("imu",), context)[0]

    generator = RandomGenerator(7)
    first, second, again = drawn(generator), drawn(generator), drawn(RandomGenerator(7))
    np.testing.assert_array_equal(first, again)
    assert abs(np.corrcoef(first, second)[0, 1]) < CORRELATED
    own = DiagramBuilder()
    own.AddSystem(make_imu(seed=3))
    np.testing.assert_array_equal(noise_of(diagram, ("imu",))[0], noise_of(own.Build(), ("imu",))[0])


def test_another_chance_place_or_own_seed_is_another_seed() -> None:
    assert seed_of(5, 0.0, "") == 5
    found = [seed_of(5, 0.3, ""), seed_of(5, -0.3, ""), seed_of(6, 0.3, ""), seed_of(5, 0.0, "left")]
    found += [seed_of(5, 0.0, "right"), seed_of(5, 0.3, "left")]
    assert len({5, *found}) == 7
    assert all(0 <= seed < 2**63 for seed in found)
