"""The detector: it reads a picture and outputs labelled boxes some ticks later."""

from collections.abc import Callable

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem
from pydrake.systems.sensors import ImageRgba8U

from ortilo_drake.model.signals import (
    ARRIVED,
    DETECTION_SIZE,
    DETECTIONS_SIZE,
    MAX_DETECTIONS,
    PAYLOAD,
    SHUTTER_SIZE,
    STAMP,
)
from ortilo_drake.model.typed_yaml import InputError

Boxes = tuple[np.ndarray, np.ndarray, np.ndarray]


def detections_message(stamp: float, labels: np.ndarray, scores: np.ndarray, boxes: np.ndarray) -> np.ndarray:
    """Return the detections message of the boxes found, best first; it holds the best MAX_DETECTIONS boxes.

    `stamp` is the picture's time [s]; labels (k), scores in (0, 1] (k), boxes (u_min, v_min, u_max, v_max) [px] (k, 4).
    """
    message = np.zeros(DETECTIONS_SIZE)
    message[ARRIVED], message[STAMP] = 1.0, stamp
    rows = message[PAYLOAD:].reshape(MAX_DETECTIONS, DETECTION_SIZE)
    rows[:, 0] = -1.0
    best = np.argsort(-scores, kind="stable")[:MAX_DETECTIONS]
    rows[: len(best), 0], rows[: len(best), 1], rows[: len(best), 2:6] = labels[best], scores[best], boxes[best]
    return message


class Detector(LeafSystem):
    """A system that finds the landmarks in a picture and outputs the boxes a constant number of ticks later.

    It computes only in ticks in which a picture arrives. A picture may arrive while earlier ones are still in the
    pipeline: the stages do not wait for each other.

    Ports:
        image (ImageRgba8U): the picture.
        shutter (2): [arrived, stamp] of the picture.
        detections (DETECTIONS_SIZE, output): the message, see model/signals.py; its stamp is the picture's.

    State (discrete, updated each tick):
        pipeline (latency x DETECTIONS_SIZE): messages not yet output, the next one first.

    Args:
        detect: function from RGB (height, width, 3), uint8, to labels (k), scores (k) and boxes (k, 4) [px].
        size: width and height of the picture [px].
        latency: delay from picture to boxes [ticks], at least 1.
        h: tick [s].

    Raises:
        InputError: in flight, if a picture has another size.
    """

    def __init__(self, detect: Callable[[np.ndarray], Boxes], size: tuple[int, int], latency: int, h: float):
        super().__init__()
        self.set_name("detector")
        self._detect, self._size = detect, size
        self._image = self.DeclareAbstractInputPort("image", Value(ImageRgba8U()))
        self._shutter = self.DeclareVectorInputPort("shutter", SHUTTER_SIZE)
        self._pipeline = self.DeclareDiscreteState(latency * DETECTIONS_SIZE)
        self.DeclarePeriodicDiscreteUpdateEvent(h, 0.0, self._update)
        self.DeclareVectorOutputPort(
            "detections", DETECTIONS_SIZE, self._calc_detections, prerequisites_of_calc={self.xd_ticket()}
        )

    def _update(self, context: Context, discrete_state: DiscreteValues) -> None:
        pipeline = discrete_state.get_mutable_value(self._pipeline)
        pipeline[:-DETECTIONS_SIZE] = pipeline[DETECTIONS_SIZE:].copy()
        shutter = self._shutter.Eval(context)
        if shutter[ARRIVED] != 1.0:
            pipeline[-DETECTIONS_SIZE:] = 0.0
            return
        image = self._image.Eval(context)
        if (image.width(), image.height()) != self._size:
            width, height = self._size
            raise InputError(f"image: {image.width()} x {image.height()}: the detector expects {width} x {height}")
        pipeline[-DETECTIONS_SIZE:] = detections_message(shutter[STAMP], *self._detect(image.data[..., :3]))

    def _calc_detections(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(context.get_discrete_state(self._pipeline).value()[:DETECTIONS_SIZE])
