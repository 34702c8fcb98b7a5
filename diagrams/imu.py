"""The IMU by itself, for Diagrams of one's own."""

from pydrake.systems.framework import System

from ortilo_drake.loop.diagram import system_of
from ortilo_drake.loop.element import constant, outside
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.model.clock import check_tick
from ortilo_drake.model.signals import N_X
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Imu
from ortilo_drake.world.sensors.imu import imu_box


def make_imu(settings: Imu | None = None, h: float = 1.0 / 30.0, seed: int = 0, stream: str = "imu") -> System:
    """Return an IMU as a System: what it measures follows from how its body moves, whatever moves it.

    Ports:
        state (12): x = [p_WB, rpy, v_WB, rpy rates].
        acceleration (3): v_dot of B's origin in W [m/s^2]: of a MultibodyPlant the translational part of the body's
            spatial acceleration.
        chance (1): see loop/shell.py; need not be connected.
        imu (11, output): [1, t, rpy, w_WB_B, f_B] with noise; f_B = R_WB^T (v_dot + g e_z), [0, 0, 9.81] at rest.

    Args:
        settings: its noise; by default that of the ready-made scenarios.
        h: tick, in which the noise is the same [s].
        seed: of its noise.
        stream: name of its noise, of which two of one seed have the same. Where it is given a name in its Diagram, as
            in AddNamedSystem("left", make_imu()), its noise is of that name, too.

    Raises:
        InputError: if an argument is wrong.
    """
    check_tick(h)
    if not isinstance(settings, Imu | None):
        raise InputError(f"settings: {settings!r}: must be those of an IMU, as od.load_scenario('imu_uwb').imu")
    box = imu_box(settings or Imu(), h, whole=True, stream=stream)
    wiring = Wiring([outside("state", N_X), outside("acceleration", 3), constant("sent", 0.0), box])
    return system_of(wiring, h, seed)
