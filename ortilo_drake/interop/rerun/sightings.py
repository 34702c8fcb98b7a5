"""Pictures, boxes detected in them, and ranges to anchors, which the Dataset of a flight does not keep.

During a flight they are recorded from the messages between the halves, as for a log (SightingsRecorder.record). After a
flight the pictures can be drawn again from the true states (drawn_again).
"""

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import xarray as xr

from ortilo_drake.flight.flight import scenario_of
from ortilo_drake.flight.signals import Signals
from ortilo_drake.model.optional import later
from ortilo_drake.model.range_pairs import AGE, ROW, THERE, VALUE, A, B
from ortilo_drake.model.signals import ARRIVED, DETECTION_SIZE, PAYLOAD, STAMP
from ortilo_drake.onboard.detector.detector import detections_message
from ortilo_drake.onboard.detector.detector_network import load_detector
from ortilo_drake.scenario import Scenario
from ortilo_drake.sensors.described import measuring

cv2 = later("cv2")

QUALITY = 85  # JPEG quality [%]

CameraView = Callable[[float, np.ndarray], tuple[np.ndarray, np.ndarray]]


@dataclass
class Sightings:
    """All sightings of a flight in the order of arrival, each as (time at which it was true [s], sighting)."""

    pictures: list[tuple[float, bytes]] = field(default_factory=list)
    """pictures as JPEG."""
    boxes: list[tuple[float, np.ndarray]] = field(default_factory=list)
    """boxes detected in a picture (k, 6), with rows (label, score, u_min, v_min, u_max, v_max) [px]."""
    ranges: defaultdict[str, list[tuple[float, float]]] = field(default_factory=lambda: defaultdict(list))
    """received ranges and differences of ranges [m], by their path in a recording."""


def encode_jpeg(picture: np.ndarray) -> bytes:
    """Return a picture (height, width, 3), uint8, in the order blue, green, red, as JPEG."""
    _, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    return data.tobytes()


def _found(message: np.ndarray) -> tuple[float, np.ndarray]:
    rows = message[PAYLOAD:].reshape(-1, DETECTION_SIZE)
    return float(message[STAMP]), rows[rows[:, 0] >= 0]


class SightingsRecorder:
    """A recorder of sightings while a scenario flies; pass its `record` to flight.lockstep.fly_lockstep.

    A rendered camera's boxes are found onboard, so they do not cross between the halves. This recorder runs the
    detector again and finds the same boxes. InputError if a file of the scenario's detector is wrong.
    """

    def __init__(self, scenario: Scenario):
        self.sightings = Sightings()
        self._uwb = scenario.uwb.kind
        if scenario.is_rendered:
            room = scenario.load_room()
            camera = room.camera.scaled_to(scenario.image_width)
            self._detect = load_detector(scenario.detector, room, (camera.width, camera.height))

    def record(self, k: int, state: np.ndarray | None, messages: Signals, outputs: Signals) -> None:
        """Record the sightings in the messages of a tick; this is a flight.signals.Record."""
        seen = self.sightings
        if "image" in messages:
            stamp, rgb = float(messages["shutter"][STAMP]), np.ascontiguousarray(messages["image"][..., :3])
            seen.pictures.append((stamp, encode_jpeg(rgb[..., ::-1])))
            seen.boxes.append(_found(detections_message(stamp, *self._detect(rgb))))
        if "detections" in messages and messages["detections"][ARRIVED] == 1.0:
            seen.boxes.append(_found(messages["detections"]))
        uwb = messages.get(measuring("anchors"))
        if uwb is None or uwb[ARRIVED] != 1.0:
            return
        stamp = float(uwb[STAMP])
        if self._uwb == "ranges":
            values, there = uwb[PAYLOAD:].reshape(2, -1)
            for i in np.flatnonzero(there):
                seen.ranges[f"ranges/anchor_{i}"].append((stamp, float(values[i])))
        elif self._uwb == "differences":
            for row in uwb[PAYLOAD:].reshape(-1, ROW):
                if row[THERE] > 0:
                    path = f"differences/anchor_{int(row[B])}_less_anchor_{int(row[A])}"
                    seen.ranges[path].append((stamp - float(row[AGE]), float(row[VALUE])))


def drawn_again(flight: xr.Dataset, make_view: Callable[[Scenario], CameraView]) -> Sightings:
    """Return the pictures and boxes of a finished flight, drawn again from its true states.

    Each due picture of a rendered camera is drawn, also if it did not arrive. There are no ranges: a flight keeps none.
    InputError if there is no EGL or a file of the scenario's detector is wrong.
    """
    scenario, seen = scenario_of(flight), Sightings()
    if not scenario.is_rendered:
        return seen
    view = make_view(scenario)
    (camera,) = (sensor for sensor in scenario.sensors if scenario.is_picture(sensor))
    for time, x in zip(flight["time"].values, flight["truth"].values, strict=True):
        k = round(time * scenario.control_rate)
        if k % scenario.every(camera) == 0 and np.isfinite(x).all():
            picture, rows = view(float(time), x)
            seen.pictures.append((float(time), encode_jpeg(picture)))
            seen.boxes.append((float(time), rows))
    return seen
