"""Flies the ready-made scenarios by the ensemble engine and by the Drake diagram, and says whether the flights are one.

    python scripts/sameness.py [--seeds N] [--others N] [SCENARIO ...]

Flight by flight: on the same seeds every number of the log is compared. As samples: flights of two further lots of
seeds, one flown by each, are compared by Kolmogorov and Smirnov's two-sample test, figure by figure; that also says
that neither is wrong on the seeds that happen to be compared. Of many tests some p-values are small: the least must
exceed 0.01 over their number. Exit code 1 if anything differs.
"""

import argparse
import sys

import numpy as np
from scipy.stats import ks_2samp

from ortilo_drake.diagrams.wiring.whole import why_not
from ortilo_drake.flight.engine import Engine
from ortilo_drake.flight.flight import FlightSimulator
from ortilo_drake.flight.metrics import summary
from ortilo_drake.flight.sameness import apart
from ortilo_drake.scenario import Scenario, load_scenario, scenario_names

COMPARED = ("mse_x", "mse_y", "mse_z", "path_distance_mse", "max_reference_distance", "nees")


def same_flights(scenario: Scenario, seeds: int) -> bool:
    """Compare the flights of that many seeds number by number."""
    engine, simulator = Engine(scenario), FlightSimulator(scenario)
    found = [apart(simulator.fly(seed), engine.fly(seed)) for seed in range(seeds)]
    farthest, others = max(a.position for a in found), max(a.others for a in found)
    same = all(a.same for a in found)
    print(f"{scenario.name}: {seeds} seeds: position {farthest:.1e} m, others {others:.1e}, same arrivals: {same}")
    return same


def same_samples(scenario: Scenario, first: int, flights: int) -> bool:
    """Compare the figures of that many flights by Drake with those of as many others by the engine."""
    if flights == 0:
        return True
    engine, simulator = Engine(scenario), FlightSimulator(scenario)
    compiled = dict(zip(engine.columns, engine.figures(range(first + flights, first + 2 * flights)).T, strict=True))
    drakes: dict[str, list[float]] = {name: [] for name in COMPARED}
    for seed in range(first, first + flights):
        one = summary(simulator.fly(seed))
        errors = {f"mse_{axis}": value for axis, value in one.mse.items()}
        for name in COMPARED:
            drakes[name].append(errors[name] if name in errors else getattr(one, name))
    p = {name: float(ks_2samp(drakes[name], compiled[name]).pvalue) for name in COMPARED}
    least = min(p, key=p.__getitem__)
    print(f"{scenario.name}: {flights} and {flights} other flights: least p {p[least]:.2g}, of {least}")
    return bool(np.all(np.array(list(p.values())) > 0.01 / len(COMPARED)))


def main() -> None:
    """Compare the scenarios named, by default all that are compiled."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenarios", nargs="*", help="ready-made ones; by default all that are compiled")
    parser.add_argument("--seeds", type=int, default=20, help="flown by both")
    parser.add_argument("--others", type=int, default=200, help="flights of each sample; 0 leaves the samples out")
    arguments = parser.parse_args()
    same = True
    for name in arguments.scenarios or scenario_names():
        scenario = load_scenario(name, ("camera.kind=projected",))
        reason = why_not(scenario)
        if reason is not None:
            print(f"{name}: {reason}")
            continue
        same &= same_flights(scenario, arguments.seeds)
        same &= same_samples(scenario, arguments.seeds, arguments.others)
    sys.exit(0 if same else 1)


if __name__ == "__main__":
    main()
