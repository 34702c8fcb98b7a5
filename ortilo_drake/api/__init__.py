"""The laboratory in Python: what `import ortilo_drake as od` offers.

    >>> import ortilo_drake as od
    >>> short = {"kind": "hover", "duration": 0.5}
    >>> flight = od.fly("imu_uwb", seed=3, uwb__link__loss=0.3, planner=short, settle=0.0)
    >>> flight.lost is None, len(flight.to_pandas())
    (True, 16)
    >>> flight.to_pandas().attrs["units"]["estimate.x_dot"]
    'm/s'
    >>> print(od.compare("imu_uwb", "nominal_imu_uwb", seeds=range(2), planner=short, settle=0.0)["lost"].to_list())
    [0, 0]

Keywords are the settings of a scenario file; two underscores stand for the dot of `--set uwb.link.loss=0.3`. The form
of the command line works as well: `od.fly("imu_uwb", "servo.yaw=0.3")`.
"""

from ortilo_drake.api.flight import Flight, fly
from ortilo_drake.api.flights import Flights, compare, fly_many
from ortilo_drake.api.parts import (
    register_detector,
    register_estimator,
    register_fault,
    register_planner,
    register_servo,
)
from ortilo_drake.api.riccati import Dare, solve_dare
from ortilo_drake.api.studies import Study, linearize, map, tables
from ortilo_drake.codegen.export import export
from ortilo_drake.diagrams.closed_loop import make_closed_loop
from ortilo_drake.diagrams.imu import make_imu
from ortilo_drake.diagrams.kalman_filter import IntermittentKalmanFilter
from ortilo_drake.diagrams.single_parts import make_body_state, make_estimator, make_plant, make_sensor, make_servo
from ortilo_drake.flight.engine import Engine
from ortilo_drake.interop.recorded.map_file import load_map
from ortilo_drake.interop.recorded.recording import read_recording
from ortilo_drake.loop.element import Box
from ortilo_drake.loop.own import box
from ortilo_drake.model.measurement import row
from ortilo_drake.model.parts import Compiled, Sensor, register_sensor
from ortilo_drake.model.room import Room
from ortilo_drake.model.typed_yaml import Frozen
from ortilo_drake.model.vehicle import Vehicle
from ortilo_drake.onboard.fix_solver import FixSolver
from ortilo_drake.onboard.planner.planned import path_of
from ortilo_drake.scenario import Belief, InputError, IntermittentFilter, Scenario, load_scenario
from ortilo_drake.scenario.faults import Fault
from ortilo_drake.scenario.own_parts import SensorSettings
from ortilo_drake.studies.recorded.calibrate import calibrate
from ortilo_drake.world.sensors.state_sensor import StateSensor

__all__ = [
    "Belief",
    "Box",
    "Compiled",
    "Dare",
    "Engine",
    "Fault",
    "FixSolver",
    "Flight",
    "Flights",
    "Frozen",
    "InputError",
    "IntermittentFilter",
    "IntermittentKalmanFilter",
    "Room",
    "Scenario",
    "Sensor",
    "SensorSettings",
    "StateSensor",
    "Study",
    "Vehicle",
    "box",
    "calibrate",
    "compare",
    "export",
    "fly",
    "fly_many",
    "linearize",
    "load_map",
    "load_scenario",
    "make_body_state",
    "make_closed_loop",
    "make_estimator",
    "make_imu",
    "make_plant",
    "make_sensor",
    "make_servo",
    "map",
    "path_of",
    "read_recording",
    "register_detector",
    "register_estimator",
    "register_fault",
    "register_planner",
    "register_sensor",
    "register_servo",
    "row",
    "solve_dare",
    "tables",
]
