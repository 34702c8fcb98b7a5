"""Late measurements ignored, dropped and replayed over the same seeds: the tables of docs/hil.md.

    python benchmarks/bench_late.py                           # through the relay, in real time: half an hour
    python benchmarks/bench_late.py --one-way                 # the same with the commands spared
    python benchmarks/bench_late.py --simulated               # by the scenario's own links, in whole ticks: minutes
    python benchmarks/bench_late.py --seeds 2 --seconds 5     # a quick look

20 % of all packets are lost, and they come 40 +- 20 ms late. Through the relay the three modes of a seed fly at the
same time, each a world, a relay and an onboard half in processes and on buses of their own, so that a slow moment of
the machine hits all alike. A flight that is in the folder already is not flown again.
"""

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

from ortilo_drake.experiments.flight import load_flight
from ortilo_drake.experiments.late_flights import (
    AT_30_HZ,
    BOTH_WAYS_AT_30_HZ,
    BOTH_WAYS_AT_100_HZ,
    MODES,
    late_flights,
    late_table,
    mode_report,
    paired,
)
from ortilo_drake.experiments.metrics import summary
from ortilo_drake.scenario import load_scenario

FAULTS = "{loss: 0.2, delay: 0.04, spread: 0.02}"


def start(*words: str) -> "subprocess.Popen[str]":
    """Start `ortilo hil` with these words; what it says on stderr is kept for when it fails."""
    command = (sys.executable, "-m", "ortilo_drake.cli", "hil", *words)
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


def fly_modes(flown: tuple[str, ...], seed: int, seconds: tuple[str, ...], out: Path, port: int, way: str) -> None:
    """Fly one seed in each mode that is not in the folder yet, all at once; write each flight's summary."""
    worlds, others = {}, []
    for i, mode in enumerate(MODES):
        done = out / f"{mode}_{seed}.json"
        if done.exists():
            continue
        world_bus, onboard_bus = (f"udpm://239.255.76.67:{port + 2 * i + side}?ttl=0" for side in (0, 1))
        words = (*flown, "--seed", str(seed), "--set", f"filter.delay={mode}")
        buses = ("--url-world", world_bus, "--url-onboard", onboard_bus)
        others.append(start("relay", way, FAULTS, "--seed", str(seed + 1), *buses))
        others.append(start("onboard", *words, "--url", onboard_bus))
        files = ("--out", str(done.with_suffix(".nc")), "--json", str(done.with_suffix(".watch")))
        worlds[mode] = start("world", *words, "--url", world_bus, *files, *seconds)
    try:
        for mode, world in worlds.items():
            said = world.communicate()[1]
            if world.returncode:
                raise SystemExit(f"{mode}, seed {seed}: {said.strip()}")
            done = out / f"{mode}_{seed}.json"
            watch = json.loads(done.with_suffix(".watch").read_text())
            done.write_text(json.dumps(summary(load_flight(done.with_suffix(".nc"))) | {"watch": watch}))
            done.with_suffix(".nc").unlink()  # 2 MB each
            done.with_suffix(".watch").unlink()
    finally:
        for process in (*worlds.values(), *others):
            process.terminate()
            process.communicate()


def relay_report(name: str, control_rate: float, seeds: int, out: Path, one_way: bool) -> dict[str, Any]:
    """Return how the modes compare over the seeds, as late_flights does."""
    flown = {mode: [json.loads((out / f"{mode}_{s}.json").read_text()) for s in range(seeds)] for mode in MODES}
    return {
        "scenario": name,
        "control_rate": control_rate,
        "links": f"relay, {'sensors only' if one_way else 'both ways'}",
        "modes": {mode: mode_report(flown[mode]) for mode in MODES},
        "against": {mode: paired(flown["replay"], flown[mode]) for mode in ("ignore", "drop")},
    }


def simulated(seeds: int, out: Path) -> list[dict[str, Any]]:
    """Return the reports of flights behind the scenario's own links."""
    cases = [
        ("imu_uwb_yolo", 30, BOTH_WAYS_AT_30_HZ),
        ("imu_uwb_yolo", 100, BOTH_WAYS_AT_100_HZ),
        ("imu_uwb_yolo", 30, AT_30_HZ),
        ("imu_uwb", 30, BOTH_WAYS_AT_30_HZ),
    ]
    reports = []
    for name, rate, links in cases:
        scenario = load_scenario(name, ("camera=projected", f"control_rate={rate}"))
        reports.append(late_flights(scenario, range(seeds), out, links, os.cpu_count() or 1))
        print(f"{len(reports)} of {len(cases)} cases flown", flush=True)
    return reports


def main() -> None:
    """Fly and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--simulated", action="store_true", help="not through the relay; of the others --seeds, --out")
    parser.add_argument("--one-way", action="store_true", help="faults only on the way to the onboard half")
    parser.add_argument("--scenario", default="imu_uwb_yolo")
    parser.add_argument("--rate", type=float, default=30.0, help="control_rate [Hz]")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--seconds", type=float, help="end each flight after that long [s]")
    parser.add_argument("--port", type=int, default=7680, help="first of six UDP ports")
    parser.add_argument("--out", type=Path, default=Path("out/late"), help="folder, of one kind of flight")
    chosen = parser.parse_args()
    chosen.out.mkdir(parents=True, exist_ok=True)
    if chosen.simulated:
        reports = simulated(chosen.seeds, chosen.out)
    else:
        flown = (chosen.scenario, "--set", "camera=projected", "--set", f"control_rate={chosen.rate:g}")
        seconds = () if chosen.seconds is None else ("--seconds", str(chosen.seconds))
        way = "--to-onboard" if chosen.one_way else "--faults"
        for seed in range(chosen.seeds):
            fly_modes(flown, seed, seconds, chosen.out, chosen.port, way)
            print(f"{seed + 1} of {chosen.seeds} seeds flown", flush=True)
        reports = [relay_report(chosen.scenario, chosen.rate, chosen.seeds, chosen.out, chosen.one_way)]
    (chosen.out / "report.json").write_text(json.dumps(reports, indent=2))
    print("\n".join(late_table(reports)))


if __name__ == "__main__":
    main()
