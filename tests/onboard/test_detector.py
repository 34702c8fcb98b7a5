"""The detector as a system: what comes out of it, and when."""

from collections.abc import Callable

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import VectorLogSink
from pydrake.systems.sensors import ImageRgba8U

from ortilo_drake.model.signals import ARRIVED, DETECTION_SIZE, DETECTIONS_SIZE, MAX_DETECTIONS, PAYLOAD, STAMP
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.detector.detector import Boxes, Detector, detections_message

H, SIZE = 1.0 / 30.0, (6, 4)


def picture(value: int, size: tuple[int, int] = SIZE) -> ImageRgba8U:
    image = ImageRgba8U(*size)
    image.mutable_data[:] = [value, value + 1, value + 2, 255]
    return image


class Camera(LeafSystem):
    """Gives at tick k a picture of brightness k, and a shutter message on every n-th tick with a stamp of its own."""

    def __init__(self, every: int, late: int = 0):
        super().__init__()
        self._every, self._late = every, late
        self.drawn = 0
        self.DeclareAbstractOutputPort(
            "image", lambda: Value(ImageRgba8U()), self._image, prerequisites_of_calc={self.time_ticket()}
        )
        self.DeclareVectorOutputPort("shutter", 2, self._shutter, prerequisites_of_calc={self.time_ticket()})

    def _image(self, context: Context, output: Value) -> None:
        self.drawn += 1
        output.set_value(picture(round(context.get_time() / H)))

    def _shutter(self, context: Context, output: BasicVector) -> None:
        k = round(context.get_time() / H)
        if k % self._every == 0:
            output.SetFromVector([1.0, (k - self._late) * H])
        else:
            output.SetFromVector([0.0, 77.0])


def one_box(image: np.ndarray) -> Boxes:
    """Return one box whose place tells the picture's colours."""
    assert image.shape == (SIZE[1], SIZE[0], 3)
    assert image.dtype == np.uint8
    return np.array([2]), np.array([0.75]), image[0, 0, [0, 1, 2, 0]].astype(float).reshape(1, 4)


def flown(detector: Detector, camera: Camera, ticks: int = 24) -> np.ndarray:
    """Return the message of every tick, as a system that samples at the ticks sees it."""
    builder = DiagramBuilder()
    builder.AddSystem(camera)
    builder.AddSystem(detector)
    builder.Connect(camera.GetOutputPort("image"), detector.GetInputPort("image"))
    builder.Connect(camera.GetOutputPort("shutter"), detector.GetInputPort("shutter"))
    log = builder.AddSystem(VectorLogSink(DETECTIONS_SIZE, H))
    builder.Connect(detector.get_output_port(), log.get_input_port())
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(ticks * H)
    return log.FindLog(simulator.get_context()).data().T


@pytest.mark.parametrize("latency", [1, 2, 5])
@pytest.mark.parametrize("every", [1, 3])
def test_boxes_come_out_the_latency_later_with_the_pictures_stamp(latency: int, every: int) -> None:
    messages = flown(Detector(one_box, SIZE, latency, H), Camera(every))
    assert len(messages) == 25
    for k, message in enumerate(messages):
        taken = k - latency
        if taken < 0 or taken % every:
            assert not message.any()
            continue
        assert message[ARRIVED] == 1.0
        assert message[STAMP] == pytest.approx(taken * H, abs=1e-12)
        rows = message[PAYLOAD:].reshape(MAX_DETECTIONS, DETECTION_SIZE)
        assert rows[0].tolist() == [2.0, 0.75, taken, taken + 1, taken + 2, taken]
        assert np.all(rows[1:, 0] == -1.0)


def test_the_stamp_is_the_shutters_not_the_time_of_looking() -> None:
    messages = flown(Detector(one_box, SIZE, 2, H), Camera(3, late=3))
    assert messages[8, STAMP] == pytest.approx((6 - 3) * H, abs=1e-12)


def test_without_a_shutter_message_nothing_is_drawn_or_looked_at() -> None:
    looked: list[int] = []

    def look(image: np.ndarray) -> Boxes:
        looked.append(int(image[0, 0, 0]))
        return one_box(image)

    camera = Camera(4)
    flown(Detector(look, SIZE, 1, H), camera)
    assert looked == [0, 4, 8, 12, 16, 20, 24][: len(looked)]
    assert 6 <= len(looked) <= 7
    assert camera.drawn == len(looked)


def test_a_picture_in_which_nothing_is_found_is_a_message_without_boxes() -> None:
    def blind(image: np.ndarray) -> Boxes:
        return np.empty(0, dtype=np.int64), np.empty(0), np.empty((0, 4))

    message = flown(Detector(blind, SIZE, 1, H), Camera(1))[3]
    assert message[ARRIVED] == 1.0
    assert np.all(message[PAYLOAD::DETECTION_SIZE] == -1.0)


@pytest.mark.parametrize("n", [0, 1, MAX_DETECTIONS, MAX_DETECTIONS + 1, 100])
def test_of_more_boxes_than_fit_the_best_are_kept_best_first(n: int) -> None:
    rng = np.random.default_rng(n)
    labels, scores, boxes = rng.integers(0, 9, n), rng.permutation(n) / 200.0 + 0.1, rng.uniform(0.0, 300.0, (n, 4))
    message = detections_message(1.25, labels, scores, boxes)
    assert message.shape == (DETECTIONS_SIZE,)
    assert message[:PAYLOAD].tolist() == [1.0, 1.25]
    rows = message[PAYLOAD:].reshape(MAX_DETECTIONS, DETECTION_SIZE)
    best = sorted(range(n), key=lambda i: -scores[i])[:MAX_DETECTIONS]
    for row, i in zip(rows, best, strict=False):
        assert row.tolist() == [labels[i], scores[i], *boxes[i]]
    assert np.all(rows[len(best) :, 0] == -1.0)


def test_of_equal_scores_the_first_come_first() -> None:
    labels, n = np.arange(40), 40
    rows = detections_message(0.0, labels, np.full(n, 0.5), np.zeros((n, 4)))[PAYLOAD:].reshape(-1, DETECTION_SIZE)
    assert rows[:, 0].tolist() == list(range(MAX_DETECTIONS))


@pytest.mark.parametrize("size", [(6, 5), (7, 4), (4, 6)])
def test_a_picture_of_another_size_is_refused(size: tuple[int, int]) -> None:
    detector = Detector(one_box, SIZE, 1, H)
    context = detector.CreateDefaultContext()
    detector.GetInputPort("image").FixValue(context, Value(picture(3, size)))
    detector.GetInputPort("shutter").FixValue(context, [1.0, 0.0])
    with pytest.raises(InputError, match=rf"image: {size[0]} x {size[1]}: the detector expects 6 x 4"):
        detector.EvalUniquePeriodicDiscreteUpdate(context)


def test_everything_that_evolves_is_in_the_context() -> None:
    detector = Detector(one_box, SIZE, 3, H)
    builder = DiagramBuilder()
    camera = builder.AddSystem(Camera(1))
    builder.AddSystem(detector)
    builder.Connect(camera.GetOutputPort("image"), detector.GetInputPort("image"))
    builder.Connect(camera.GetOutputPort("shutter"), detector.GetInputPort("shutter"))
    builder.ExportOutput(detector.get_output_port(), "detections")
    diagram = builder.Build()

    def end_of(start: Callable[[], Simulator]) -> np.ndarray:
        simulator = start()
        simulator.AdvanceTo(20.5 * H)
        return diagram.get_output_port().Eval(simulator.get_context()).copy()

    halfway = Simulator(diagram)
    halfway.AdvanceTo(10.5 * H)
    copy = halfway.get_context().Clone()
    halfway.AdvanceTo(15.5 * H)  # another flight in between
    resumed = end_of(lambda: Simulator(diagram, copy))
    np.testing.assert_array_equal(resumed, end_of(lambda: Simulator(diagram)))
    assert resumed[ARRIVED] == 1.0


def test_boxes_are_not_a_function_of_this_ticks_picture() -> None:
    """Else the loop through filter and servo would be algebraic."""
    detector = Detector(one_box, SIZE, 1, H)
    assert not detector.HasAnyDirectFeedthrough()
