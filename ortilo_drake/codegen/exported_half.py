"""An exported onboard half in flight: its program, on this processor or an emulated one, asked tick by tick."""

import json
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np

from ortilo_drake.codegen.golden import inputs_of
from ortilo_drake.codegen.half import onboard_half
from ortilo_drake.codegen.targets import TARGETS
from ortilo_drake.flight.signals import Signals
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario

TEMPLATES: Final = Path(__file__).with_name("templates")
STRICT: Final = ("-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Wconversion", "-Werror")
BOARDS: Final = {"cortex-m7": "mps2-an500", "cortex-m4": "mps2-an386"}
MORE: Final = {"cortex-m7": "0x60000000", "cortex-m4": "0x21000000"}  # where these boards have 16 MB, for golden ticks
COMPILER: Final = {
    "cortex-m7": "arm-none-eabi-gcc", "cortex-m4": "arm-none-eabi-gcc", "aarch64": "aarch64-linux-gnu-gcc",
    "x86-64": "gcc",
}  # fmt: skip
EMULATOR: Final = {"cortex-m7": "qemu-system-arm", "cortex-m4": "qemu-system-arm", "aarch64": "qemu-aarch64"}


def programs_of(target: str) -> list[str]:
    """Return the programs that build and fly an export for a target."""
    return [COMPILER[target], *([EMULATOR[target]] if target in EMULATOR else [])]


def emulated(target: str, program: str | Path, *options: str) -> list[str]:
    """Return the command that runs a program of a target here, with options for a board's emulator."""
    if target in BOARDS:
        return [EMULATOR[target], "-M", BOARDS[target], "-semihosting", *options, "-kernel", str(program)]
    return [*([EMULATOR[target]] if target in EMULATOR else []), str(program)]


def build(folder: Path, target: str, source: Path, made: Path, flags: Sequence[str] = ()) -> None:
    """Build a program with a main of its own, a C source, for the exported half in a folder and its target.

    The flags are for the compiler, beside those of the target. InputError if the compiler is not there or refuses.
    """
    if missing := [program for program in programs_of(target) if shutil.which(program) is None]:
        raise InputError(f"--exported: {target}: needs {', '.join(missing)} (make setup EXPORT=1)")
    board: list[str | Path] = []
    if target in BOARDS:
        board = ["--specs=rdimon.specs", "-T", TEMPLATES / "link.ld", TEMPLATES / "start.c"]
        board += ["-fdata-sections", f"-Wl,--defsym=MORE={MORE[target]}"]
    files = [source, folder / "ortilo.c", folder / "ortilo_elements.o"]
    link = ["-static"] if target == "aarch64" else []
    command = [COMPILER[target], *STRICT, *TARGETS[target].flags.split(), *link, *flags, "-I", folder, *board, *files]
    done = subprocess.run([*map(str, command), "-lm", "-o", str(made)], capture_output=True, text=True, check=False)
    if done.returncode != 0:
        said = [line for line in done.stderr.splitlines() if "warning: " not in line and "NOTE: " not in line]
        raise InputError(f"--exported: {folder}: {COMPILER[target]}: {next(iter(said), 'failed')}")


class ExportedHalf:
    """The onboard half of a scenario, flown by what was exported of it; as flight.stepped_halves.OnboardHalf.

    `target` is its processor, `stopped` how many functions had to stop in the last tick. InputError if the folder holds
    no export of this scenario, or a program that it needs is not there.
    """

    def __init__(self, scenario: Scenario, folder: str | Path):
        self._half, manifest = onboard_half(scenario), manifest_in(Path(folder), scenario)
        self.target: str = manifest["target"]["name"]
        self.kind = np.dtype(np.float32 if manifest["precision"] == "single" else np.float64)
        self._room = TemporaryDirectory()
        made = Path(self._room.name) / "serve"
        build(Path(folder).resolve(), self.target, TEMPLATES / "serve.c", made)
        command = emulated(self.target, made, "-display", "none", "-monitor", "none", "-serial", "stdio")
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        self._anew, self._said, self.stopped = True, dict[str, np.ndarray](), 0

    def __enter__(self) -> "ExportedHalf":
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()

    def close(self) -> None:
        """End its program."""
        self._process.kill()
        self._process.communicate()
        self._room.cleanup()

    def restart(self) -> None:
        """Begin anew at tick 0 with the next tick."""
        self._anew = True

    def receive(self, messages: Signals) -> None:
        """Take this tick's messages."""
        self.take_inputs(inputs_of(self._half, messages))

    def take_inputs(self, inputs: np.ndarray) -> None:
        """Take this tick's inputs as they lie in C, and fly the tick."""
        going, coming = self._process.stdin, self._process.stdout
        assert going is not None
        assert coming is not None
        try:
            going.write(np.int32(self._anew).tobytes() + inputs.astype(self.kind).tobytes())
            going.flush()
        except BrokenPipeError:
            pass  # it is said below
        self._anew = False
        size = sum(wire.size for wire in self._half.outputs.values())
        answer = coming.read(4 + self.kind.itemsize * size)
        if len(answer) < 4 + self.kind.itemsize * size:
            self._process.wait()
            assert self._process.stderr is not None
            said = self._process.stderr.read().decode(errors="replace")
            raise InputError(f"--exported: {self.target}: ended with code {self._process.returncode}: {said[-2000:]}")
        self.stopped, at = int(np.frombuffer(answer, np.int32, 1)[0]), 0
        values = np.frombuffer(answer, self.kind, offset=4).astype(float)
        for name, wire in self._half.outputs.items():
            self._said[name], at = values[at : at + wire.size], at + wire.size

    def outputs(self) -> Signals:
        """Return every signal of this tick."""
        return dict(self._said)

    def advance(self) -> None:
        """Go on to the next tick: it has, with the answer."""


def manifest_in(folder: Path, scenario: Scenario) -> dict[str, Any]:
    """Return the manifest of an export, which must be of this scenario.

    InputError if there is none, or it is of another belief.
    """
    try:
        manifest: dict[str, Any] = json.loads((folder / "manifest.json").read_text())
    except (OSError, ValueError) as error:
        raise InputError(f"--exported: {folder}: holds no manifest.json of `ortilo export`: {error}") from None
    if Scenario.model_validate_json(json.dumps(manifest["scenario"])).belief != scenario.belief:
        raise InputError(
            f"--exported: {folder}: is an export of {manifest['scenario'].get('name')} with other settings"
        )
    return manifest
