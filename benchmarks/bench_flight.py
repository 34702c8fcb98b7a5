"""The speed of flights and of the filter's step, as figures and ratios of one run.

    python benchmarks/bench_flight.py            # the figures of docs/benchmarks.md
    python benchmarks/bench_flight.py --smoke    # a quick look that everything still runs

Flights are timed as simulated seconds per second of AdvanceTo, logging included, on one core. The filter's step is
one masked, correlated step of 15 states with 6 of 9 rows there, called from Python, beside filterpy and beside plain
NumPy on the same numbers; each figure is the least of several rounds, in turn, so that a slow moment hits all alike.
Writing a log is given as a share of the time that its flight would last in real time (goal: below a twentieth).
"""

import argparse
import json
import os
import platform
import tempfile
import time
import timeit
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from filterpy.kalman import KalmanFilter as FilterpyFilter

from ortilo_drake.flight.flight import fly
from ortilo_drake.interop.log.logged_flight import fly_logged
from ortilo_drake.interop.log.reader import read_ticks
from ortilo_drake.interop.log.writer import LogWriter
from ortilo_drake.model.hover import discretize, disturbance_W, hover_A, hover_B, output_C
from ortilo_drake.model.measurement import make_measurement
from ortilo_drake.model.vehicle import M100
from ortilo_drake.onboard.estimator.intermittent_filter import INTEGRATOR_HOLD, FilterModel, filter_step
from ortilo_drake.scenario import load_scenario, with_seed

H = 1.0 / 30.0
MEASUREMENT = make_measurement()
DELTA = np.array([1.0, 0.0, 1.0])  # uwb and imu there, the camera not


SCENARIOS = ("nominal_imu_uwb", "imu_uwb", "nominal_imu_uwb_yolo", "imu_uwb_yolo")


def flight_speeds(flights: int) -> dict[str, list[float]]:
    """Return the real-time factors of that many flights of each scenario, flown in turn."""
    chosen = [load_scenario(name, ("camera.kind=projected",)) for name in SCENARIOS]  # rendered: bench_camera.py
    speeds: dict[str, list[float]] = {name: [] for name in SCENARIOS}
    for seed in range(flights):
        for scenario in chosen:
            speeds[scenario.name].append(float(fly(with_seed(scenario, seed)).attrs["real_time_factor"]))
    return speeds


def numba_step() -> object:
    """Return a call of the package's filter step."""
    Phi, Gamma = discretize(hover_A(), hover_B(M100), H)
    W = disturbance_W(M100, H, 0.27, 0.005)
    V2 = np.array([np.eye(3) * v for v in (0.01, 0.02, 1e-4)])
    measured = np.zeros(9), DELTA, V2.ravel()
    belief = np.concatenate((np.zeros(15), np.diag([0.01] * 12 + [0.0] * 3).ravel()))
    u, r = np.zeros(4), np.zeros(3)
    model = FilterModel.of(Phi, Gamma, W, INTEGRATOR_HOLD)
    return lambda: filter_step(belief, *measured, u, r, model, MEASUREMENT.layout)


def numpy_step() -> object:
    """Return a call of the paper's equations in plain NumPy, at full size with the rows masked."""
    Phi, Gamma = discretize(hover_A(), hover_B(M100), H)
    C, W = output_C(), disturbance_W(M100, H, 0.27, 0.005)
    V2 = np.diag(np.repeat([0.01, 0.02, 1e-4], 3))
    x, P, y, u, r = np.zeros(15), np.diag([0.01] * 12 + [0.0] * 3), np.zeros(9), np.zeros(4), np.zeros(3)

    def step() -> tuple[np.ndarray, np.ndarray]:
        E = MEASUREMENT.selection_matrix(DELTA)
        Phibar = np.block([[Phi, np.zeros((12, 3))], [-E @ C, np.eye(3)]])
        HC = np.hstack([MEASUREMENT.arrival_matrix(DELTA) @ C, np.zeros((9, 3))])
        EV12 = np.vstack([np.zeros((12, 9)), -E @ V2])
        K = np.linalg.solve((HC @ P @ HC.T + V2).T, (Phibar @ P @ HC.T + EV12).T).T
        F, G = Phibar - K @ HC, K + np.vstack([np.zeros((12, 9)), E])
        P_next = F @ P @ F.T + G @ V2 @ G.T
        P_next[:12, :12] += W
        x_next = Phibar @ x + K @ (y - HC @ x)
        x_next[:12] += Gamma @ u
        x_next[12:] += r
        return x_next, P_next

    return step


def filterpy_step() -> object:
    """Return a call of filterpy's predict and update, 15 states, 9 rows, no cross-covariance."""
    kf = FilterpyFilter(dim_x=15, dim_z=9)
    kf.F[:12, :12] = discretize(hover_A(), hover_B(M100), H)[0]
    kf.H = np.hstack([MEASUREMENT.arrival_matrix(DELTA) @ output_C(), np.zeros((9, 3))])
    kf.Q[:12, :12] = disturbance_W(M100, H, 0.27, 0.005)
    kf.R = np.diag(np.repeat([0.01, 0.02, 1e-4], 3))
    z = np.zeros(9)

    def step() -> None:
        kf.predict()
        kf.update(z)

    return step


def log_share(rounds: int) -> float:
    """Return the time that writing all but pictures to a log takes, over the time flown; the least of the rounds."""
    scenario = load_scenario(
        "nominal_imu_uwb_yolo", ("camera.kind=projected", "settle=0", "planner={kind: hover, duration: 3}")
    )
    shares = []
    with tempfile.TemporaryDirectory() as folder:
        fly_logged(scenario, Path(folder) / "flown")
        sent = list(read_ticks(Path(folder) / "flown"))
        for k in range(rounds):
            with LogWriter(Path(folder) / f"{k}", scenario) as log:
                started = time.process_time()
                for tick in sent:
                    log.write_tick(*tick)
                shares.append((time.process_time() - started) / (len(sent) * scenario.h))
    return min(shares)


def step_times(rounds: int, calls: int) -> dict[str, float]:
    """Return microseconds a step, the least of the rounds."""
    steps = {"ortilo_drake": numba_step(), "numpy": numpy_step(), "filterpy": filterpy_step()}
    times: dict[str, list[float]] = {name: [] for name in steps}
    for step in steps.values():
        step()
    for _ in range(rounds):
        for name, step in steps.items():
            times[name].append(timeit.timeit(step, number=calls) / calls * 1e6)
    return {name: min(values) for name, values in times.items()}


def main() -> None:
    """Print the figures as JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--smoke", action="store_true", help="few flights, few rounds")
    smoke = parser.parse_args().smoke
    flights, rounds, calls = (1, 2, 200) if smoke else (7, 9, 3000)
    speeds = flight_speeds(flights)
    step = step_times(rounds, calls)
    print(
        json.dumps(
            {
                "python": platform.python_version(),
                "simulated_s_per_s": {
                    n: {"median": round(float(np.median(v))), "max": round(max(v))} for n, v in speeds.items()
                },
                "speed_over_nominal": {
                    n: round(max(speeds[n]) / max(speeds[f"nominal_{n}"]), 2) for n in ("imu_uwb", "imu_uwb_yolo")
                },
                "log_writing_share": round(log_share(rounds), 4),
                "filter_step_us": {name: round(value, 2) for name, value in step.items()},
                "filter_step_ratio": {n: round(step[n] / step["ortilo_drake"], 1) for n in ("numpy", "filterpy")},
            },
            indent=2,
        )
    )


if __name__ == "__main__":
    main()
