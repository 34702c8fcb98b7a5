"""Late measurements and late commands over the same seeds, by what is made of them: the tables of docs/how_to/hil.md.

    python benchmarks/bench_late.py                           # the relay's faults, in virtual time: half an hour
    python benchmarks/bench_late.py --real-time --seeds 2     # in processes and by the clock, on an idle machine
    python benchmarks/bench_late.py --simulated               # by the scenario's own links, in whole ticks: minutes
    python benchmarks/bench_late.py --commands                # late commands, in virtual time: half an hour
    python benchmarks/bench_late.py --margins --seeds 4       # how late they may be, predicted and flown: minutes

20 % of all packets are lost, and they come 40 +- 20 ms late. In real time the three modes of a seed fly at the same
time, each a world, a relay and an onboard half in processes and on buses of their own, so that a slow moment of the
machine hits all alike. A flight that is in the folder already is not flown again.
"""

import argparse
import itertools
import json
import os
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

from delay_ways import delay_ways, ways, with_way

from ortilo_drake.flight.metrics import summary
from ortilo_drake.flight.processes.workers import run_all
from ortilo_drake.flight.saved_flight import load_flight
from ortilo_drake.flight.summary import Summary, read_summary, summary_text
from ortilo_drake.hil.relay.relay import Faults
from ortilo_drake.hil.relay.virtual_time import summary_in_virtual_time
from ortilo_drake.model.as_data import as_data
from ortilo_drake.scenario import load_scenario
from ortilo_drake.studies.late.late_flights import (
    AT_30_HZ,
    BOTH_WAYS_AT_30_HZ,
    BOTH_WAYS_AT_100_HZ,
    ERRORS,
    MODES,
    LateLinks,
    LateReport,
    late_flights,
    mode_report,
    paired,
)
from ortilo_drake.views.numbers import table

FAULTS = "{loss: 0.2, delay: 0.04, spread: 0.02}"
TOLD = 0.077  # from a tick to when its command acts behind the relay at 30 Hz, which a delay that is told is [s]
DELAYS = range(6)  # ticks
PORT = 7680  # first of six UDP ports
BAD, NONE = Faults(loss=0.2, delay=0.04, spread=0.02), Faults()
CASES = [
    ("nominal_imu_uwb_yolo", 30, BAD),
    ("nominal_imu_uwb_yolo", 30, NONE),
    ("nominal_imu_uwb_yolo", 100, BAD),
    ("nominal_imu_uwb", 30, BAD),
]


def late_table(reports: Iterable[LateReport]) -> list[str]:
    """Return the reports of late_flights as a Markdown table, a row for each scenario and mode."""
    header = ["scenario", "estimator.delay", "lost", "path MSE", "path distance MSE", "estimation MSE", "NEES"]
    rows = []
    for report in reports:
        what = f"{report.scenario}, {report.control_rate:g} Hz, {_late(report.links)}"
        what += f", flown by {report.flown_by}" if report.flown_by else ""
        for mode, found in report.modes.items():
            against = report.against[mode]["path_mse"] if mode in report.against else None
            rows.append(
                [what, mode, f"{found.lost} of {found.flights}"]
                + [f"{getattr(found, name):.4f}" for name in ERRORS]
                + [f"{found.nees:.2f}"]
                + [f"{against.better} of {against.pairs}, p = {against.p:.1g}" if against else ""]
            )
    return table([*header, "replay better"], rows)


def _late(links: LateLinks | str) -> str:
    if isinstance(links, str):
        return links
    return "both ways" if links.command_loss or links.command_delay else "sensors only"


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
        world_bus, onboard_bus = (f"tcp://127.0.0.1:{port + 2 * i + side}" for side in (0, 1))
        words = (*flown, "--seed", str(seed), "--set", f"estimator.delay={mode}")
        buses = ("--url-world", world_bus, "--url-onboard", onboard_bus)
        others.append(start("relay", way, FAULTS, "--seed", str(seed + 1), *buses))
        others.append(start("onboard", *words, "--url", onboard_bus))
        files = ("--out", str(done.with_suffix(".nc")), "--json", str(done.with_suffix(".timing")))
        worlds[mode] = start("world", *words, "--url", world_bus, *files, *seconds)
    try:
        for mode, world in worlds.items():
            said = world.communicate()[1]
            if world.returncode:
                raise SystemExit(f"{mode}, seed {seed}: {said.strip()}")
            done = out / f"{mode}_{seed}.json"
            done.write_text(summary_text(summary(load_flight(done.with_suffix(".nc")))))
            done.with_suffix(".nc").unlink()  # 2 MB each
    finally:
        for process in (*worlds.values(), *others):
            process.terminate()
            process.wait()


def report(name: str, rate: float, links: str, flown: dict[str, list[Summary]]) -> LateReport:
    """Return how the modes compare over the seeds, as late_flights does."""
    return LateReport(
        scenario=name,
        control_rate=rate,
        seeds=list(range(len(flown["replay"]))),
        links=links,
        modes={mode: mode_report(mode, flown[mode]) for mode in MODES},
        against={mode: paired(flown["replay"], flown[mode]) for mode in ("ignore", "drop")},
        flown_by="",
    )


def settings_at(rate: float) -> tuple[str, ...]:
    """Return the settings of a flight at a rate [Hz]: the position sensors send on every third tick."""
    third = f"{rate / 3}"
    return ("camera.kind=projected", f"control_rate={rate}", f"uwb.link.rate={third}", f"camera.link.rate={third}")


def in_virtual_time(seeds: int, out: Path) -> Iterator[LateReport]:
    """Yield the report of each of CASES as it is there."""
    for name, rate, to_world in CASES:
        way = "both ways" if to_world.loss else "sensors only"
        jobs, flown = [], {mode: dict[int, Summary]() for mode in MODES}
        for seed, mode in itertools.product(range(seeds), MODES):
            scenario = load_scenario(name, (*settings_at(rate), f"estimator.delay={mode}")).model_dump_json()
            file = out / f"{name}_{rate}_{way.replace(' ', '_')}" / f"{mode}_{seed}.json"
            jobs.append((scenario, BAD.model_dump_json(), to_world.model_dump_json(), seed, str(file)))

        def take(number: int, found: Summary, flown: dict[str, dict[int, Summary]] = flown) -> None:
            seed, mode = divmod(number, len(MODES))
            flown[MODES[mode]][seed] = found

        run_all(summary_in_virtual_time, jobs, os.cpu_count() or 1, take)
        in_order = {mode: [found[seed] for seed in range(seeds)] for mode, found in flown.items()}
        yield report(name, rate, f"relay, {way}", in_order)


def mean_delay(rate: float, relay: Faults) -> float:
    """Return from a tick to when its command acts [s]: half a tick, the least way there and the mean way back."""
    return round(0.5 / rate + 2.0 * relay.delay - relay.spread, 3)


def late_commands(seeds: int, out: Path, name: str, rate: float, relay: Faults) -> Iterator[list[str]]:
    """Yield the rows of each way to allow for late commands, behind the relay's faults both ways."""
    before: list[Summary] = []
    for way, settings in ways(mean_delay(rate, relay)).items():
        scenario = with_way(load_scenario(name, settings_at(rate)), settings).model_dump_json()
        folder = out / f"{name}_{rate:g}_{1e3 * relay.delay:g}_{way.replace(' ', '_').replace(',', '')}"
        faults = relay.model_dump_json(), relay.model_dump_json()
        flown: dict[int, Summary] = {}
        jobs = [(scenario, *faults, seed, str(folder / f"{seed}.json")) for seed in range(seeds)]
        run_all(summary_in_virtual_time, jobs, os.cpu_count() or 1, flown.__setitem__)
        found = [flown[seed] for seed in range(seeds)]
        figures = mode_report(way, found)
        against = paired(found, before)["path_mse"] if before else None
        better = f"{against.better} of {against.pairs}, p = {against.p:.1g}" if against else ""
        before = before or found
        errors = [f"{getattr(figures, error):.4f}" for error in ("path_mse", "estimation_mse")]
        yield [way, f"{figures.lost} of {figures.flights}", *errors, f"{figures.nees:.1f}", better]


def margins(seeds: int, out: Path, name: str, rate: float) -> Iterator[list[str]]:
    """Yield the rows of each way to allow for late commands: the delays it bears, and flights behind delays."""
    scenario = load_scenario(name, settings_at(rate))
    for found in delay_ways(scenario, TOLD, DELAYS, range(seeds), out / "hover", workers=os.cpu_count() or 1):
        high = f"{found.stable.high:.2f}" if found.stable.high is not None else "no end"
        in_ms = f"{1e3 * found.stable.high * scenario.h:.0f} ms" if found.stable.high is not None else ""
        cells = [_hovering(case.predicted_rms, case.flown_rms, case.lost, case.flights) for case in found.cases]
        yield [found.way, f"{found.stable.low:.2f} to {high}", in_ms, *cells]


def _hovering(predicted: float | None, flown: float | None, lost: int, flights: int) -> str:
    there = "unstable" if predicted is None else f"{100 * predicted:.1f}"
    return f"{there} / " + (f"{lost} of {flights} lost" if lost or flown is None else f"{100 * flown:.1f}")


def simulated(seeds: int, out: Path) -> Iterator[LateReport]:
    """Yield the reports of flights behind the scenario's own links."""
    cases = [
        ("nominal_imu_uwb_yolo", 30, BOTH_WAYS_AT_30_HZ),
        ("nominal_imu_uwb_yolo", 100, BOTH_WAYS_AT_100_HZ),
        ("nominal_imu_uwb_yolo", 30, AT_30_HZ),
        ("nominal_imu_uwb", 30, BOTH_WAYS_AT_30_HZ),
    ]
    for name, rate, links in cases:
        scenario = load_scenario(name, settings_at(rate))
        yield late_flights(scenario, range(seeds), out, links, os.cpu_count() or 1)


def in_real_time(seeds: int, out: Path, name: str, rate: float, seconds: float | None, one_way: bool) -> LateReport:
    """Return the report of flights in processes, three at a time."""
    words = (name, *(word for setting in settings_at(rate) for word in ("--set", setting)))
    for seed in range(seeds):
        end = () if seconds is None else ("--seconds", str(seconds))
        fly_modes(words, seed, end, out, PORT, "--to-onboard" if one_way else "--faults")
        print(f"{seed + 1} of {seeds} seeds flown", flush=True)
    flown = {mode: [read_summary((out / f"{mode}_{s}.json").read_bytes()) for s in range(seeds)] for mode in MODES}
    return report(name, rate, f"relay in real time, {'sensors only' if one_way else 'both ways'}", flown)


def main() -> None:
    """Fly and print the table, row by row."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--out", type=Path, default=Path("out/late"), help="folder, of one kind of flight")
    parser.add_argument("--simulated", action="store_true")
    parser.add_argument("--real-time", action="store_true", help="with the options that follow")
    parser.add_argument("--scenario", default="nominal_imu_uwb_yolo")
    parser.add_argument("--rate", type=float, default=30.0, help="control_rate [Hz]")
    parser.add_argument("--seconds", type=float, help="end each flight after that long [s]")
    parser.add_argument("--one-way", action="store_true", help="faults only on the way to the onboard half")
    parser.add_argument("--commands", action="store_true", help="late commands, with --scenario and --rate")
    parser.add_argument("--margins", action="store_true", help="the same hovering, with --scenario and --rate")
    parser.add_argument("--relay-delay", type=float, default=BAD.delay, help="mean delay of --commands [s]")
    chosen = parser.parse_args()
    chosen.out.mkdir(parents=True, exist_ok=True)
    if chosen.commands or chosen.margins:
        header = ["commands", "lost", "path MSE", "estimation MSE", "NEES", "path: better than as sent"]
        if chosen.margins:
            header = ["commands", "stable [ticks]", "up to", *(f"{d} ticks: rms [cm]" for d in DELAYS)]
        args = chosen.seeds, chosen.out, chosen.scenario, chosen.rate
        relay = BAD.model_copy(update={"delay": chosen.relay_delay})
        rows = margins(*args) if chosen.margins else late_commands(*args, relay)
        for number, row in enumerate(rows):
            print("\n".join(table(header, [row])[2 * (number > 0) :]).strip(), flush=True)
        return
    if chosen.real_time:
        args = chosen.scenario, chosen.rate, chosen.seconds, chosen.one_way
        reports: Iterable[LateReport] = [in_real_time(chosen.seeds, chosen.out, *args)]
    else:
        reports = (simulated if chosen.simulated else in_virtual_time)(chosen.seeds, chosen.out)
    done = []
    for found in reports:
        done.append(found)
        print("\n".join(late_table([found])[len(done) > 1 and 2 :]), flush=True)
        (chosen.out / "report.json").write_text(json.dumps(as_data(done), indent=2))


if __name__ == "__main__":
    main()
