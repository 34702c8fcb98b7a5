"""Every tick of every exportable ready-made flight on each processor: control, estimate and covariance bit by bit.

    python scripts/export_check.py [--ticks N] [--targets cortex-m7,aarch64,x86-64] [SCENARIO ...]

Prints a line for each flight and processor, and ends with 1 if a bit differs. Needs what `make setup EXPORT=1`
installs.
"""

import argparse
import sys
from tempfile import TemporaryDirectory

import numpy as np

from ortilo_drake.codegen.export import export
from ortilo_drake.codegen.exported_half import ExportedHalf
from ortilo_drake.codegen.golden import COMPARED, flown_ticks
from ortilo_drake.codegen.half import onboard_half
from ortilo_drake.flight.flyable import flight_ticks
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario, scenario_names


def differing(scenario: Scenario, target: str, came: np.ndarray, went: dict[str, np.ndarray]) -> int:
    """Return in how many ticks an exported half says anything else than Python did."""
    with TemporaryDirectory() as folder:
        export(scenario, target, folder, ticks=1)
        count = 0
        with ExportedHalf(scenario, folder) as half:
            for k, inputs in enumerate(came):
                half.take_inputs(inputs)
                said = half.outputs()
                count += any(said[name].tobytes() != went[name][k].tobytes() for name in COMPARED) or half.stopped != 0
    return count


def main() -> int:
    """Check the flights."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ticks", type=int, default=0, help="of each flight; 0: the whole")
    parser.add_argument("--targets", default="cortex-m7,aarch64,x86-64")
    parser.add_argument("scenarios", nargs="*", default=scenario_names())
    given, wrong = parser.parse_args(), 0
    for name in given.scenarios:
        scenario = load_scenario(name, "camera.kind=projected")
        ticks = given.ticks or flight_ticks(scenario) + 1
        try:
            came, went = flown_ticks(scenario, onboard_half(scenario), ticks)
            for target in given.targets.split(","):
                count = differing(scenario, target, came, went)
                print(f"{name} {target}: {count} of {ticks} ticks differ", flush=True)
                wrong += count
        except InputError as error:
            print(f"{name}: {error}", flush=True)
    return wrong > 0


if __name__ == "__main__":
    sys.exit(main())
