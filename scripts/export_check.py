"""Every tick of every exportable ready-made flight on each processor: control, estimate and covariance bit by bit.

    python scripts/export_check.py [--ticks N] [--targets cortex-m7,aarch64,x86-64] [--kept FILE] [SCENARIO ...]

Prints a line for each flight and processor, and ends with 1 if a bit differs. What was checked is kept in FILE, by
default out/export_check.json, and not checked again before the code changes. Needs what `make setup EXPORT=1`
installs.
"""

import argparse
import hashlib
import json
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from ortilo_drake.codegen.export import export
from ortilo_drake.codegen.exported_half import build, emulated
from ortilo_drake.flight.flyable import flight_ticks
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario, load_scenario, scenario_names

ROOT: Final = Path(__file__).parents[1]


def digest_of_code() -> str:
    """Return a digest of the package's files."""
    files = sorted(file for folder in ("ortilo_drake", "diagrams") for file in (ROOT / folder).rglob("*.*"))
    hashed = hashlib.sha256()
    for file in files:
        if file.suffix in (".py", ".c", ".yaml", ".ld") and "__pycache__" not in file.parts:
            hashed.update(str(file.relative_to(ROOT)).encode() + file.read_bytes())
    return hashed.hexdigest()[:16]


def compared(scenario: Scenario, target: str, ticks: int) -> str:
    """Return what the golden test of so many ticks says on a processor: how many differ.

    Raises:
        InputError: if the scenario cannot be exported.
    """
    with TemporaryDirectory() as name:
        folder = Path(name)
        export(scenario, target, folder, ticks)
        build(folder, target, folder / "test_golden.c", folder / "golden")
        command = emulated(target, folder / "golden", "-nographic")
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.stdout.strip() or f"ended with code {done.returncode}: {done.stderr.strip()}"


def main() -> int:
    """Check the flights."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ticks", type=int, default=0, help="of each flight; 0: the whole")
    parser.add_argument("--targets", default="cortex-m7,aarch64,x86-64")
    parser.add_argument("--kept", type=Path, default=ROOT / "out" / "export_check.json")
    parser.add_argument("scenarios", nargs="*", default=scenario_names())
    given, code, wrong = parser.parse_args(), digest_of_code(), 0
    kept = json.loads(given.kept.read_text()) if given.kept.exists() else {}
    kept = {key: said for key, said in kept.items() if key.endswith(code)}
    for name in given.scenarios:
        scenario = load_scenario(name, "camera.kind=projected")
        ticks = given.ticks or flight_ticks(scenario) + 1
        try:
            for target in given.targets.split(","):
                key = f"{name} {target} {ticks} {code}"
                if key not in kept:
                    kept[key] = compared(scenario, target, ticks)
                    given.kept.parent.mkdir(parents=True, exist_ok=True)
                    given.kept.write_text(json.dumps(kept, indent=1))
                print(f"{name} {target}: {kept[key]}", flush=True)
                wrong += not kept[key].startswith("0 of ")
        except InputError as error:
            print(f"{name}: {error}", flush=True)
            wrong += not str(error).startswith("export: ")  # refused
    return wrong > 0


if __name__ == "__main__":
    sys.exit(main())
