"""Pictures under a link that delivers late: each message comes with the picture of its stamp."""

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import BasicVector, Context, Diagram, DiagramBuilder, DiscreteValues, LeafSystem
from pydrake.systems.primitives import ConstantVectorSource
from pydrake.systems.sensors import ImageRgba8U

from ortilo_drake.loop.diagram import add_wiring
from ortilo_drake.loop.element import outside
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.model.signals import ARRIVED, N_X, SHUTTER_SIZE, STAMP
from ortilo_drake.scenario import BernoulliLoss, Link
from ortilo_drake.world.radio.image_delay import ImageDelay
from ortilo_drake.world.radio.link import delivery_box, link_box
from ortilo_drake.world.sensors.true_velocity import shutter_box

H = 1.0 / 30.0


class Clock(LeafSystem):
    """A camera that sees the number of the tick."""

    def __init__(self) -> None:
        super().__init__()
        self.DeclareAbstractOutputPort(
            "color_image", lambda: Value(ImageRgba8U(3, 2)), self._draw, prerequisites_of_calc={self.time_ticket()}
        )

    def _draw(self, context: Context, output: Value) -> None:
        k = round(context.get_time() / H)
        image = ImageRgba8U(3, 2)
        image.mutable_data[:] = [k % 256, k // 256, 0, 255]
        output.set_value(image)


class Onboard(LeafSystem):
    """Takes picture and message at the ticks as the detector does, in a discrete update: (arrived, stamp, seen)."""

    def __init__(self, ticks: int):
        super().__init__()
        self._image = self.DeclareAbstractInputPort("image", Value(ImageRgba8U()))
        self._shutter = self.DeclareVectorInputPort("shutter", SHUTTER_SIZE)
        self._rows = self.DeclareDiscreteState(np.full(3 * ticks, -1.0))
        self.DeclarePeriodicDiscreteUpdateEvent(H, 0.0, self._update)
        self.DeclareVectorOutputPort("rows", 3 * ticks, self._calc, prerequisites_of_calc={self.xd_ticket()})

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        k = round(context.get_time() / H)
        shutter = self._shutter.Eval(context)
        seen = -1.0
        if shutter[ARRIVED] == 1.0:
            pixel = self._image.Eval(context).data[0, 0]
            seen = float(pixel[0]) + 256.0 * float(pixel[1])
        rows = discrete_state.get_mutable_value(self._rows)
        if 3 * k < len(rows):
            rows[3 * k : 3 * k + 3] = [shutter[ARRIVED], shutter[STAMP], seen]

    def _calc(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(context.get_discrete_state(self._rows).value())


def flight_of(link: Link, seed: int, ticks: int) -> tuple[Diagram, Simulator]:
    builder = DiagramBuilder()
    camera = builder.AddSystem(Clock())
    kept = builder.AddSystem(ImageDelay(link.every(H), link.delay + link.random_delay, H))
    onboard = builder.AddSystem(Onboard(ticks))
    state = builder.AddSystem(ConstantVectorSource(np.zeros(N_X)))
    shutter, decides = shutter_box(H).with_inputs(sent="camera_link"), link_box("camera", link, link.every(H), H)
    boxes = [outside("state", N_X), decides, shutter, delivery_box("camera", shutter, link)]
    sources = {"state": state.get_output_port()}
    radio = add_wiring(builder, Wiring(boxes), {"shutter": "camera_delivered"}, H, sources)
    builder.Connect(camera.get_output_port(), kept.GetInputPort("color_image"))
    builder.Connect(radio.outputs["shutter"], kept.GetInputPort("shutter"))
    builder.Connect(kept.get_output_port(), onboard.GetInputPort("image"))
    builder.Connect(radio.outputs["shutter"], onboard.GetInputPort("shutter"))
    builder.ExportOutput(onboard.get_output_port(), "rows")
    simulator = Simulator(builder.Build())
    radio.set_seed(simulator.get_mutable_context(), seed)
    return simulator.get_system(), simulator


def received(link: Link, seed: int = 0, ticks: int = 300) -> np.ndarray:
    """Return rows (tick, tick of the stamp, tick of the picture) of what arrived."""
    diagram, simulator = flight_of(link, seed, ticks)
    simulator.AdvanceTo((ticks + 0.5) * H)
    rows = diagram.get_output_port().Eval(simulator.get_context()).reshape(ticks, 3)
    there = np.flatnonzero(rows[:, 0] == 1.0)
    return np.column_stack([there, np.round(rows[there, 1] / H), rows[there, 2]])


@pytest.mark.parametrize("every", [1, 3])
@pytest.mark.parametrize("delay", [1, 2, 3, 7, 40])
def test_the_picture_of_the_stamp_comes_with_it(every: int, delay: int) -> None:
    rows = received(Link(rate=30.0 / every, delay=delay))
    expected = np.arange(0, 300 - delay, every)
    np.testing.assert_array_equal(rows[:, 1], expected)
    np.testing.assert_array_equal(rows[:, 2], expected)
    np.testing.assert_array_equal(rows[:, 0], expected + delay)


@pytest.mark.family
@pytest.mark.parametrize("link", [
    Link(rate=10.0, random_delay=5),
    Link(random_delay=4),
    Link(rate=10.0, delay=2, random_delay=9),
    Link(rate=15.0, delay=1, random_delay=3, loss=BernoulliLoss(kind="bernoulli", probability=0.3)),
])  # fmt: skip
@pytest.mark.parametrize("seed", [0, 1])
def test_under_random_delay_and_loss_as_well(link: Link, seed: int) -> None:
    rows = received(link, seed)
    np.testing.assert_array_equal(rows[:, 2], rows[:, 1])
    late = rows[:, 0] - rows[:, 1]
    assert set(late) <= set(range(link.delay, link.delay + link.random_delay + 1))
    assert len(set(late)) == link.random_delay + 1  # every delay happens
    assert np.all(rows[:, 1] % link.every(H) == 0)


def test_no_more_pictures_are_kept_than_may_still_be_asked_for() -> None:
    diagram, simulator = flight_of(Link(rate=10.0, delay=4, random_delay=5), 0, 60)
    kept = diagram.GetSubsystemByName("image_delay")
    for k in range(60):
        simulator.AdvanceTo((k + 0.5) * H)
        taken = kept.GetMyContextFromRoot(simulator.get_context()).get_abstract_state(0).get_value()
        newest = k - k % 3
        assert sorted(taken) == [t for t in range(0, newest + 1, 3) if t >= newest - 9]


def test_a_copied_context_flies_on_alike_and_apart() -> None:
    diagram, simulator = flight_of(Link(delay=3), 0, 60)
    simulator.AdvanceTo(20.5 * H)
    copy = Simulator(diagram, simulator.get_context().Clone())
    for flight in (simulator, copy):
        flight.AdvanceTo(60.5 * H)
    rows = [diagram.get_output_port().Eval(flight.get_context()) for flight in (simulator, copy)]
    np.testing.assert_array_equal(*rows)
    assert rows[0].reshape(60, 3)[59].tolist() == [1.0, pytest.approx(56 * H), 56.0]
