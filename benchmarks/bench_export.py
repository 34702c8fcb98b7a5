"""What an exported onboard half costs on each processor: code, memory, stack, and instructions a tick under qemu.

    python benchmarks/bench_export.py [--smoke] [--ticks 300] [--built TARGET:PRECISION,...] [SCENARIO ...]

On Arm's boards qemu counts one instruction as a nanosecond (-icount shift=0), and the boards' counters run at 25 MHz: a
count is 40 instructions. For aarch64 and x86-64 a plugin of qemu-user counts (tests/codegen/cortex_m/count.c). Real
processors of the Cortex-M kind take about one to two cycles for an instruction of these. Needs what
`make setup EXPORT=1` installs.
"""

import argparse
import subprocess
from collections.abc import Iterable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from ortilo_drake.codegen.export import export
from ortilo_drake.codegen.exported_half import build, emulated
from ortilo_drake.codegen.half import onboard_half
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario, scenario_names

SOURCES: Final = Path(__file__).parents[1] / "tests" / "codegen" / "cortex_m"
PER_COUNT: Final = 40
BUILT: Final = "cortex-m7:double,cortex-m4:double,cortex-m4:single,aarch64:double,x86-64:double"
SIZE: Final = {"aarch64": "aarch64-linux-gnu-size", "x86-64": "size"}
USER: Final = {"aarch64": "qemu-aarch64", "x86-64": "qemu-x86_64"}


def exportable(names: Iterable[str]) -> list[Scenario]:
    """Return those ready-made scenarios that can be exported."""
    found = []
    for name in names:
        scenario = load_scenario(name, "camera.kind=projected")
        try:
            onboard_half(scenario)
        except InputError:
            continue
        found.append(scenario)
    return found


def cost(scenario: Scenario, target: str, precision: str, ticks: int) -> list[str]:
    """Return a row: scenario, target, precision, code, RAM and stack [bytes], instructions of a tick, mean and most."""
    with TemporaryDirectory() as folder:
        manifest = export(scenario, target, folder, ticks, precision)
        program, room = Path(folder) / "cost", Path(folder)
        build(room, target, SOURCES / "cost.c", program, ["-Wno-error"])  # it looks below its own stack
        sized = [SIZE.get(target, "arm-none-eabi-size"), "ortilo_elements.o"]
        code = subprocess.run(sized, cwd=folder, check=True, capture_output=True).stdout.split()[6].decode()
        if target in USER:
            plugin = ["gcc", "-O2", "-shared", "-fPIC", str(SOURCES / "count.c"), "-o", "count.so"]
            subprocess.run(plugin, cwd=folder, check=True)
            command = [USER[target], "-plugin", str(room / "count.so"), str(program)]
        else:
            command = emulated(target, program, "-nographic", "-icount", "shift=0")
        done = subprocess.run(command, check=True, capture_output=True, text=True)
    mean, most, stack = map(int, done.stdout.split())
    if target in USER:
        mean, most = map(int, done.stderr.split())
    else:
        mean, most = PER_COUNT * mean, PER_COUNT * most
    counts = f"{mean:,}", f"{most:,}"
    return [
        f"`{scenario.name}`",
        target,
        precision,
        f"{int(code):,}",
        f"{manifest['ram_bytes']:,}",
        f"{stack:,}",
        *counts,
    ]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--smoke", action="store_true", help="one scenario, 20 ticks")
    parser.add_argument("--ticks", type=int, default=300)
    parser.add_argument("--built", default=BUILT, help="which targets, each with its precision")
    parser.add_argument("scenarios", nargs="*")
    given = parser.parse_args()
    named = ["nominal_imu_uwb"] if given.smoke else given.scenarios or scenario_names()
    head = ("scenario", "target", "precision", "code", "RAM", "stack", "instructions a tick", "most")
    print(f"| {' | '.join(head)} |\n{'|---' * len(head)}|")
    for scenario in exportable(named):
        for target, precision in (its.split(":") for its in given.built.split(",")):
            try:
                row = cost(scenario, target, precision, 20 if given.smoke else given.ticks)
            except InputError as error:
                row = [f"`{scenario.name}`", target, precision, str(error)]
            print(f"| {' | '.join(row)} |", flush=True)


if __name__ == "__main__":
    main()
