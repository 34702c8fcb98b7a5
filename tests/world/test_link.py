"""The link flown at the real tick: rates, losses, blackouts and delays against closed forms."""

from typing import Any

import numpy as np
import pytest
from drake_box import PlayedBox
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from scipy import stats

from ortilo_drake.loop.diagram import add_wiring
from ortilo_drake.loop.element import Box, Element, Values, constant, outside
from ortilo_drake.loop.player import Player
from ortilo_drake.loop.shell import WiredSystem_
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.scenario import (
    BernoulliLoss,
    BurstLoss,
    GilbertElliottLoss,
    Link,
    PositionBlackout,
    TimeBlackout,
)
from ortilo_drake.world.noise import stream_id
from ortilo_drake.world.radio.link import delivery_box, link_box

settings.register_profile("compiled", deadline=None)  # the first example may wait for numba
settings.load_profile("compiled")

H = 1.0 / 30.0
SIZE = 4


class Source(LeafSystem):
    """A sensor whose message (arrived, stamp, tick, square of the tick) is there but each silent-th tick.

    It says one where it is told that it is sent, as the elements do.
    """

    def __init__(self, silent: int = 0, late: float = 0.0):
        super().__init__()
        self.silent, self.late, self.asked = silent, late, []
        sent = self.DeclareVectorInputPort("sent", 1)
        needs = {self.time_ticket(), sent.ticket()}
        self.DeclareVectorOutputPort("message", SIZE, self._calc, prerequisites_of_calc=needs)

    def _calc(self, context, output) -> None:
        k = round(context.get_time() / H)
        if self.get_input_port().Eval(context)[0] < 0.0:
            output.SetFromVector(np.zeros(SIZE))
            return
        self.asked.append(k)
        there = not (self.silent and k % self.silent == 0)
        output.SetFromVector([float(there), k * H - self.late, k, k * k])


class Vehicle(LeafSystem):
    """A vehicle at x = k / 4, y = -k / 8, z = k / 16: exact in binary."""

    def __init__(self):
        super().__init__()
        self.DeclareVectorOutputPort("state", 12, self._calc, prerequisites_of_calc={self.time_ticket()})

    def _calc(self, context, output) -> None:
        k = round(context.get_time() / H)
        output.SetFromVector([k / 4, -k / 8, k / 16] + [0.0] * 9)


class Recorder(LeafSystem):
    """What a filter would consume: the port's value at each tick, read in a discrete update."""

    def __init__(self):
        super().__init__()
        self.rows = []
        self.DeclareVectorInputPort("delivered", SIZE)
        self.DeclarePeriodicDiscreteUpdateEvent(H, 0.0, self._update)

    def _update(self, context, discrete_state) -> None:
        self.rows.append(self.get_input_port().Eval(context).copy())


def source_out(n: Any, k: int, delay: np.ndarray, out: np.ndarray) -> None:
    """Say what Source says."""
    out[:] = 0.0
    if delay[0] >= 0.0 and not (n.silent > 0 and k % max(n.silent, 1) == 0):
        out[0], out[1], out[2], out[3] = 1.0, k * n.h - n.late, k, k * k


def vehicle_out(k: int, out: np.ndarray) -> None:
    """Say the state that Vehicle says."""
    out[:] = 0.0
    out[0], out[1], out[2] = k / 4, -k / 8, k / 16


SOURCE = Element("source", out=source_out)
VEHICLE = Element("still_line", out=vehicle_out)


def radio_boxes(sensor: str, link: Link) -> list[Box]:
    """Return a link and what it delivers; they read the state of a vehicle, and messages."""
    message, vehicle = outside("message", SIZE), outside("vehicle", 12)
    decides = link_box(sensor, link, link.every(H), H).with_inputs(state="vehicle")
    return [message, vehicle, decides, delivery_box(sensor, message, link)]


def fly(link: Link, ticks: int, seed: int = 1, sensor: str = "uwb", silent: int = 0, late: float = 0.0) -> np.ndarray:
    """What arrives at each tick (ticks, SIZE), compiled."""
    *_, decides, delivers = radio_boxes(sensor, link)
    source = Box(
        "message", SOURCE, SIZE, Values({"h": H, "late": late, "silent": silent}), reads={"delay": decides.name}
    )
    boxes = [source, Box("vehicle", VEHICLE, 12), decides, delivers, constant("end", [-1.0])]
    player, rows = Player(Wiring(boxes), (delivers.name,), "end"), np.zeros((ticks, SIZE))
    assert player.fly(np.full(ticks, seed, np.int64), rows) == ticks - 1
    return rows


def fly_in_drake(link: Link, ticks: int, source: Source, seed: int = 1, sensor: str = "uwb") -> np.ndarray:
    """The same by Drake, of a sensor that counts what it is asked."""
    builder = DiagramBuilder()
    source = builder.AddSystem(source)
    vehicle = builder.AddSystem(Vehicle())
    recorder = builder.AddSystem(Recorder())
    sources = {"message": source.get_output_port(), "vehicle": vehicle.get_output_port()}
    shown = {"delay": f"{sensor}_link", "delivered": f"{sensor}_delivered"}
    radio = add_wiring(builder, Wiring(radio_boxes(sensor, link)), shown, H, sources)
    builder.Connect(radio.outputs["delay"], source.get_input_port())
    builder.Connect(radio.outputs["delivered"], recorder.get_input_port())
    simulator = Simulator(builder.Build())
    radio.set_seed(simulator.get_mutable_context(), seed)
    simulator.AdvanceTo((ticks - 0.5) * H)
    assert len(recorder.rows) == ticks
    return np.array(recorder.rows)


def arrived(rows: np.ndarray) -> np.ndarray:
    """Ticks in which something arrived, after checking that whatever came is whole and the rest is zeros."""
    there = rows[:, 0] == 1.0
    assert np.all(rows[~there] == 0.0)
    sent = rows[there, 2]
    np.testing.assert_array_equal(rows[there, 1], sent * H)  # the stamp is the time it was true
    np.testing.assert_array_equal(rows[there, 3], sent**2)
    return np.flatnonzero(there)


def delivered(rows: np.ndarray) -> np.ndarray:
    """Pairs (tick of arrival, tick of sending)."""
    at = arrived(rows)
    return np.column_stack([at, rows[at, 2].astype(int)])


# --- rate ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("every", [1, 2, 3, 7, 30])
def test_sends_on_every_nth_tick(every: int) -> None:
    np.testing.assert_array_equal(arrived(fly(Link(rate=30.0 / every), 3_000)), np.arange(0, 3_000, every))
    source = Source()
    fly_in_drake(Link(rate=30.0 / every), 100, source)
    assert source.asked == list(range(0, 100, every))  # and the sensor does no work in between


def test_a_sensor_without_a_message_sends_none() -> None:
    for link in (Link(), Link(delay=2)):
        sent = delivered(fly(link, 300, silent=5))[:, 1]
        np.testing.assert_array_equal(sent, [k for k in range(300 - link.delay) if k % 5])


# --- loss ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("probability", [0.0, 0.1, 0.5, 0.9, 1.0])
def test_bernoulli_loses_its_share_independently(probability: float) -> None:
    n = 8_000
    lost = np.ones(n)
    lost[arrived(fly(Link(loss=BernoulliLoss(kind="bernoulli", probability=probability)), n))] = 0.0
    sd = np.sqrt(probability * (1 - probability) / n)
    assert abs(lost.mean() - probability) <= 4 * sd
    if sd:
        together = np.mean((lost[1:] - probability) * (lost[:-1] - probability)) / (probability * (1 - probability))
        assert abs(together) < 4 / np.sqrt(n)


def test_a_lost_message_is_never_made() -> None:
    source = Source()
    rows = fly_in_drake(Link(loss=BernoulliLoss(kind="bernoulli", probability=0.5)), 200, source)
    assert 0 < len(source.asked) < 200
    assert source.asked == arrived(rows).tolist()


def share_and_sd(loss: GilbertElliottLoss, n: int, every: int) -> tuple[float, float]:
    """Mean loss rate, and the standard deviation of the share lost of n messages, one every so many ticks."""
    a, b = loss.good_to_bad, loss.bad_to_good
    bad = a / (a + b)
    rate = (1 - bad) * loss.loss_good + bad * loss.loss_bad
    memory = (1 - a - b) ** every  # correlation of the chain's states at two messages in a row
    hidden = bad * (1 - bad) * (loss.loss_bad - loss.loss_good) ** 2
    variance = rate * (1 - rate) - hidden + hidden * (1 + memory) / (1 - memory)
    return rate, np.sqrt(variance / n)


@pytest.mark.parametrize(
    "loss",
    [
        GilbertElliottLoss(kind="gilbert_elliott", good_to_bad=0.05, bad_to_good=0.2),
        GilbertElliottLoss(kind="gilbert_elliott", good_to_bad=0.02, bad_to_good=0.1, loss_good=0.1, loss_bad=0.7),
        GilbertElliottLoss(kind="gilbert_elliott", good_to_bad=0.9, bad_to_good=0.8),
    ],
    ids=["bursts", "partial", "alternating"],
)
@pytest.mark.parametrize("every", [1, 3])
def test_gilbert_elliott_loses_the_chain_s_share(loss: GilbertElliottLoss, every: int) -> None:
    n = 12_000
    got = arrived(fly(Link(rate=30.0 / every, loss=loss), n))
    rate, sd = share_and_sd(loss, n // every, every)
    assert abs(1 - len(got) * every / n - rate) < 4 * sd


@pytest.mark.parametrize(("a", "b"), [(0.05, 0.2), (0.01, 0.04), (0.3, 0.5)])
def test_bursts_and_gaps_are_geometric(a: float, b: float) -> None:
    n = 15_000
    loss = GilbertElliottLoss(kind="gilbert_elliott", good_to_bad=a, bad_to_good=b)
    lost = np.ones(n, dtype=int)
    lost[arrived(fly(Link(loss=loss), n))] = 0
    assert lost[0] == 0  # the chain starts good
    edges = np.flatnonzero(np.diff(lost))
    runs, first = np.diff(edges), lost[edges[:-1] + 1]
    for value, leave in ((1, b), (0, a)):
        lengths = runs[first == value]
        sd = np.sqrt(1 - leave) / leave / np.sqrt(len(lengths))
        assert abs(lengths.mean() - 1 / leave) < 4 * sd
        longest = int(stats.geom.ppf(0.8, leave))  # and not only the mean: the distribution up to its 80 % point
        counts = np.array([np.sum(lengths == j) for j in range(1, longest + 1)] + [np.sum(lengths > longest)])
        expected = stats.geom.pmf(np.arange(1, longest + 1), leave)
        expected = np.append(expected, 1 - expected.sum()) * len(lengths)
        assert stats.chisquare(counts, expected).pvalue > 1e-4


def test_a_chain_that_never_leaves_is_deterministic() -> None:
    never = GilbertElliottLoss(kind="gilbert_elliott", good_to_bad=0.0, bad_to_good=0.5)
    assert len(arrived(fly(Link(loss=never), 500))) == 500
    stuck = GilbertElliottLoss(kind="gilbert_elliott", good_to_bad=1.0, bad_to_good=0.0)
    assert arrived(fly(Link(loss=stuck), 500)).tolist() == [0]
    toggling = GilbertElliottLoss(kind="gilbert_elliott", good_to_bad=1.0, bad_to_good=1.0)
    np.testing.assert_array_equal(arrived(fly(Link(loss=toggling), 500)), np.arange(0, 500, 2))


@pytest.mark.long
@pytest.mark.parametrize("every", [1, 3])
def test_bursts_lose_their_share_for_their_mean_length(every: int) -> None:
    n, seconds = 60_000, 0.5  # 15 ticks
    got = arrived(fly(Link(rate=30.0 / every, loss=BurstLoss(kind="bursts", loss=0.4, mean_length=seconds)), n))
    chain = GilbertElliottLoss(kind="gilbert_elliott", good_to_bad=0.4 / 0.6 / 15.0, bad_to_good=1.0 / 15.0)
    rate, sd = share_and_sd(chain, n // every, every)
    assert rate == pytest.approx(0.4, rel=1e-12)
    assert abs(1.0 - len(got) / (n // every) - 0.4) < 4 * sd
    if every == 1:
        gaps = np.diff(got)[np.diff(got) > 1] - 1
        assert np.mean(gaps) * H == pytest.approx(seconds, abs=4 * seconds / np.sqrt(len(gaps)))


def test_each_seed_and_sensor_has_its_own_losses_and_repeats_them() -> None:
    link = Link(loss=BernoulliLoss(kind="bernoulli", probability=0.5))
    base = fly(link, 600)
    np.testing.assert_array_equal(base, fly(link, 600))
    for other in (fly(link, 600, seed=2), fly(link, 600, sensor="camera")):
        agree = np.mean(base[:, 0] == other[:, 0])
        assert abs(agree - 0.5) < 4 * 0.5 / np.sqrt(600)


def test_a_slower_rate_leaves_the_losses_of_its_ticks() -> None:
    for loss in (
        BernoulliLoss(kind="bernoulli", probability=0.4),
        GilbertElliottLoss(kind="gilbert_elliott", good_to_bad=0.1, bad_to_good=0.2),
    ):
        each, third = fly(Link(loss=loss), 900), fly(Link(loss=loss, rate=10.0), 900)
        np.testing.assert_array_equal(third[::3], each[::3])


# --- blackouts ----------------------------------------------------------------------------------------------


@pytest.mark.family
@pytest.mark.parametrize(
    ("axis", "start", "end", "dark"),
    [
        ("x", 2.5, 5.0, range(10, 20)),  # x = k / 4 is 2.5 at k = 10, inside, and 5 at k = 20, outside
        ("x", 2.51, 5.01, range(11, 21)),
        ("y", -5.0, -2.5, range(21, 41)),  # y = -k / 8 is -5 at k = 40, inside, and -2.5 at k = 20, outside
        ("z", 0.0, 0.0625, range(0, 1)),
    ],
)
def test_a_blackout_by_position_is_half_open(axis, start, end, dark) -> None:
    link = Link(blackouts=(PositionBlackout(kind="position", axis=axis, start=start, end=end),))
    np.testing.assert_array_equal(arrived(fly(link, 60)), [k for k in range(60) if k not in dark])


@given(first=st.integers(0, 2_000), length=st.integers(1, 50))
@settings(max_examples=15)
def test_a_blackout_by_time_is_half_open_whatever_the_rounding(first: int, length: int) -> None:
    last = first + length
    link = Link(rate=30.0 / 7, blackouts=(TimeBlackout(kind="time", start=first / 30, end=last / 30),))
    got = arrived(fly(link, 2_100))
    np.testing.assert_array_equal(got, [k for k in range(0, 2_100, 7) if not first <= k < last])


def test_a_tenth_of_a_second_is_three_ticks_whatever_the_rounding() -> None:
    assert np.ceil(8.3 / H) == 250  # what a plain division makes of tick 249
    link = Link(blackouts=(TimeBlackout(kind="time", start=8.3, end=16.1),))
    got = arrived(fly(link, 600))
    np.testing.assert_array_equal(got, [k for k in range(600) if not 249 <= k < 483])


def test_blackouts_add_up_and_leave_what_is_in_flight() -> None:
    dark = (
        PositionBlackout(kind="position", start=2.5, end=5.0),
        TimeBlackout(kind="time", start=1.0, end=1.5),
    )
    sent = [k for k in range(95) if not 10 <= k < 20 and not 30 <= k < 45]
    np.testing.assert_array_equal(delivered(fly(Link(blackouts=dark, delay=5), 100))[:, 0], np.array(sent) + 5)


# --- delay --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("delay", [0, 1, 2, 5, 30])
@pytest.mark.parametrize("every", [1, 3])
def test_a_fixed_delay_is_exact(delay: int, every: int) -> None:
    pairs = delivered(fly(Link(rate=30.0 / every, delay=delay), 3_000))
    sent = np.arange(0, 3_000 - delay, every)
    np.testing.assert_array_equal(pairs, np.column_stack([sent + delay, sent]))


def test_a_random_delay_is_uniform() -> None:
    pairs = delivered(fly(Link(rate=5.0, delay=1, random_delay=4), 24_000))
    late = pairs[:, 0] - pairs[:, 1]
    assert len(late) >= 3_999
    counts = np.bincount(late, minlength=6)
    assert counts[0] == 0
    assert len(counts) == 6
    assert stats.chisquare(counts[1:]).pvalue > 1e-4


def numpy_decisions(seed: int, sensor: str, k: int) -> np.ndarray:
    """The uniform numbers of a tick, from NumPy's own generator: loss, delay."""
    before = ((k << 64) - 1) % 2**256
    counter = np.array([(before >> (64 * i)) % 2**64 for i in range(4)], dtype=np.uint64)
    key = np.array([seed, stream_id(f"link/{sensor}")], dtype=np.uint64)
    return (np.random.Philox(key=key, counter=counter).random_raw(4) >> np.uint64(11)) * 2.0**-53


@pytest.mark.family
@pytest.mark.parametrize("delay", [0, 1, 3])
@pytest.mark.parametrize("every", [1, 2])
def test_of_several_that_arrive_together_the_newest_is_delivered(delay: int, every: int) -> None:
    ticks, more = 1_500, 4
    newest: dict[int, int] = {}
    sent = 0
    for k in range(0, ticks, every):
        u = numpy_decisions(8, "imu", k)
        if u[0] >= 0.2:
            sent += 1
            newest[k + delay + int(u[1] * (more + 1))] = k  # later ticks overwrite earlier ones
    link = Link(
        rate=30.0 / every, delay=delay, random_delay=more, loss=BernoulliLoss(kind="bernoulli", probability=0.2)
    )
    pairs = delivered(fly(link, ticks, seed=8, sensor="imu"))
    assert pairs.tolist() == sorted([at, k] for at, k in newest.items() if at < ticks)
    assert len(pairs) < sent  # some did collide


def test_a_stamp_older_than_the_tick_is_kept() -> None:
    rows = fly(Link(delay=2), 20, late=0.05)
    np.testing.assert_allclose(rows[2:, 1], np.arange(18) * H - 0.05, atol=1e-15)


def test_drake_delivers_the_same() -> None:
    link = Link(
        rate=15.0,
        delay=1,
        random_delay=2,
        loss=GilbertElliottLoss(kind="gilbert_elliott", good_to_bad=0.1, bad_to_good=0.2),
    )
    np.testing.assert_array_equal(fly_in_drake(link, 600, Source()), fly(link, 600))


# --- how it sits in a diagram -------------------------------------------------------------------------------


CHAIN = GilbertElliottLoss(kind="gilbert_elliott", good_to_bad=0.1, bad_to_good=0.1)


@pytest.mark.parametrize(
    ("link", "chain", "flies"),
    [
        (Link(rate=10.0, loss=BernoulliLoss(kind="bernoulli", probability=0.3)), False, False),
        (Link(loss=CHAIN), True, False),
        (Link(delay=2), False, True),
        (Link(random_delay=2), False, True),
        (Link(delay=1, loss=CHAIN), True, True),
    ],
)
def test_has_state_only_where_it_must(link: Link, chain: bool, flies: bool) -> None:
    *_, decides, delivers = radio_boxes("uwb", link)
    its_link = PlayedBox(decides, H, state=np.zeros(12))
    delivery = PlayedBox(delivers, H, message=np.zeros(SIZE), delay=np.zeros(1))
    for played, keeps in ((its_link, chain), (delivery, flies)):
        assert played.context.num_discrete_state_groups() == keeps
        assert (played.system.GetUniquePeriodicDiscreteUpdateAttribute() is None) == (not keeps)
    assert delivery.system.HasAnyDirectFeedthrough() == (link.delay == 0)  # a delayed message breaks an algebraic loop


def test_all_that_evolves_is_in_the_context() -> None:
    loss = GilbertElliottLoss(kind="gilbert_elliott", good_to_bad=0.2, bad_to_good=0.2)
    boxes = radio_boxes("uwb", Link(delay=2, random_delay=2, loss=loss))
    system = WiredSystem_[float]("radio", Wiring(boxes), {"delivered": ("uwb_delivered",)}, H)
    runs = []
    for _ in range(2):
        simulator = Simulator(system)
        context = simulator.get_mutable_context()
        system.set_seed_in(context, 1)
        system.GetInputPort("message").FixValue(context, [1.0, 0.5, 2.0, 3.0])
        system.GetInputPort("vehicle").FixValue(context, np.zeros(12))
        row = []
        for k in range(100):
            simulator.AdvanceTo((k + 0.5) * H)
            row.append(context.get_discrete_state_vector().CopyToVector())
        runs.append(np.array(row))
    np.testing.assert_array_equal(runs[0], runs[1])
    assert len(np.unique(runs[0], axis=0)) > 50
