"""The map.yaml beside a log of ours, with which `ortilo replay --map` reads the log like any other recording.

The map says what the simulator knows: the positions of the anchors; that sensors and truth share one clock, one frame
and one point; and the noise that the scenario gave the sensors. A comment beside each number names its setting.
"""

from collections.abc import Collection
from typing import Any

import numpy as np
import yaml

from ortilo_drake.model.room import Room
from ortilo_drake.scenario import Scenario
from ortilo_drake.scenario.truth import ClockTruth

LEAST = {"range_white": 1e-3, "range_correlated": 1e-3, "acceleration": 1e-3, "rotation": 1e-4}  # no noise may be zero
RANGES = "/uwb/anchor_"  # prefix of the topics of ranges


def logged_noise(scenario: Scenario, ranges: np.ndarray) -> dict[str, tuple[float, str]]:
    """Return the filter noise that follows from a flown scenario, as (number, origin) by the names of FilterSettings.

    The white noise is the RMS over all ranges of the log (n) [m]. Where walls or fields cause errors that last, the
    scenario has no number for them, and the filter keeps its defaults of correlated noise.
    """
    uwb, imu, truth = scenario.uwb, scenario.imu, scenario.truth.uwb
    offset, growth = uwb.sds
    white = float(np.sqrt(np.mean((offset + growth * ranges) ** 2)))
    noise = f"of uwb.{'fitted' if uwb.errors == 'fitted' else 'noise'}"
    found = {
        "acceleration": (imu.specific_force_density, "of imu.specific_force_density"),
        "rotation": (imu.rate_density, "of imu.rate_density"),
        "range_white": (white, f"{noise}: RMS of its standard deviation over the logged ranges"),
    }
    fitted = uwb.fitted.of_single_ranges if uwb.errors == "fitted" and uwb.fitted is not None else None
    if uwb.walls.kind not in ("bias", "excess") and (fitted is None or fitted.field is None):
        lasting = [(truth.slow_sd, truth.slow_time, "of truth.uwb.slow_sd")]
        if fitted is not None and fitted.lasting is not None:
            lasting.append((fitted.lasting.sd, fitted.lasting.time, "of uwb.fitted.lasting"))
        sd, time, key = max(lasting)
        found["range_correlated"] = (sd, key if sd > 0.0 else "no error of it lasts")
        if sd > 0.0:
            found["correlation_time"] = (time, key)
    return {name: (max(LEAST.get(name, 0.0), number), origin) for name, (number, origin) in found.items()}


def logged_map(
    scenario: Scenario, room: Room, topics: Collection[str], ranges: np.ndarray, start: tuple[list[float], float] | None
) -> str:
    """Return the map of a log as YAML; an empty text for a log without ranges or imu.

    The arguments describe the log: scenario, room, all topics, all ranges (n) [m], and as `start` the first estimate of
    the position p_WB (3) [m] and heading [rad], None if they are not known.
    """
    heard = [i for i in range(len(room.anchors)) if f"{RANGES}{i}" in topics]
    if not heard or "/imu/data" not in topics:
        return ""
    found = dict[str, Any](
        ranges={"file": ".", "topics": [f"{RANGES}{i}" for i in heard], "values": ["range"]},
        anchors=[list(room.anchors[i]) for i in heard],
        imu={"file": ".", "topic": "/imu/data", "axes": "flu"},
    )
    if "/truth/pose" in topics:
        found["truth"] = {
            "file": ".",
            "topic": "/truth/pose",
            "position": [f"pose.position.{axis}" for axis in "xyz"],
            "rotation": {"columns": [f"pose.orientation.{axis}" for axis in "xyzw"], "order": "xyzw"},
        }
    text: str = yaml.safe_dump(found, sort_keys=False, default_flow_style=None, width=1000)
    if "truth" in found:
        one_clock = scenario.truth.clock == ClockTruth()
        text += "# One simulator wrote sensors and truth: one frame, one point" + ", one clock" * one_clock + ".\n"
        text += f"calibration: {{{'clock: 0.0, ' * one_clock}frame: same, lever: [0.0, 0.0, 0.0]}}\n"
    text += f"# The noise that the scenario {scenario.name} gives its sensors; `ortilo tune` fits it.\nfilter:\n"
    for name, (number, origin) in logged_noise(scenario, ranges).items():
        text += f"  {name}: {number:.3g} # {origin}\n"
    if start is not None:
        position = ", ".join(f"{v:g}" for v in np.round(start[0], 4) + 0.0)
        text += "# Where the onboard half began; without it, replay and bridge find it by the first ranges.\n"
        text += f"start: {{position: [{position}], heading: {np.round(start[1], 4) + 0.0:g}}}\n"
    return text
