"""The README of an export."""

from typing import Any

from ortilo_drake.codegen.cmake_files import configure_line
from ortilo_drake.codegen.exported_half import programs_of
from ortilo_drake.codegen.half import Half
from ortilo_drake.codegen.targets import target_of
from ortilo_drake.scenario import Scenario

TEXT = """# The onboard half of {name} for {target}

The estimator, servo and path of an ortilo-drake scenario, as they fly in simulation: {same}. No heap, no global
state, no exceptions; two halves may run side by side.

    ortilo_elements.o   object code of {count} functions, a file of {size} bytes
    ortilo.h, ortilo.c  inputs, outputs, numbers and a tick; compile ortilo.c with your own compiler
    golden.h            inputs and outputs of the first ticks of a simulated flight
    test_golden.c       plays them and counts the ticks that differ
    CMakeLists.txt      the library `ortilo` and the test{toolchain}
    manifest.json       the scenario, versions, digest and sizes

    static ortilo half;                       /* {ram} bytes */
    ortilo_init(&half, NULL);
    for (;;) {{                                /* {rate:.6g} times a second */
        ortilo_tick(&half, &inputs, &outputs);  /* 0, or how many functions had to stop */
    }}

A message that did not arrive has `arrived` 0. Its `stamp` counts from tick 0. Every tick takes {inputs} and
gives {outputs}.

**Other gains, noise, anchors or another path**: copy `ortilo_default_numbers`, change it, and hand it to `ortilo_init`.
Shapes stay as they are.

**Save and resume**: `half.state` ({state} bytes) is all that a tick leaves to the next.

**Build and test**, in this folder{needs}:

    {configure}
    cmake --build build
    ctest --test-dir build

Without CMake compile C with `{flags}`. Allow neither fused multiply-adds nor fast mathematics in
ortilo.c; the object code has none.

What remains yours: drivers that fill the inputs with frames and units as ortilo.h says, a clock that calls the tick on
time, a failsafe that takes over when it does not, limits of your actuators, and the mixing of thrust and torques to
rotors. Nobody has flown this on a vehicle.
"""


def readme_text(half: Half, scenario: Scenario, target: str, manifest: dict[str, Any]) -> str:
    """Return the text of the README."""
    cross = "CMAKE_TOOLCHAIN_FILE" in configure_line(target)
    return TEXT.format(
        name=scenario.name,
        same="the same bits" if manifest["precision"] == "double" else "in floats of 32 bits, without any double",
        target=target,
        count=sum(len(box.element.functions) for box in half.wiring.boxes.values()),
        size=manifest["object_bytes"],
        ram=manifest["ram_bytes"],
        state=manifest["state_bytes"],
        rate=1.0 / scenario.h,
        inputs=", ".join(half.inputs),
        outputs=", ".join(half.outputs),
        flags=target_of(target).flags,
        configure=configure_line(target),
        toolchain="\n    toolchain.cmake     how to cross-compile them and run the test under qemu" if cross else "",
        needs=f" (with {' and '.join(programs_of(target))})" if cross else "",
    )
