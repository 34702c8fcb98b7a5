"""How far flights with an onboard half in single precision are from those in doubles: every exportable ready-made one.

    python scripts/export_single.py [--target x86-64] [SCENARIO ...]

Each flies twice, in closed loop and with the same noise: a replay of recorded inputs would let the estimate run away
where no fix comes in, as the commands would not reach the vehicle. Prints how far the vehicle and the estimate come to
be from those in doubles, and ends with 1 if that is more than 1 mm or 0.1 degree. A world has edges: where the vehicles
are micrometres apart, a wall may hide an anchor from one of them alone. From there on the flights are two different
ones, and are not compared. Needs what `make setup EXPORT=1` installs.
"""

import argparse
import sys
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
import xarray as xr

from ortilo_drake.codegen.export import export
from ortilo_drake.codegen.exported_half import ExportedHalf
from ortilo_drake.flight.lockstep import Ask, fly_lockstep, in_this_process
from ortilo_drake.flight.signals import Signals
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario, scenario_names

FAR, TURNED = 1.0, 0.1  # [mm], [degree]


class Apart(NamedTuple):
    """How far a flight in single precision comes to be from that in doubles.

    Attributes:
        far: positions of vehicle and estimate [mm].
        turned: their angles [degree].
        ticks: that are compared: until the world hands over other messages.
        of: ticks of the flight.
    """

    far: float
    turned: float
    ticks: int
    of: int


def there_in(messages: Signals) -> dict[str, bytes]:
    """Return what is there in a tick: which messages, and which of their numbers are not 0."""
    return {name: (np.asarray(its) != 0.0).tobytes() for name, its in messages.items()}


def flown_by(scenario: Scenario, ask: Ask) -> tuple[xr.Dataset, list[dict[str, bytes]]]:
    """Return a flight, and which messages and ranges were there in each tick."""
    there = list[dict[str, bytes]]()

    def asked(tick: int, messages: Signals) -> Signals:
        there.append(there_in(messages))
        return ask(tick, messages)

    return fly_lockstep(scenario, asked), there


def apart(scenario: Scenario, folder: str) -> Apart:
    """Return how far a flight of what was exported of a scenario is from that in doubles."""
    with ExportedHalf(scenario, folder) as half:

        def ask(tick: int, messages: Signals) -> Signals:
            half.receive(messages)
            return half.outputs()

        flown, there = flown_by(scenario, ask)
    its, also = flown_by(scenario, in_this_process(scenario))
    differ = [k for k, (one, other) in enumerate(zip(there, also, strict=False)) if one != other]
    ticks = differ[0] if differ else min(len(there), len(also))
    far = turned = 0.0
    for name in ("truth", "estimate"):
        between = flown[name].values[:ticks] - its[name].values[:ticks]
        far = max(far, 1e3 * np.max(np.linalg.norm(between[:, :3], axis=1)))
        turned = max(turned, np.rad2deg(np.max(np.abs((between[:, 3:6] + np.pi) % (2.0 * np.pi) - np.pi))))
    return Apart(far, turned, ticks, len(also))


def main() -> int:
    """Compare the flights."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--target", default="x86-64")
    parser.add_argument("scenarios", nargs="*", default=scenario_names())
    given, wrong = parser.parse_args(), 0
    for name in given.scenarios:
        try:
            scenario = load_scenario(name, "camera.kind=projected")
            with TemporaryDirectory() as folder:
                export(scenario, given.target, folder, ticks=1, precision="single")
                far, turned, ticks, of = apart(scenario, folder)
        except InputError as error:
            print(f"{name}: {error}", flush=True)
            continue
        print(f"{name} {given.target}: {far:.3f} mm, {turned:.4f} degree in {ticks} of {of} ticks", flush=True)
        wrong += not (far <= FAR and turned <= TURNED)
    return wrong > 0


if __name__ == "__main__":
    sys.exit(main())
