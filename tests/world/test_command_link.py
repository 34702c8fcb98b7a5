"""The command link in Drake at the real tick: strategies, losses and delays against plain Python and closed forms."""

import numpy as np
import pytest
import yaml
from drake_box import PlayedBox
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem, System
from pydrake.systems.primitives import VectorLogSink

from ortilo_drake.diagrams.world import make_world
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import M100
from ortilo_drake.scenario import BernoulliLoss, GilbertElliottLoss, load_scenario
from ortilo_drake.scenario import CommandLink as CommandLinkSettings
from ortilo_drake.world.radio.command_link import command_link_box

H = 1.0 / 30.0
HOVER = np.array([2.7 * 9.81, 0.0, 0.0, 0.0])
HALF = BernoulliLoss(kind="bernoulli", probability=0.5)


class Commands(LeafSystem):
    """The command of tick k is (100 + k, k, -k, 2 k): no two alike, none of them hover."""

    def __init__(self) -> None:
        super().__init__()
        self.DeclareVectorOutputPort("control", 4, self._calc, prerequisites_of_calc={self.time_ticket()})

    def _calc(self, context, output) -> None:
        output.SetFromVector(command(round(context.get_time() / H)))


def command(k: int) -> np.ndarray:
    return np.array([100.0 + k, k, -k, 2 * k])


def radio_of(link: CommandLinkSettings) -> System:
    return PlayedBox(command_link_box(link, M100.hover_thrust, H), H, control=HOVER).system


def make(link: CommandLinkSettings, seed: int) -> tuple[Diagram, Simulator]:
    builder = DiagramBuilder()
    commands = builder.AddSystem(Commands())
    radio = builder.AddSystem(radio_of(link))
    log = builder.AddNamedSystem("log", VectorLogSink(4, H))
    builder.Connect(commands.get_output_port(), radio.GetInputPort("control"))
    builder.Connect(radio.GetOutputPort("applied"), log.get_input_port())
    simulator = Simulator(builder.Build())
    radio.set_seed_in(radio.GetMyMutableContextFromRoot(simulator.get_mutable_context()), seed)
    return simulator.get_system(), simulator


def fly(ticks: int, seed: int = 1, **settings) -> np.ndarray:
    """What acts on the rotors at each tick (ticks, 4)."""
    diagram, simulator = make(CommandLinkSettings(**settings), seed)
    simulator.AdvanceTo((ticks - 0.5) * H)
    return diagram.GetSubsystemByName("log").FindLog(simulator.get_context()).data().T


def arrivals(applied: np.ndarray, delay: int = 0) -> np.ndarray:
    """Ticks in which a packet arrived, of what 'zero' applied; each is the one sent `delay` ticks before."""
    there = np.flatnonzero(np.any(applied != HOVER, axis=1))
    for k in there:
        np.testing.assert_array_equal(applied[k], command(k - delay))
    return there


def test_a_link_that_loses_nothing_is_a_wire() -> None:
    np.testing.assert_array_equal(fly(50), [command(k) for k in range(50)])


@pytest.mark.parametrize("delay", [1, 2, 7])
def test_a_delay_shifts_the_commands_and_hovers_before_the_first(delay: int) -> None:
    expected = [HOVER] * delay + [command(k) for k in range(60 - delay)]
    for when_lost in ("hold", "zero"):
        np.testing.assert_array_equal(fly(60, delay=delay, when_lost=when_lost), expected)


@pytest.mark.family("1.0")
@pytest.mark.parametrize("probability", [0.0, 0.1, 0.5, 0.9, 1.0])
def test_loses_its_share_independently(probability: float) -> None:
    n = 6_000
    lost = np.ones(n)
    lost[arrivals(fly(n, loss=BernoulliLoss(kind="bernoulli", probability=probability), when_lost="zero"))] = 0.0
    variance = probability * (1 - probability)
    assert abs(lost.mean() - probability) <= 4 * np.sqrt(variance / n)
    if variance:
        together = np.mean((lost[1:] - probability) * (lost[:-1] - probability)) / variance
        assert abs(together) < 4 / np.sqrt(n)


@pytest.mark.parametrize("delay", [0, 3])
@pytest.mark.parametrize(
    ("loss", "share"),
    [(HALF, 0.5), (GilbertElliottLoss(kind="gilbert_elliott", good_to_bad=0.1, bad_to_good=0.3), 0.1 / (0.1 + 0.3))],
)
def test_hold_repeats_the_last_that_arrived_on_the_same_losses(loss, share: float, delay: int) -> None:
    zero, hold = (fly(400, loss=loss, delay=delay, when_lost=when_lost) for when_lost in ("zero", "hold"))
    there = set(arrivals(zero, delay).tolist())
    assert abs(1.0 - len(there) / 400 - share) < 0.12  # the bursts' deviates by 0.04
    last = HOVER
    for k in range(400):
        last = command(k - delay) if k in there else last
        np.testing.assert_array_equal(hold[k], last)


def test_a_packet_is_lost_at_sending() -> None:
    at_once, late = (arrivals(fly(500, loss=HALF, delay=d, when_lost="zero"), d) for d in (0, 4))
    np.testing.assert_array_equal(at_once[at_once < 496] + 4, late)


def test_the_seed_decides_and_repeats() -> None:
    one, again, other = (fly(400, seed, loss=HALF) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, again)
    assert not np.array_equal(one, other)


def test_the_whole_state_is_in_the_context() -> None:
    loss = GilbertElliottLoss(kind="gilbert_elliott", good_to_bad=0.3, bad_to_good=0.3)
    diagram, first = make(CommandLinkSettings(loss=loss, delay=2), 5)
    radio = diagram.GetSubsystemByName("command_link")
    first.AdvanceTo(20.5 * H)
    kept = first.get_context().Clone()
    first.AdvanceTo(60 * H)
    second = Simulator(diagram, kept)
    second.AdvanceTo(60 * H)
    states = [
        radio.GetMyContextFromRoot(s.get_context()).get_discrete_state_vector().CopyToVector() for s in (first, second)
    ]
    np.testing.assert_array_equal(*states)


def test_only_a_link_without_delay_passes_commands_straight_on() -> None:
    for settings, passes in ((CommandLinkSettings(loss=HALF), True), (CommandLinkSettings(delay=1), False)):
        radio = radio_of(settings)
        ports = radio.GetInputPort("control").get_index(), radio.GetOutputPort("applied").get_index()
        assert radio.HasDirectFeedthrough(*ports) == passes


# --- the scenario ------------------------------------------------------------------------------------------------


def test_a_perfect_link_adds_nothing_to_the_world() -> None:
    def names(*settings: str) -> list[str]:
        return sorted(s.get_name() for s in make_world(load_scenario("nominal_imu_uwb", settings)).GetSystems())

    assert "command_link" not in names()
    assert names("command_link.delay=1") == sorted([*names(), "command_link"])


def test_a_scenario_shows_it_and_loads_again() -> None:
    shown = load_scenario("nominal_imu_uwb").model_dump(mode="json")["command_link"]
    assert shown == {"loss": {"kind": "none"}, "when_lost": "hold", "delay": 0}
    text = yaml.safe_dump({"loss": {"kind": "bernoulli", "probability": 0.25}, "when_lost": "zero", "delay": 2})
    loaded = load_scenario("nominal_imu_uwb", (f"command_link={yaml.safe_load(text)}",)).command_link
    assert loaded == CommandLinkSettings(
        loss=BernoulliLoss(kind="bernoulli", probability=0.25), when_lost="zero", delay=2
    )


@pytest.mark.parametrize(
    ("setting", "named"),
    [
        ("command_link.loss={kind: bernoulli, probability: 1.5}", ["probability", "1.5", "at most 1"]),
        (
            "command_link.loss={kind: bernoulli, probability: -0.1}",
            ["probability", "-0.1", "at least 0"],
        ),
        ("command_link.loss={kind: bernoulli, probability: .nan}", ["probability", "nan", "finite"]),
        ("command_link.loss={kind: bernoulli}", ["probability", "missing"]),
        ("command_link.loss={kind: often}", ["'often'", "bernoulli", "gilbert_elliott"]),
        ("command_link.when_lost=fall", ["when_lost", "'fall'", "'hold'", "'zero'"]),
        ("command_link.delay=1.5", ["delay", "1.5", "integer"]),
        ("command_link.delay=-1", ["delay", "-1", "at least 0"]),
        ("command_link.every=3", ["command_link.every", "unknown"]),
    ],
)
def test_bad_values_are_refused(setting: str, named: list[str]) -> None:
    with pytest.raises(InputError) as error:
        load_scenario("nominal_imu_uwb", (setting,))
    assert all(word in str(error.value) for word in ["nominal_imu_uwb", "command_link", *named]), error.value
    assert "\n" not in str(error.value)
