"""The processors for which the onboard half can be exported."""

from typing import Final, NamedTuple

from ortilo_drake.model.typed_yaml import InputError


class Target(NamedTuple):
    """A processor in LLVM's terms."""

    triple: str
    """LLVM's name of architecture, system and calling convention."""
    cpu: str
    """LLVM's name of the least capable processor that must run the code."""
    features: str
    """LLVM's list of features in addition to the cpu's, + for present, - for absent."""
    flags: str
    """gcc's flags for C on this processor."""

    @property
    def is_arm32(self) -> bool:
        """Whether the processor is a 32-bit ARM."""
        return self.triple.endswith("hf")

    @property
    def adds_in_library(self) -> bool:
        """Whether the processor computes doubles in software."""
        return self.cpu == "cortex-m4"


TARGETS: Final = {
    "cortex-m7": Target(
        "thumbv7em-unknown-none-gnueabihf", "cortex-m7", "+fp-armv8d16",
        "-mcpu=cortex-m7 -mthumb -mfloat-abi=hard -mfpu=fpv5-d16",
    ),
    "cortex-m4": Target(
        "thumbv7em-unknown-none-gnueabihf", "cortex-m4", "",
        "-mcpu=cortex-m4 -mthumb -mfloat-abi=hard -mfpu=fpv4-sp-d16",
    ),
    "aarch64": Target("aarch64-none-elf", "generic", "", "-ffp-contract=off"),
    "x86-64": Target("x86_64-unknown-linux-gnu", "x86-64", "", "-ffp-contract=off"),
}  # fmt: skip


def target_of(name: str) -> Target:
    """Return the target of this name; InputError if there is none."""
    if name not in TARGETS:
        raise InputError(f"--target: {name!r}: must be one of {', '.join(TARGETS)}")
    return TARGETS[name]
