"""Time the tight filter's kernels: an inertial sample, a step with twelve ranges, a picture's boxes.

    python benchmarks/bench_tight.py [--smoke]

Each figure is the least mean of processor time over some rounds of calls from Python, so it has numba's dispatch of
about 2 us in it; the inertial sample is timed within a tick of eight, as it flies.
"""

import argparse
import time
from collections.abc import Callable

import numpy as np

from ortilo_drake.onboard.estimator.tight.inertial import quaternion_of
from ortilo_drake.onboard.estimator.tight.layout import Q, nominal_size
from ortilo_drake.onboard.estimator.tight.model import aids_of, initial_covariance, layout_of, motion_of
from ortilo_drake.onboard.estimator.tight.ranges import take_ranges
from ortilo_drake.onboard.estimator.tight.tick import N_KEPT, QUIET, keep_pose, propagate_to_now
from ortilo_drake.scenario import load_scenario
from ortilo_drake.sensors.described import described


def least_us(call: Callable[[], object], rounds: int, calls: int) -> float:
    """Return the least mean time of a call over the rounds [us]."""
    call()
    means = []
    for _ in range(rounds):
        started = time.process_time()
        for _ in range(calls):
            call()
        means.append((time.process_time() - started) / calls)
    return 1e6 * min(means)


def timed(name: str, rounds: int, calls: int) -> str:
    """Return the line of a scenario."""
    scenario = load_scenario(name)
    settings, room = scenario.estimator, scenario.load_room()
    layout = layout_of(settings, room, [described(name).measures for name in scenario.sensors], scenario.h)
    motion = motion_of(settings, layout, scenario)
    C_0, anchors = initial_covariance(settings, layout), np.ascontiguousarray(room.anchor_positions)
    x, C, kept = np.zeros(nominal_size(layout)), C_0.copy(), np.zeros(N_KEPT)
    x[0:3], x[Q : Q + 4], kept[5] = [5.0, 1.0, 1.5], quaternion_of(np.zeros(3)), 9.81
    for _ in range(layout.clones):
        keep_pose(x, C, layout)
    n = scenario.samples("imu")
    samples, message = np.zeros((n, 11)), np.zeros(2 + 2 * len(anchors))
    samples[:, 0], samples[:, 10] = 1.0, 9.81
    samples[:, 1] = scenario.h * np.arange(1, n + 1) / n
    message[2 : 2 + len(anchors)] = np.linalg.norm(x[0:3] - anchors, axis=1)
    message[2 + len(anchors) :] = 1.0
    samples[:, 5] = 1e-9 * np.arange(n)  # no two alike: the watch listens to no repeated sample
    residual = np.empty(3)
    aids = aids_of(settings, room, scenario)._replace(
        lever=np.zeros(3), range_noise=np.array([0.0, 0.0075]), differences=False, gates=np.full(3, 1e9), huber=3.0
    )

    def tick(samples: np.ndarray) -> None:
        kept[6], kept[QUIET] = 0.0, np.nan
        propagate_to_now(x, C, kept, samples, scenario.h, motion, residual)

    def ranges() -> None:
        take_ranges(x, C, layout, message, aids, -1)

    whole, one = least_us(lambda: tick(samples), rounds, calls), least_us(lambda: tick(samples[-1:]), rounds, calls)
    taken = least_us(ranges, rounds, calls)
    kept_us = least_us(lambda: keep_pose(x, C, layout), rounds, calls)
    sample = (whole - one) / (n - 1)
    return (
        f"{name:20} {layout.n:4} states: inertial sample {sample:5.2f} us, tick of {n} {whole:6.1f} us, "
        f"twelve ranges {taken:6.1f} us, step {whole + taken + kept_us:6.1f} us"
    )


def main() -> None:
    """Print a line for each scenario."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--smoke", action="store_true", help="few rounds, to see that it runs")
    rounds, calls = (2, 20) if parser.parse_args().smoke else (30, 200)
    for name in ("tight_imu_uwb", "tight_imu_uwb_yolo", "realistic_tight"):
        print(timed(name, rounds, calls))


if __name__ == "__main__":
    main()
