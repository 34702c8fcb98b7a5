"""Calibration: detection rates and errors of the rendered camera and its detector, measured on flights.

The projected camera draws from these rates and errors. They depend only on the projected camera's view of a landmark
(world/sensors/landmark_view.py). All other influences (light, background, furniture in front) count as chance.
"""

import hashlib
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ortilo_drake.flight.files import write_text
from ortilo_drake.flight.players import choose, flown_by, player_of
from ortilo_drake.model.typed_yaml import InputError, validate
from ortilo_drake.onboard.detector.detector_network import OWN_ONNX, load_detector
from ortilo_drake.scenario import Detector, load_scenario
from ortilo_drake.training.calibration.measured_errors import box_errors, detection_rates, persistence
from ortilo_drake.training.calibration.sightings import Sightings, detect_in_flight, sightings
from ortilo_drake.world.sensors.camera_calibration import CameraCalibration

SCENARIO, GIVEN_ERRORS = "nominal_imu_uwb_yolo", ("camera.kind=projected", "camera.errors.kind=parametric")
OWN_DETECTOR = Detector()
LEAST_FOUND = 500  # least number of found landmarks for a calibration
HEADER = """\
# What was measured of the rendered camera and our own detector, for the projected camera: ortilo detector calibrate.
# The meaning of each table is told in world/sensors/camera_calibration.py; lengths in m and px, times in s.
"""


def false_boxes(s: Sightings, classes: tuple[str, ...]) -> dict[str, Any]:
    """Return the fields of FalseBoxes: mean number per picture, shares of the classes, quantiles of the sides [px]."""
    if not len(s.false):
        return {"mean": 0.0, "classes": {}, "width": [10.0, 20.0], "height": [10.0, 20.0]}
    box, steps = s.false[:, 3:], np.linspace(0.0, 1.0, 6)
    sides = box[:, 2:] - box[:, :2]
    return {
        "mean": min(len(s.false) / s.pictures, 5.0),
        "classes": {name: float(np.mean(s.false[:, 2] == c)) for c, name in enumerate(classes)},
        "width": np.maximum(np.quantile(sides[:, 0], steps), 0.5),
        "height": np.maximum(np.quantile(sides[:, 1], steps), 0.5),
    }


def _plain(value: Any) -> Any:
    """Return data with all numbers rounded to four digits, and with lists in place of arrays."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | list | tuple):
        return [_plain(item) for item in value]
    return float(f"{value:.4g}") if isinstance(value, float | np.floating) else value


def estimate(
    s: Sightings, classes: tuple[str, ...], size: tuple[int, int], interval: float, source: dict[str, Any]
) -> CameraCalibration:
    """Return the calibration estimated from sightings in pictures that are an interval [s] apart.

    `classes` are the classes of the room, `size` is the image's width and height [px], `source` has the fields of
    Source. InputError if too few landmarks were found.
    """
    if s.found.sum() < LEAST_FOUND:
        raise InputError(f"seeds: {int(s.found.sum())} landmarks found, fewer than {LEAST_FOUND}: fly more")
    found, rate = detection_rates(s, classes)
    errors, scores = box_errors(s, size)
    data = {
        "source": source,
        "found": found,
        "errors": errors,
        **persistence(s, rate, scores, interval),
        "false_boxes": false_boxes(s, classes),
    }
    return validate(CameraCalibration, _plain(data), "calibration")


def calibrate(
    seeds: Iterable[int],
    out: Path,
    progress: Callable[[int, int], None] | None = None,
    detector: Detector = OWN_DETECTOR,
) -> CameraCalibration:
    """Fly, render every picture, run a detector on each, and write the measured calibration to the file `out`.

    Each seed gives a flight of the camera scenario, with fixed camera errors: so a calibration does not depend on the
    previous one, and the vehicle's path hardly depends on the camera. The default detector is our own. `progress` is
    called with the number of pictures done and of all pictures. InputError if there is no EGL, a file of the detector
    is wrong, too few landmarks are found, or the file cannot be written.
    """
    seeds = list(seeds)
    if not seeds:
        raise InputError("seeds: none given")
    scenario = load_scenario(SCENARIO, GIVEN_ERRORS)
    room, every, width = scenario.load_room(), scenario.every("camera"), scenario.camera.width
    camera = room.camera.scaled_to(width)
    size = camera.width, camera.height
    detect = load_detector(detector, room, size)
    player = player_of(scenario)
    states = [player.fly(seed)["truth"].values[::every] for seed in seeds]
    total, done = sum(map(len, states)), 0

    def count() -> None:
        nonlocal done
        done += 1
        if progress:
            progress(done, total)

    s = sightings(room, width, [(x, detect_in_flight(room, width, x, detect, count)) for x in states])
    network = Path(detector.weights or detector.onnx or OWN_ONNX).read_bytes()
    source = {
        "scenario": SCENARIO,
        "seeds": seeds,
        "flown_by": flown_by([scenario], [choose(scenario)]),
        "pictures": s.pictures,
        "landmarks_found": int(s.found.sum()),
        "detector": f"sha256 {hashlib.sha256(network).hexdigest()[:16]}",
        "width": width,
    }
    calibration = estimate(s, room.classes, size, every * scenario.h, source)
    write_calibration(calibration, out)
    return calibration


def write_calibration(calibration: CameraCalibration, out: Path) -> None:
    """Write a calibration to a YAML file."""
    text = yaml.safe_dump(calibration.model_dump(mode="json"), sort_keys=False, default_flow_style=None, width=120)
    write_text(out, HEADER + text)
