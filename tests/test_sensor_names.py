"""Only few files name the paper's sensors: all others ask a sensor's description for what it can."""

import re
from pathlib import Path

import ortilo_drake

PACKAGE = Path(ortilo_drake.__file__).parent
NAMED = re.compile(r"""["'](uwb|camera|imu)(["']|\.)""")  # "uwb", or a setting such as "uwb.link.rate"

# A sensor's own files, its settings and its views.
OWN = (
    "scenario/",
    "views/",
    "onboard/landmarks/",
    "onboard/ranging/",
    "world/sensors/",
    "sensors/uwb",  # and uwb_theory
    "sensors/camera",  # and camera_theory
    "sensors/imu.py",
    "diagrams/imu.py",
    "diagrams/rendered_camera.py",
    "model/inputs/calibration_file.py",  # of the camera
    "world/scenery/bent_picture.py",  # likewise
    "training/calibration/calibrate.py",  # of the camera
    "world/faults/table.py",  # of what the camera looks at
    "world/radio/image_delay.py",  # of the camera's pictures
)

# Every other file that names one, and why.
WHY = {
    "diagrams/single_parts.py": "the sensors that an estimator has by default, and examples",
    "model/optional.py": "an extra of that name",
    "studies/fit/fit.py": "figures by their keys in NOISE.yaml",
    "interop/recorded/live_rows.py": "keys of a map file",
    "interop/recorded/map_file.py": "likewise",
    "studies/recorded/at_rest.py": "a key of a map file",
    "model/signals.py": "the list of the paper's sensors",
    "diagrams/wiring/tight.py": "the tight filter takes the raw messages of these three",
    "studies/rooms/room_scenario.py": "settings by their keys",
    "commands/options.py": "settings by their keys, of --camera and --detector",
    "interop/ros/ros_sensors.py": "their ROS messages",
    "interop/recorded/recording.py": "columns of foreign recordings",
}


def test_only_these_files_name_the_papers_sensors() -> None:
    files = [p for p in sorted(PACKAGE.rglob("*.py")) if "__pycache__" not in p.parts]
    files += sorted((PACKAGE / "diagrams").rglob("*.py"))
    named = {p.relative_to(PACKAGE).as_posix() for p in files if NAMED.search(p.read_text(encoding="utf-8"))}
    assert {name for name in named if not name.startswith(OWN)} == set(WHY)
    assert len(WHY) <= 12
