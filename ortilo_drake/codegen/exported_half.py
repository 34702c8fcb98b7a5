"""An exported onboard half in flight: its program, on this processor or an emulated one, asked tick by tick."""

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
    """Return the hash FNV-1a of whole numbers of 64 bits, taken as one number each."""
    found = FNV[0]
    for word in words:
        found = ((found ^ int(word)) * FNV[1]) & (2**64 - 1)
    return found


def inputs_of(half: Half, messages: Signals) -> np.ndarray:
    """Return a tick's inputs as they lie in C, one after the other, of its messages."""
    found, at = np.zeros(sum(half.inputs.values())), 0
    for box, size in half.inputs.items():
        said = messages.get(c_name(box), messages.get(port_of(box)))
        if said is not None:
            found[at : at + size] = said
        at += size
    return found


@lru_cache(maxsize=1)
def flown_ticks(scenario: Scenario, ticks: int) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return the inputs of each tick, one after the other (ticks, i), and each output (ticks, n), as Drake flies it.

    The last flight, of the scenario's seed, is kept: it is that of all processors. InputError as onboard_half.
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
    """Return an array of C of floats' bits, a row a tick."""
    kind = np.dtype(f"u{values.itemsize}")
    rows = np.ascontiguousarray(values).view(kind)
    text = ",\n".join("{" + ",".join(f"0x{word:x}u" for word in row) + "}" for row in rows)
    return f"static const {kind}_t {name}[{rows.shape[0]}][{rows.shape[1]}] = {{\n{text}}};\n"


def golden_text(came: np.ndarray, went: dict[str, np.ndarray], single: bool = False) -> str:
    """Return golden.h: the inputs' bits, the control's and the estimate's, and a hash of the covariance.

    In single precision, the bits of the doubles' nearest floats, and no hash.
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
