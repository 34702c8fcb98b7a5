"""Late measurements ignored, dropped and replayed over the same seeds: the tables of docs/hil.md.

    python benchmarks/bench_late.py                           # through the relay, in real time: half an hour
    python benchmarks/bench_late.py --simulated               # by the scenario's own links, in whole ticks: minutes
    python benchmarks/bench_late.py --seeds 2 --seconds 5     # a quick look

20 % of all packets are lost, and they come 40 +- 20 ms late. Through the relay the three modes of a seed fly at the
same time, each a world, a relay and an onboard half in processes and on buses of their own, so that a slow moment of
the machine hits all alike; `--faults` changes what the relay does to both directions. A flight that is in the folder
already is not flown again.
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
ORTILO = (sys.executable, "-m", "ortilo_drake.cli")


def start(*words: str) -> subprocess.Popen[str]:
    """Start `ortilo` with these words; what it prints is kept for when it fails."""
    return subprocess.Popen([*ORTILO, *words], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


def fly_modes(
    scenario: tuple[str, ...], seed: int, seconds: float | None, out: Path, port: int, faults: str = FAULTS
) -> None:
    """Fly one seed in each mode that is not in the folder yet, all at once; write each flight's summary."""
    flights, relays = {}, []
    for i, mode in enumerate(MODES):
        done = out / f"{mode}_{seed}.json"
        if done.exists():
            continue
        urls = [f"udpm://239.255.76.67:{port + 2 * i + side}?ttl=0" for side in (0, 1)]
        flown = (*scenario, "--seed", str(seed), "--set", f"filter.delay={mode}")
        relays.append(
            start(
                "hil",
                "relay",
                "--faults",
                FAULTS,
                "--seed",
                str(seed + 1),
                "--url-world",
                urls[0],
                "--url-onboard",
                urls[1],
            )
        )
        onboard = start("hil", "onboard", *flown, "--url", urls[1])
        end = () if seconds is None else ("--seconds", str(seconds))
        files = ("--out", str(done.with_suffix(".nc")), "--json", str(done.with_suffix(".watch")))
        world = start("hil", "world", *flown, "--url", urls[0], *files, *end)
        flights[mode] = (world, onboard)
    for mode, (world, onboard) in flights.items():
        said = world.communicate()[1]
        if world.returncode:
            raise SystemExit(f"{mode}, seed {seed}: {said.strip()}")
        onboard.communicate()
    for relay in relays:
        relay.terminate()
        relay.communicate()
    for mode in flights:
        done = out / f"{mode}_{seed}.json"
        watch = json.loads(done.with_suffix(".watch").read_text())
        done.write_text(json.dumps(summary(load_flight(done.with_suffix(".nc"))) | {"watch": watch}))
        done.with_suffix(".nc").unlink()  # 2 MB each
        done.with_suffix(".watch").unlink()


def report(name: str, control_rate: float, seeds: int, out: Path) -> dict[str, Any]:
    """Return how the modes compare over the seeds, as late_flights does."""
    flown = {mode: [json.loads((out / f"{mode}_{s}.json").read_text()) for s in range(seeds)] for mode in MODES}
    return {
        "scenario": name,
        "control_rate": control_rate,
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
    parser.add_argument("--scenario", default="imu_uwb_yolo")
    parser.add_argument("--rate", type=float, default=30.0, help="control_rate [Hz]")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--seconds", type=float, help="end each flight after that long [s]")
    parser.add_argument("--faults", default=FAULTS, help="of both directions, see `ortilo hil relay --help`")
    parser.add_argument("--port", type=int, default=7680, help="first of six UDP ports")
    parser.add_argument("--out", type=Path, default=Path("out/late"))
    chosen = parser.parse_args()
    chosen.out.mkdir(parents=True, exist_ok=True)
    if chosen.simulated:
        reports = simulated(chosen.seeds, chosen.out)
    else:
        scenario = (chosen.scenario, "--set", "camera=projected", "--set", f"control_rate={chosen.rate:g}")
        for seed in range(chosen.seeds):
            fly_modes(scenario, seed, chosen.seconds, chosen.out, chosen.port, chosen.faults)
            print(f"{seed + 1} of {chosen.seeds} seeds flown", flush=True)
        reports = [report(chosen.scenario, chosen.rate, chosen.seeds, chosen.out)]
    (chosen.out / "report.json").write_text(json.dumps(reports, indent=2))
    print("\n".join(late_table(reports)))


if __name__ == "__main__":
    main()
