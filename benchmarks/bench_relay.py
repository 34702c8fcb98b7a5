"""Late measurements through the relay, in real time: filter.delay = ignore, drop and replay over the same seeds.

    python benchmarks/bench_relay.py                                  # the table of docs/hil.md, about 25 min
    python benchmarks/bench_relay.py --seeds 2 --seconds 10           # a quick look

For each seed the three modes fly at the same time, each a world, a relay and an onboard half in processes and on buses
of their own, so that a slow moment of the machine hits all alike. Every packet of both directions may be lost and
comes late. A flight that is in the folder already is not flown again.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from ortilo_drake.experiments.flight import load_flight
from ortilo_drake.experiments.late_flights import MODES, late_table, mode_report, paired
from ortilo_drake.experiments.metrics import summary

FAULTS = "{loss: 0.2, delay: 0.04, spread: 0.02}"
ORTILO = (sys.executable, "-m", "ortilo_drake.cli")


def start(*words: str) -> subprocess.Popen[str]:
    """Start `ortilo` with these words; what it prints is kept for when it fails."""
    return subprocess.Popen([*ORTILO, *words], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


def fly_modes(scenario: tuple[str, ...], seed: int, seconds: float | None, out: Path, port: int) -> None:
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


def main() -> None:
    """Fly and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenario", default="imu_uwb_yolo")
    parser.add_argument("--rate", type=float, default=30.0, help="control_rate [Hz]")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--seconds", type=float, help="end each flight after that long [s]")
    parser.add_argument("--port", type=int, default=7680, help="first of six UDP ports")
    parser.add_argument("--out", type=Path, default=Path("out/relay"))
    chosen = parser.parse_args()
    chosen.out.mkdir(parents=True, exist_ok=True)
    scenario = (chosen.scenario, "--set", "camera=projected", "--set", f"control_rate={chosen.rate:g}")
    for seed in range(chosen.seeds):
        fly_modes(scenario, seed, chosen.seconds, chosen.out, chosen.port)
        print(f"{seed + 1} of {chosen.seeds} seeds flown", flush=True)
    found = report(chosen.scenario, chosen.rate, chosen.seeds, chosen.out)
    (chosen.out / "report.json").write_text(json.dumps(found, indent=2))
    print("\n".join(late_table([found])))


if __name__ == "__main__":
    main()
