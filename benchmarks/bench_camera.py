"""Times of a rendered camera: a picture, its boxes, the fix; and the speed of such a flight.

    python benchmarks/bench_camera.py            # the figures of docs/results.md
    python benchmarks/bench_camera.py --smoke    # a quick look that everything still runs

Times are medians over poses along the planned path, in ms, on one core but for Mesa's renderer, which takes what it
gets.
"""

import argparse
import importlib.util
import json
import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from pydrake.systems.analysis import Simulator

from ortilo_drake.diagrams.rendered_camera import make_rendered_camera
from ortilo_drake.flight.flight import fly
from ortilo_drake.model.signals import N_X, N_XBAR
from ortilo_drake.onboard.detector.detector import detections_message
from ortilo_drake.onboard.detector.detector_network import load_detector
from ortilo_drake.onboard.landmarks.landmark_fix import LandmarkFix
from ortilo_drake.onboard.planner.planner import plan
from ortilo_drake.scenario import Detector, load_scenario

BACKENDS = ("onnxruntime", "opencv", "torch")


def states(count: int) -> np.ndarray:
    """Return states (count, 12) of a vehicle that hovers along the planned path."""
    scenario = load_scenario("nominal_imu_uwb_yolo")
    trajectory = plan(scenario.planner, scenario.load_room(), scenario.vehicle)
    x = np.zeros((count, N_X))
    for row, t in zip(x, np.linspace(trajectory.start_time(), trajectory.end_time(), count), strict=True):
        row[0:3] = trajectory.value(t)[:, 0]
    return x


def installed(backend: str) -> bool:
    """Return whether a backend's package is there; OpenCV's always is."""
    return backend == "opencv" or importlib.util.find_spec(backend) is not None


def median_ms(call: Callable[[Any], object], arguments: list[Any]) -> float:
    """Return the median time of a call, after one to warm up."""
    call(arguments[0])
    times = []
    for argument in arguments:
        started = time.perf_counter()
        call(argument)
        times.append(time.perf_counter() - started)
    return round(1e3 * float(np.median(times)), 3)


def camera_times(count: int, width: int) -> dict[str, float]:
    """Return the times of colour, depth and label pictures, of detection by each backend, and of the fix."""
    scenario = load_scenario("nominal_imu_uwb_yolo", (f"camera.width={width}",))
    room = scenario.load_room()
    camera = make_rendered_camera(room, width)
    context = Simulator(camera).get_mutable_context()

    def draw(port: str) -> Callable[[np.ndarray], Any]:
        def call(x: np.ndarray) -> Any:
            camera.GetInputPort("state").FixValue(context, x)
            return camera.GetOutputPort(port).Eval(context)

        return call

    poses = list(states(count))
    times = {f"render_{port}": median_ms(draw(port), poses) for port in ("color_image", "depth_image", "label_image")}
    pictures = [draw("color_image")(x).data[..., :3].copy() for x in poses]
    size = pictures[0].shape[1], pictures[0].shape[0]
    cv2.setNumThreads(1)
    for backend in filter(installed, BACKENDS):
        times[f"detect_{backend}"] = median_ms(load_detector(Detector(backend=backend), room, size), pictures)
    detect = load_detector(Detector(), room, size)
    fix = LandmarkFix(scenario.landmark_fix, room, width, scenario.h)
    fix_context = fix.CreateDefaultContext()
    P = np.diag([0.01] * 3 + [1e-4] * 3 + [0.01] * 6 + [0.0] * 3).ravel()

    def locate(pair: tuple[np.ndarray, np.ndarray]) -> object:
        message, x = pair
        fix.GetInputPort("detections").FixValue(fix_context, message)
        fix.GetInputPort("estimate").FixValue(fix_context, np.concatenate([x, np.zeros(N_XBAR - N_X)]))
        fix.GetInputPort("covariance").FixValue(fix_context, P)
        return fix.get_output_port().Eval(fix_context)

    messages = [detections_message(0.0, *detect(picture)) for picture in pictures]
    times["landmark_fix"] = median_ms(locate, list(zip(messages, poses, strict=True)))
    return times


def main() -> None:
    """Print the figures as JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--smoke", action="store_true", help="few pictures, a short flight")
    smoke = parser.parse_args().smoke
    short = ("planner={kind: hover, point: [3, 1.9, 1.5], duration: 3}",) if smoke else ()
    flight = fly(load_scenario("nominal_imu_uwb_yolo", ("camera.kind=rendered", *short), seed=0))
    result = {
        "ms": {
            f"{width}x{width * 3 // 4}": camera_times(5 if smoke else 60, width) for width in (320, 640)[: 2 - smoke]
        },
        "simulated_s_per_s": round(float(flight.attrs["real_time_factor"]), 2),
    }
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
