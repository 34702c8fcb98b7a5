"""The laboratory in Python: what `import ortilo_drake as od` offers.

    flight = od.fly("imu_uwb_yolo", seed=3, camera__kind="projected", uwb__link__loss=0.3)
    flight.error, flight.lost, flight.summary(), flight.plot()
    od.compare("imu_uwb", "imu_uwb_yolo", camera__kind="projected", seeds=range(5))

Settings are those of a scenario file, by keyword: two underscores stand for the dot of `--set uwb.link.loss=0.3`.
"""

from ortilo_drake.api.flight import Flight, fly
from ortilo_drake.api.flights import Flights, compare, fly_many
from ortilo_drake.api.parts import register_estimator, register_planner, register_servo
from ortilo_drake.api.settings import load_scenario
from ortilo_drake.diagrams.closed_loop import make_closed_loop
from ortilo_drake.model.measurement import row
from ortilo_drake.model.parts import Compiled, CompiledEstimator, Sensor, register_sensor
from ortilo_drake.model.room import Room
from ortilo_drake.model.typed_yaml import Frozen
from ortilo_drake.onboard.fix_solver import FixSolver, compiled_solver
from ortilo_drake.scenario import Belief, InputError, Scenario
from ortilo_drake.scenario.own_parts import SensorSettings
from ortilo_drake.world.sensors.state_sensor import StateSensor, compiled_sensor

__all__ = [
    "Belief",
    "Compiled",
    "CompiledEstimator",
    "FixSolver",
    "Flight",
    "Flights",
    "Frozen",
    "InputError",
    "Room",
    "Scenario",
    "Sensor",
    "SensorSettings",
    "StateSensor",
    "compare",
    "compiled_sensor",
    "compiled_solver",
    "fly",
    "fly_many",
    "load_scenario",
    "make_closed_loop",
    "register_estimator",
    "register_planner",
    "register_sensor",
    "register_servo",
    "row",
]
