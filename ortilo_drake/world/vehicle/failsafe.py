"""The flight controller's own failsafe, which flies while the onboard computer is silent.

A command that is young enough passes. Otherwise the vehicle brakes to rest, level, at the altitude and yaw at which it
was left (hold), and after a while comes down to its landing height (descend), until a command comes again.

Gains follow from poles of the model linearised at hover (model/hover.py), each loop critically damped:

    horizontal  v_dot = g theta,  theta_ddot = 3 p^2 (theta_r - theta) - 3 p theta_dot,  theta_r = -p v / (3 g)
                has the characteristic polynomial s^3 + 3 p s^2 + 3 p^2 s + p^3 = (s + p)^3; the attitude's own loop has
                natural frequency sqrt(3) p and damping sqrt(3) / 2
    vertical    v_r = w_z (z_r - z) / 2,  z_ddot = 2 w_z (v_r - z_dot):  (s + w_z)^2
    yaw         psi_ddot = w_psi^2 (psi_r - psi) - 2 w_psi psi_dot:  (s + w_psi)^2

It is a P loop of velocity around a PD loop of attitude, with theta_r limited in size. A flight controller has sensors
of its own for this (attitude, velocity, height); they are taken as perfect: it reads the true state. It does not hold
the horizontal position. The plant has no floor: keeping the landing height stands in for resting on the floor.
"""

import numpy as np
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem, ValueProducer

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.signals import N_U, N_X
from ortilo_drake.model.vehicle import GRAVITY, Vehicle
from ortilo_drake.scenario.world import Failsafe as FailsafeSettings

COMMAND_SIZE = N_U + 1  # u, and the time at which it was received
MODES = ("command", "hold", "descend")
_COMMAND, _HOLD, _DESCEND = 0.0, 1.0, 2.0

_MODE, _SINCE, _Z, _PSI = range(4)  # the state: index in MODES; when, at which altitude and yaw the hold took over
_STATE_SIZE = 4


@cached_njit
def failsafe_state(
    t: float, s: np.ndarray, command: np.ndarray, x: np.ndarray, timeout: float, hold_for: float
) -> np.ndarray:
    """Return the failsafe's state (4) at time t [s], from its last state s, see Failsafe.

    command (5) is u and the time at which it was received [s], -inf if there was none yet. It counts as long as it is
    not older than the timeout [s]. The descent begins after a hold of hold_for [s]. x is the true state.
    """
    if t - command[N_U] <= timeout:
        return np.zeros(_STATE_SIZE)
    if s[_MODE] == _COMMAND:
        return np.array([_HOLD, t, x[2], x[5]])
    mode = _DESCEND if t - s[_SINCE] >= hold_for else _HOLD
    return np.array([mode, s[_SINCE], s[_Z], s[_PSI]])


@cached_njit
def hold_control(
    x: np.ndarray,
    z_r: float,
    psi_r: float,
    sink_rate: float,
    max_tilt: float,
    frequencies: np.ndarray,
    mass: float,
    inertia: np.ndarray,
    max_thrust: float,
) -> np.ndarray:
    """Return the u (4) that brings the vehicle to rest, level, at z_r [m] and psi_r [rad], by the module's loops.

    x is the true state, the sink rate the largest vertical speed asked for [m/s], max_tilt the largest size of roll and
    pitch [rad], the frequencies p, w_z, w_psi [rad/s], the inertia I_x, I_y, I_z [kg m^2], max_thrust the largest f_T
    [N].
    """
    p, w_z, w_psi = frequencies[0], frequencies[1], frequencies[2]
    phi, theta, psi = x[3], x[4], x[5]

    a_x, a_y = -p / 3.0 * x[6], -p / 3.0 * x[7]
    phi_r = (a_x * np.sin(psi) - a_y * np.cos(psi)) / GRAVITY
    theta_r = (a_x * np.cos(psi) + a_y * np.sin(psi)) / GRAVITY
    shrink = max_tilt / max(np.sqrt(phi_r**2 + theta_r**2), max_tilt)

    v_r = min(max(w_z / 2.0 * (z_r - x[2]), -sink_rate), sink_rate)
    a_z = 2.0 * w_z * (v_r - x[8])
    uprightness = max(np.cos(phi) * np.cos(theta), 0.5)  # share of the thrust that lifts, at least 0.5 (60 degrees)
    f_T = min(max(mass * (GRAVITY + a_z) / uprightness, 0.0), max_thrust)

    return np.array(
        [
            f_T,
            inertia[0] * (3.0 * p**2 * (shrink * phi_r - phi) - 3.0 * p * x[9]),
            inertia[1] * (3.0 * p**2 * (shrink * theta_r - theta) - 3.0 * p * x[10]),
            inertia[2] * (w_psi**2 * (psi_r - psi) - 2.0 * w_psi * x[11]),
        ]
    )


@cached_njit
def failsafe_control(
    s: np.ndarray,
    command: np.ndarray,
    x: np.ndarray,
    descent_rate: float,
    landing_height: float,
    max_tilt: float,
    frequencies: np.ndarray,
    mass: float,
    inertia: np.ndarray,
    max_thrust: float,
) -> np.ndarray:
    """Return the control (4) of the failsafe in state s: the command, or the one that holds or descends.

    The descent aims at the landing height, or at the hold's altitude if that is lower, so it never climbs above the
    latter. Arguments as failsafe_state and hold_control; rates in m/s, heights in m.
    """
    if s[_MODE] == _COMMAND:
        return command[0:N_U].copy()
    z_r, sink_rate = s[_Z], np.inf
    if s[_MODE] == _DESCEND:
        z_r, sink_rate = min(z_r, landing_height), descent_rate
    return hold_control(x, z_r, s[_PSI], sink_rate, max_tilt, frequencies, mass, inertia, max_thrust)


class Failsafe(LeafSystem):
    """Passes the onboard half's commands on while they come, and flies by itself while they don't.

    Ports:
        command (5): u, f_T absolute, and the time at which it was received [s], -inf if none was yet.
        state (12): the true x, as the flight controller's own sensors have it.
        control (4, output): the command bit for bit while its age is at most the timeout, otherwise the failsafe's.
        mode (1, output): index in MODES.

    State (discrete, updated every period): the mode's index; the time [s], altitude [m] and yaw [rad] at which the hold
    took over, all 0 while commands come. Both outputs are those of the state that follows from the inputs now, so that
    a ZeroOrderHold of the same period applies them at once.

    Args:
        settings: times, rates and frequencies.
        vehicle: mass, inertia and largest thrust.
        period: how often to look for a command [s].
    """

    def __init__(self, settings: FailsafeSettings, vehicle: Vehicle, period: float):
        super().__init__()
        self.set_name("failsafe")
        self._times = settings.timeout, settings.hold_for
        self._settings = (
            settings.descent_rate,
            settings.landing_height,
            settings.max_tilt,
            np.array([settings.braking_frequency, settings.altitude_frequency, settings.yaw_frequency]),
            vehicle.mass,
            np.array(vehicle.inertia),
            vehicle.largest_thrust,
        )
        self._command = self.DeclareVectorInputPort("command", COMMAND_SIZE)
        self._x = self.DeclareVectorInputPort("state", N_X)
        self.DeclareDiscreteState(_STATE_SIZE)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._update)
        needs = {self._command.ticket(), self._x.ticket(), self.time_ticket(), self.xd_ticket()}
        producer = ValueProducer(allocate=lambda: Value[object](), calc=self._calc_state)
        self._state_now = self.DeclareCacheEntry("the state that follows from the inputs now", producer, needs)
        needs = {self._state_now.ticket(), self._command.ticket(), self._x.ticket()}
        self.DeclareVectorOutputPort("control", N_U, self._calc_control, prerequisites_of_calc=needs)
        needs = {self._state_now.ticket()}
        self.DeclareVectorOutputPort("mode", 1, self._calc_mode, prerequisites_of_calc=needs)

    def _calc_state(self, context: Context, state: AbstractValue) -> None:
        t, s = context.get_time(), context.get_discrete_state().value()
        state.set_value(failsafe_state(t, s, self._command.Eval(context), self._x.Eval(context), *self._times))

    def _update(self, context: Context, values: DiscreteValues) -> None:
        values.set_value(self._state_now.Eval(context))

    def _calc_mode(self, context: Context, output: BasicVector) -> None:
        output.set_value(self._state_now.Eval(context)[_MODE : _MODE + 1])

    def _calc_control(self, context: Context, output: BasicVector) -> None:
        s = self._state_now.Eval(context)
        output.set_value(failsafe_control(s, self._command.Eval(context), self._x.Eval(context), *self._settings))
