"""What an exported onboard half costs on a flight controller: code, memory, stack, and instructions a tick under qemu.

    python benchmarks/bench_export.py [--smoke] [--ticks 300]

qemu counts one instruction as a nanosecond (-icount shift=0), and the boards' counters run at 25 MHz: a count is 40
instructions. Real processors take about one to two cycles for an instruction of these. Needs what `make setup EXPORT=1`
installs.
"""

import argparse
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from ortilo_drake.codegen.export import export
from ortilo_drake.codegen.exported_half import BOARDS, build
from ortilo_drake.codegen.half import onboard_half
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario, scenario_names

COST: Final = Path(__file__).parents[1] / "tests" / "codegen" / "cortex_m" / "cost.c"
PER_COUNT: Final = 40


def exportable() -> list[Scenario]:
    """Return the ready-made scenarios that can be exported."""
    found = []
    for name in scenario_names():
        scenario = load_scenario(name, "camera.kind=projected")
        try:
            onboard_half(scenario)
        except InputError:
            continue
        found.append(scenario)
    return found


def cost(scenario: Scenario, target: str, ticks: int) -> list[str]:
    """Return a row: scenario, target, code, RAM and stack [bytes], instructions of a tick, mean and most."""
    with TemporaryDirectory() as folder:
        manifest = export(scenario, target, folder, ticks)
        build(Path(folder), target, COST, Path(folder) / "cost", ["-Wno-error"])  # it looks below its own stack
        said = subprocess.run(["arm-none-eabi-size", "ortilo_elements.o"], cwd=folder, check=True, capture_output=True)
        code = said.stdout.split()[6].decode()
        qemu = ("qemu-system-arm", "-M", BOARDS[target], "-nographic", "-semihosting", "-icount", "shift=0")
        done = subprocess.run([*qemu, "-kernel", "cost"], cwd=folder, check=True, capture_output=True, text=True)
    mean, most, stack = map(int, done.stdout.split())
    counts = f"{PER_COUNT * mean:,}", f"{PER_COUNT * most:,}"
    return [scenario.name, target, f"{int(code):,}", f"{manifest['ram_bytes']:,}", f"{stack:,}", *counts]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--smoke", action="store_true", help="one scenario, 20 ticks")
    parser.add_argument("--ticks", type=int, default=300)
    given = parser.parse_args()
    scenarios = [load_scenario("nominal_imu_uwb")] if given.smoke else exportable()
    print("| scenario | target | code | RAM | stack | instructions a tick | most |\n|---|---|---|---|---|---|---|")
    for scenario in scenarios:
        for target in BOARDS:
            print(f"| {' | '.join(cost(scenario, target, 20 if given.smoke else given.ticks))} |", flush=True)


if __name__ == "__main__":
    main()
