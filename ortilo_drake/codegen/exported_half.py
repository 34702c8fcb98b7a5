"""An exported onboard half in flight: its program runs here or in an emulator, and answers tick by tick."""

import json
import shutil
import subprocess
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np

from ortilo_drake.codegen.c_header import c_name
from ortilo_drake.codegen.half import Half, onboard_half
from ortilo_drake.codegen.targets import TARGETS
from ortilo_drake.flight.signals import Signals
from ortilo_drake.flight.stepped_halves import OnboardHalf, WorldHalf
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario
from ortilo_drake.sensors.described import port_of

COMPARED: Final = ("control", "estimate", "covariance")
FNV: Final = (1469598103934665603, 1099511628211)  # offset and prime of the 64-bit hash of Fowler, Noll and Vo


def hash_of(words: np.ndarray) -> int:
    """Return the FNV-1a hash of 64-bit integers, each hashed as one number."""
    found = FNV[0]
    for word in words:
        found = ((found ^ int(word)) * FNV[1]) & (2**64 - 1)
    return found


def inputs_of(half: Half, messages: Signals) -> np.ndarray:
    """Return the inputs of a tick from its messages, one after the other as in the C struct (i)."""
    found, at = np.zeros(sum(half.inputs.values())), 0
    for box, size in half.inputs.items():
        said = messages.get(c_name(box), messages.get(port_of(box)))
        if said is not None:
            found[at : at + size] = said
        at += size
    return found


@lru_cache(maxsize=1)
def flown_ticks(scenario: Scenario, ticks: int) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Fly a scenario in Drake; return the inputs of each tick (ticks x i) and each compared output (ticks x n).

    The last flight is kept, because it is the same for all processors. Errors as in onboard_half.
    """
    half, world, onboard = onboard_half(scenario), WorldHalf(scenario), OnboardHalf(scenario)
    came = np.zeros((ticks, sum(half.inputs.values())))
    went = {name: np.zeros((ticks, half.outputs[name].size)) for name in COMPARED}
    for k in range(ticks):
        messages = world.sample()
        came[k] = inputs_of(half, messages)
        onboard.receive(messages)
        outputs = onboard.outputs()
        for name in COMPARED:
            went[name][k] = outputs[name].ravel()
        world.advance(outputs["control"])
        onboard.advance()
    return came, went


def words_text(name: str, values: np.ndarray) -> str:
    """Return the C definition of an array with the bits of floats, a row for each tick."""
    kind = np.dtype(f"u{values.itemsize}")
    rows = np.ascontiguousarray(values).view(kind)
    text = ",\n".join("{" + ",".join(f"0x{word:x}u" for word in row) + "}" for row in rows)
    return f"static const {kind}_t {name}[{rows.shape[0]}][{rows.shape[1]}] = {{\n{text}}};\n"


def golden_text(came: np.ndarray, went: dict[str, np.ndarray], single: bool = False) -> str:
    """Return the text of golden.h: the bits of inputs, control and estimate, and a hash of the covariance.

    In single precision the bits are the ones of the nearest floats, and there is no hash.
    """
    kind = np.float32 if single else np.float64
    bits = f"the bits of {'floats' if single else 'doubles'}"
    text = f"/* What came in and what must go out, as {bits}. */\n#include <stdint.h>\n#define TICKS {len(came)}\n"
    for name, values in {"inputs": came, "control": went["control"], "estimate": went["estimate"]}.items():
        text += words_text(f"golden_{name}", values.astype(kind))
    if single:
        return text
    hashes = ",\n".join(f"0x{hash_of(row):x}u" for row in went["covariance"].view(np.uint64))
    return text + f"static const uint64_t golden_covariance[TICKS] = {{\n{hashes}}};\n"


TEMPLATES: Final = Path(__file__).with_name("templates")
STRICT: Final = ("-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Wconversion", "-Werror")
BOARDS: Final = {"cortex-m7": "mps2-an500", "cortex-m4": "mps2-an386"}
MORE: Final = {"cortex-m7": "0x60000000", "cortex-m4": "0x21000000"}  # address of 16 MB on a board, for golden ticks
COMPILER: Final = {
    "cortex-m7": "arm-none-eabi-gcc", "cortex-m4": "arm-none-eabi-gcc", "aarch64": "aarch64-linux-gnu-gcc",
    "x86-64": "gcc",
}  # fmt: skip
EMULATOR: Final = {"cortex-m7": "qemu-system-arm", "cortex-m4": "qemu-system-arm", "aarch64": "qemu-aarch64"}


def programs_of(target: str) -> list[str]:
    """Return the names of the programs that build and run an export for a target."""
    return [COMPILER[target], *([EMULATOR[target]] if target in EMULATOR else [])]


def emulated(target: str, program: str | Path, *options: str) -> list[str]:
    """Return the command that runs a target's program on this machine, with options for the emulator of a board."""
    if target in BOARDS:
        return [EMULATOR[target], "-M", BOARDS[target], "-semihosting", *options, "-kernel", str(program)]
    return [*([EMULATOR[target]] if target in EMULATOR else []), str(program)]


def build(folder: Path, target: str, source: Path, made: Path, flags: Sequence[str] = ()) -> None:
    """Build a program for a target from a C source with a main, and from the exported half in a folder.

    `flags` are further flags of the compiler. InputError if a program that is needed is missing or the compiler fails.
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
    """The exported onboard half of a scenario, with the methods of flight.stepped_halves.OnboardHalf.

    `target` is the processor, `stopped` the number of functions that had to stop in the last tick. InputError if the
    folder holds no export of this scenario, or a program that is needed is missing.
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
        """End the program of the exported half."""
        self._process.kill()
        self._process.communicate()
        self._room.cleanup()

    def restart(self) -> None:
        """Let the next tick be tick 0 again, with the first state."""
        self._anew = True

    def receive(self, messages: Signals) -> None:
        """Take the messages of this tick and fly the tick."""
        self.take_inputs(inputs_of(self._half, messages))

    def take_inputs(self, inputs: np.ndarray) -> None:
        """Take the inputs of this tick, one after the other as in the C struct (i), and fly the tick."""
        going, coming = self._process.stdin, self._process.stdout
        assert going is not None
        assert coming is not None
        try:
            going.write(np.int32(self._anew).tobytes() + inputs.astype(self.kind).tobytes())
            going.flush()
        except BrokenPipeError:
            pass  # the error is raised below
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
        """Return every output of this tick by name."""
        return dict(self._said)

    def advance(self) -> None:
        """Do nothing: the program has already gone on to the next tick."""


def manifest_in(folder: Path, scenario: Scenario) -> dict[str, Any]:
    """Return the manifest of the export of a scenario in a folder.

    InputError if there is no manifest, or its scenario has another belief.
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
