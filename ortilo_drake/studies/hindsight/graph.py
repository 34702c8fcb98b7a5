"""A flight's batch factor graph: every pose, velocity and bias by all ranges, boxes and samples of the imu at once.

The variables are the pose X_k, the velocity V_k and the imu's biases B_k of every tick, and the sensors' lasting
errors. The factors are the prior of the start, the preintegrated imu between two ticks, its angles, each range or
difference of ranges and each box's centre at its stamp, and rows of other sensors. Levenberg and Marquardt's method
begins at the estimates of the flight's own filter (Dellaert and Kaess, "Factor graphs for robot perception",
Foundations and Trends in Robotics 6, 2017).

The onboard half's association assigns boxes to landmarks: first about the filter's estimates, and then, in a second
graph, about the first graph's estimates.
"""

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, V, X
from scipy.stats import chi2

from ortilo_drake.model.pinhole import extent_box
from ortilo_drake.model.range_pairs import AGE, ROW, THERE, VALUE, A
from ortilo_drake.model.range_pairs import B as ANCHOR_B
from ortilo_drake.model.signals import ARRIVED, N_X, N_XBAR, PAYLOAD, SENSORS, STAMP
from ortilo_drake.model.white_noise import USUAL_ROOT, white_sd
from ortilo_drake.onboard.estimator.at_rest import rest_of
from ortilo_drake.onboard.estimator.tight.attitude_rows import inverse_rate_matrix
from ortilo_drake.onboard.estimator.tight.inertial import matrix_of, quaternion_of
from ortilo_drake.onboard.estimator.tight.layout import ACCEL, GYRO, make_layout
from ortilo_drake.onboard.estimator.tight.model import initial_covariance, sample_sds
from ortilo_drake.onboard.estimator.tight.ranges import CLOCK_SD, MIN_SD
from ortilo_drake.onboard.landmarks.landmark_association import associate, center_sd
from ortilo_drake.scenario import Belief
from ortilo_drake.scenario.tight import InertialNoise, TightFilter, TightRanges
from ortilo_drake.sensors.described import measuring
from ortilo_drake.studies.hindsight.factors import (
    Moving,
    Process,
    Reach,
    angles_factor,
    box_factor,
    numbered,
    ranges_factor,
    rows_factor,
    rpy_of,
    weighted,
)
from ortilo_drake.studies.hindsight.inertial_factors import inertial_ticks, samples_of
from ortilo_drake.studies.hindsight.recorded_flight import RecordedFlight
from ortilo_drake.studies.hindsight.rts import Smoothed
from ortilo_drake.studies.hindsight.solver import eliminated, minimum


class FlightGraph:
    """The factor graph of a flight, and the first values of its variables.

    The first values are the estimates `about` (n, 12 or more), which also serve to associate boxes with landmarks.
    """

    def __init__(self, recorded: RecordedFlight, about: Smoothed):
        self._recorded, self._about = recorded, about
        self._scenario = recorded.scenario.belief
        self._settings = believed(self._scenario)
        self._n, self._h = recorded.flight.sizes["tick"], self._scenario.h
        self._room = self._scenario.load_room()
        self.graph, self.values, self._keys = gtsam.NonlinearFactorGraph(), gtsam.Values(), numbered()
        self._add_start()
        self._w = self._add_imu()
        if self._scenario.measures_ranges:
            self._add_ranges()
        if self._scenario.sees_landmarks:
            self._add_boxes()
        self._add_rows()

    def _bias(self, k: int) -> int:
        """Return the key of the biases at a tick: one key for all ticks if the biases do not walk."""
        imu = self._settings.imu
        return int(B(k if imu.gyroscope_rate > 0.0 or imu.accelerometer_rate > 0.0 else 0))

    def _process(self, sd: float | np.ndarray, rate: float = 0.0, time: float | None = None, size: int = 1) -> Process:
        return Process(self.graph, self.values, self._keys, np.broadcast_to(sd, size).astype(float), rate, time)

    def _add_start(self) -> None:
        """Add the variables of all ticks, and the priors of the first tick's variables."""
        for k in range(self._n):
            x = self._about.x[k]
            pose = gtsam.Pose3(gtsam.Rot3(matrix_of(quaternion_of(x[3:6]))), x[0:3])
            self.values.insert(X(k), pose)
            self.values.insert(V(k), x[6:9])
            if not self.values.exists(self._bias(k)):
                self.values.insert(self._bias(k), gtsam.imuBias.ConstantBias())
        x_0, imu = self._recorded.flight["estimate"].values[0], self._settings.imu
        start = gtsam.Pose3(gtsam.Rot3(matrix_of(quaternion_of(x_0[3:6]))), x_0[0:3])
        p_sd, angle_sd, v_sd = self._settings.initial_sd
        self.graph.add(gtsam.PriorFactorPose3(X(0), start, weighted(np.repeat([angle_sd, p_sd], 3), np.inf)))
        self.graph.add(gtsam.PriorFactorVector(V(0), x_0[6:9], weighted(np.full(3, v_sd), np.inf)))
        sds = np.repeat([imu.accelerometer_sd, imu.gyroscope_sd], 3)
        if (rest := rest_of(self._scenario)) is not None:  # the level error's effect on the biases counts as a part
            layout = make_layout({"angles": 3}, 0)
            noise = sample_sds(self._settings, self._scenario.imu_samples, self._h)
            sds = np.sqrt(np.diag(initial_covariance(self._settings, layout, rest, noise)))
            sds = np.concatenate((sds[ACCEL : ACCEL + 3], sds[GYRO : GYRO + 3]))
        no_bias = gtsam.imuBias.ConstantBias()
        self.graph.add(gtsam.PriorFactorConstantBias(self._bias(0), no_bias, weighted(sds, np.inf)))

    def _add_imu(self) -> np.ndarray:
        """Add the imu's factors; return the body rates of each tick (n, 3) [rad/s]."""
        imu, n, h = self._settings.imu, self._scenario.imu_samples, self._h
        measurement = self._scenario.measurement
        samples = samples_of(self._recorded.messages, measurement.sensors[measurement.inertial], n)
        ticks = inertial_ticks(samples, self._n, h, n, sample_sds(self._settings, n, h), imu)
        steps = np.sqrt(h) * np.repeat([imu.accelerometer_rate, imu.gyroscope_rate], 3)
        lasting = np.array([imu.level_sd, imu.level_sd, imu.yaw_sd])
        errors = self._process(lasting, imu.angles_rate, size=3) if lasting.any() else None
        w = np.zeros((self._n, 3))
        for k, tick in enumerate(ticks):
            if tick is None:
                continue
            w[k] = tick.w
            before, now = self._bias(k - 1), self._bias(k)
            self.graph.add(gtsam.ImuFactor(X(k - 1), V(k - 1), X(k), V(k), before, tick.motion))
            if now != before:
                no_step = gtsam.imuBias.ConstantBias()
                self.graph.add(gtsam.BetweenFactorConstantBias(before, now, no_step, weighted(steps, np.inf)))
            if tick.rpy is not None and imu.angle_density is not None:
                sd = white_sd(imu.angle_density, self._scenario.imu_period) / np.sqrt(tick.samples)
                noise = weighted(np.full(3, sd), self._settings.huber)
                self.graph.add(angles_factor(X(k), errors.at(k * h) if errors else None, tick.rpy, noise))
        return w

    def _messages(self, name: str) -> list[tuple[int, np.ndarray]]:
        """Return a port's messages with the ticks of their stamps, in the order of the ticks."""
        found = [its[name] for its in self._recorded.messages if name in its]
        there = [message for message in found if message[ARRIVED] == 1.0 and np.isfinite(message).all()]
        stamped = [(round(message[STAMP] / self._h), message) for message in there]
        return sorted([(k, m) for k, m in stamped if 0 <= k < self._n], key=lambda its: its[0])

    def _add_ranges(self) -> None:
        ranges, huber = self._settings.ranges, self._settings.huber
        anchors = np.ascontiguousarray(self._room.anchor_positions, dtype=float)
        lever, n = np.array(ranges.lever), len(anchors)
        noise = ranges.noise.sds
        lasting = [self._process(ranges.bias_sd, ranges.bias_rate) for _ in range(n)] if ranges.bias_sd else []
        slow = [self._process(ranges.slow_sd, time=ranges.slow_time) for _ in range(n)] if ranges.slow_sd else []
        clock = self._process(ranges.clock_sd) if ranges.clock_sd else None
        for k, message in self._messages(measuring("anchors")):
            t = k * self._h
            tau = None if clock is None else clock.at(t)
            if self._scenario.uwb.kind == "differences":
                of_anchor = [tuple(its[i].at(t) for its in (lasting, slow) if its) for i in range(n)]
                self._add_differences(k, message, anchors, of_anchor, tau)
                continue
            common = (self._process(CLOCK_SD).at(t),) if ranges.differences else ()
            for i in np.flatnonzero(message[PAYLOAD + n : PAYLOAD + 2 * n]):
                r = float(message[PAYLOAD + i])
                errors = tuple(its[i].at(t) for its in (lasting, slow) if its) + common
                sd = max(noise[0] + noise[1] * r, MIN_SD)
                reach, v = Reach(1.0, anchors[i], errors), None if tau is None else V(k)
                its = weighted(np.array([sd]), huber)
                self.graph.add(ranges_factor(X(k), v, tau, (reach,), r, 0.0, lever, its))

    def _add_differences(
        self, k: int, message: np.ndarray, anchors: np.ndarray, errors: list[tuple[int, ...]], clock: int | None
    ) -> None:
        """Add the differences of a message stamped at tick k; errors, clock: keys of anchor errors and the clock."""
        ranges, about = self._settings.ranges, self._about.x[k, :3]
        sds = ranges.noise.sds[0] + ranges.noise.sds[1] * np.linalg.norm(anchors - about, axis=1)
        for row in message[PAYLOAD:].reshape(-1, ROW):
            pair = [int(row[A]), int(row[ANCHOR_B])]
            if row[THERE] == 0.0 or pair[0] == pair[1] or min(pair) < 0 or max(pair) >= len(anchors):
                continue  # a log may hold anything: such rows are left out, as in the tight filter
            noise = weighted(np.array([max(np.linalg.norm(sds[pair]), MIN_SD)]), self._settings.huber)
            both = tuple(Reach(sign, anchors[i], errors[i]) for sign, i in zip((-1.0, 1.0), pair, strict=True))
            packet, lever = (float(row[VALUE]), float(row[AGE])), np.array(self._settings.ranges.lever)
            self.graph.add(ranges_factor(X(k), V(k), clock, both, *packet, lever, noise))

    def _add_boxes(self) -> None:
        pixels, fix, huber = self._settings.pixels, self._scenario.landmark_fix, self._settings.huber
        room = self._room.model_copy(update={"landmark_outline": {}}) if fix.shapes == "boxes" else self._room
        camera = room.camera.scaled_to(self._scenario.image_width).constants
        positions, outlines = room.landmark_positions, room.landmark_outlines
        n = len(positions)
        survey = [self._process(pixels.survey_sd, size=3) for _ in range(n)] if pixels.survey_sd else []
        slow = [self._process(1.0, time=pixels.slow_time, size=2) for _ in range(n)] if pixels.slow_share else []
        clock = self._process(pixels.clock_sd) if pixels.clock_sd else None
        gate, inside = float(chi2.ppf(fix.gate, 2)), -np.inf if fix.inside is None else fix.inside
        share, box = np.sqrt([pixels.slow_share, 1.0 - pixels.slow_share]), np.empty(4)
        for k, message in self._messages("detections"):
            x, P = self._about.x[k], np.zeros((N_XBAR, N_XBAR))
            P[:6, :6] = self._about.P[k, :6, :6]
            known = positions, outlines, room.landmark_labels, camera
            xhat = np.concatenate((x[:N_X], np.zeros(3)))
            noise = pixels.sd, gate, pixels.growth, fix.margin, inside
            chosen, centers, _ = associate(message, xhat, P.ravel(), *known, *noise)
            R = matrix_of(quaternion_of(x[3:6]))
            for i, center in zip(chosen, centers, strict=True):
                if not extent_box(positions[i], outlines[i], x[:3], R, camera, box):
                    continue
                sds = np.array([center_sd(box[2 + a] - box[a], pixels.sd, pixels.growth) for a in range(2)])
                self.graph.add(
                    box_factor(
                        X(k),
                        survey[i].at(k * self._h) if survey else None,
                        (slow[i].at(k * self._h), share[0] * sds) if slow else None,
                        Moving(V(k), clock.at(k * self._h), self._w[k]) if clock else None,
                        center,
                        positions[i],
                        outlines[i],
                        camera,
                        weighted(share[1] * sds, huber),
                    )
                )

    def _add_rows(self) -> None:
        """Add the values of sensors beside uwb, camera and imu, as the onboard half computed them from the messages."""
        flight, measurement = self._recorded.flight, self._scenario.measurement
        for name in (s for s in measurement.sensors if s not in SENSORS and s in self._scenario.sensors):
            C, m = measurement.C_of(name), len(measurement.C_of(name))
            y = flight["measurement"].values[:, measurement.rows_of(name)]
            Vs = flight["measurement_covariance"].sel(sensor=name).values[:, :m, :m]
            for k in np.flatnonzero(flight["arrival"].sel(sensor=name).values & np.isfinite(y).all(axis=1)):
                at = self._stamped(name, int(k))
                keys = X(at), V(at), self._bias(at)
                self.graph.add(rows_factor(*keys, self._w[at], y[k], C, Vs[k], self._settings.huber))

    def _stamped(self, name: str, k: int) -> int:
        """Return the tick of the stamp of a sensor's message in tick k; k if no message has the sensor's name."""
        message = self._recorded.messages[k].get(name)
        return k if message is None else min(max(round(message[STAMP] / self._h), 0), k)

    def solve(self) -> Smoothed:
        """Return [p_WB, rpy, v_WB, Euler rates] of each tick (n, 12), and their covariance (n, 12, 12).

        Only the covariance of position and angles is computed, for each tick separately; the rest is 0.
        """
        values = minimum(self.graph, self.values)
        marginals = eliminated(self.graph, values)
        out = Smoothed(np.zeros((self._n, N_X)), np.zeros((self._n, N_X, N_X)))
        for k in range(self._n):
            pose = values.atPose3(X(k))
            R = pose.rotation().matrix()
            rpy = rpy_of(R)
            E = inverse_rate_matrix(rpy)
            w = self._w[k] - values.atConstantBias(self._bias(k)).gyroscope()
            out.x[k] = np.concatenate((pose.translation(), rpy, values.atVector(V(k)), E @ w))
            T = np.zeros((6, 6))  # from GTSAM's tangent [theta, t] to [p, rpy]
            T[:3, 3:], T[3:, :3] = R, E
            out.P[k, :6, :6] = T @ marginals.marginalCovariance(X(k)) @ T.T
        return out


def graph_smoothed(recorded: RecordedFlight) -> Smoothed:
    """Return a flight's estimates by its factor graph; see FlightGraph.solve."""
    flight = recorded.flight
    about = Smoothed(flight["estimate"].values[:, :N_X], flight["covariance"].values[:, :N_X, :N_X])
    found = FlightGraph(recorded, about).solve()
    return FlightGraph(recorded, found).solve() if recorded.scenario.sees_landmarks else found


def believed(scenario: Belief) -> TightFilter:
    """Return the noise models of the sensors, as settings of the tight filter.

    If the scenario flies the paper's filter, or an estimator that declares this filter, the models are that filter's V,
    walks and biases, and its multilateration's noise of ranges; it has none for boxes, so the defaults hold. For
    another estimator, only the multilateration's noise is known. Gate and horizon are not read: late messages count at
    their stamps.
    """
    if isinstance(scenario.estimator, TightFilter):
        return scenario.estimator
    settings = scenario.linear_filter
    ranges = TightRanges(noise=scenario.multilateration.noise, bias_sd=scenario.multilateration.bias_sd)
    if settings is None:
        return TightFilter(kind="tight", ranges=ranges)
    V, walks, biases = settings.V, settings.walks, settings.biases
    imu = InertialNoise(
        rate_density=_density(V.rates),
        specific_force_density=_density(V.specific_force),
        angle_density=_density(V.imu),
        gyroscope_sd=walks.gyroscope_sd,
        gyroscope_rate=walks.gyroscope_rate,
        accelerometer_sd=walks.accelerometer_sd,
        accelerometer_rate=walks.accelerometer_rate,
        level_sd=biases.level_sd,
        yaw_sd=biases.yaw_sd,
    )
    return TightFilter(kind="tight", imu=imu, ranges=ranges, initial_sd=settings.initial_sd[:3])


def _density(variances: tuple[float, float, float]) -> float:
    """Return the mean noise density of three axes, from the variances (3) of a sample of the usual period."""
    return float(np.sqrt(np.mean(variances))) * USUAL_ROOT
