"""The typed scenario: everything that decides a flight, and nothing else.

A scenario is a YAML file that holds the fields of Scenario. A field that the file leaves out takes its default, and the
defaults together are a valid flight. Units are SI, angles are in radians. A wrong file is refused before anything
runs, with one line that names the file, the field, the value and what is allowed (InputError).

Each module of this folder holds the settings of one subject; import the settings from here.
"""

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import Vehicle
from ortilo_drake.scenario.belief import Belief
from ortilo_drake.scenario.camera import Camera
from ortilo_drake.scenario.estimator import Biases, DiagonalW, DisturbanceW, IntermittentFilter, Noise, Walks
from ortilo_drake.scenario.link import (
    BernoulliLoss,
    Blackout,
    BurstLoss,
    CommandLink,
    GilbertElliottLoss,
    Link,
    Loss,
    NoLoss,
    PositionBlackout,
    TimeBlackout,
)
from ortilo_drake.scenario.load import SCENARIO_FOLDER, load_scenario, scenario_names, with_seed
from ortilo_drake.scenario.onboard import Detector, Exclusion, LandmarkFix, LqServo, Multilateration, ServoWeights
from ortilo_drake.scenario.planner import GcsPlanner, HoverPlanner, Planner, WaypointPlanner, read_waypoints
from ortilo_drake.scenario.scenario import Scenario
from ortilo_drake.scenario.sensors import (
    AffineNoise,
    Ahrs,
    ConstantNoise,
    Imu,
    ProportionalNoise,
    RangeNoise,
    Uwb,
    WallEffect,
    WallsBias,
    WallsBlock,
    WallsExcess,
    WallsIgnored,
)
from ortilo_drake.scenario.truth import Truth
from ortilo_drake.scenario.world import Commands, Disturbance, Failsafe, FirstOrderRotors, IdealRotors, World
