"""Processors that the onboard half is exported for."""

from typing import Final, NamedTuple

from ortilo_drake.model.typed_yaml import InputError


class Target(NamedTuple):
    """A processor as LLVM knows it."""

    triple: str
    """its architecture, system and calling convention."""
    cpu: str
    """the least of its kind."""
    features: str
    """beyond those of the cpu; + there, - not."""
    flags: str
    """with which gcc compiles C for it."""

    @property
    def is_arm32(self) -> bool:
        """Whether it is an ARM of 32 bits."""
        return self.triple.endswith("hf")

    @property
    def adds_in_library(self) -> bool:
        """Whether it computes doubles in software."""
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
    """Return a target by its name.

    InputError if there is none of that name, or this LLVM was built without it.
    """
    if name not in TARGETS:
        raise InputError(f"--target: {name!r}: must be one of {', '.join(TARGETS)}")
    return TARGETS[name]
