"""The CMake files of an export: they build its library and golden test, cross-compile and emulate them."""

from typing import Final

from ortilo_drake.codegen.exported_half import BOARDS, COMPILER, EMULATOR, MORE, TEMPLATES
from ortilo_drake.codegen.targets import TARGETS

_FITS: Final = {"aarch64": 'CMAKE_SYSTEM_PROCESSOR MATCHES "aarch64|arm64"',
                "x86-64": 'CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64"'}  # fmt: skip


def cmake_files(target: str) -> dict[str, str]:
    """Return the texts of the CMake files by name: CMakeLists.txt, and the files that another processor needs."""
    lists = (TEMPLATES / "CMakeLists.txt").read_text()
    files = {
        "CMakeLists.txt": lists.replace("@TARGET@", target).replace("@FITS@", _FITS.get(target, "CMAKE_CROSSCOMPILING"))
    }
    if target in EMULATOR:
        files["toolchain.cmake"] = _toolchain(target)
    if target in BOARDS:
        files |= {name: (TEMPLATES / name).read_text() for name in ("start.c", "link.ld")}
    return files


def configure_line(target: str) -> str:
    """Return the command that configures an export's build, for use in the export's folder."""
    return "cmake -S . -B build" + (" -DCMAKE_TOOLCHAIN_FILE=toolchain.cmake" if target in EMULATOR else "")


def _toolchain(target: str) -> str:
    emulator = f"{EMULATOR[target]} -M {BOARDS[target]} -semihosting -nographic -kernel" if target in BOARDS else ""
    lines = [
        f"# Cross-compiles for {target} with {COMPILER[target]}; {EMULATOR[target]} runs what is built.",
        f"set(CMAKE_SYSTEM_NAME {'Generic' if target in BOARDS else 'Linux'})",
        f"set(CMAKE_SYSTEM_PROCESSOR {target})",
        f"set(CMAKE_C_COMPILER {COMPILER[target]})",
        f'set(CMAKE_C_FLAGS_INIT "{TARGETS[target].flags}")',
        f"set(CMAKE_CROSSCOMPILING_EMULATOR {emulator or EMULATOR[target]})",
    ]
    if target in BOARDS:
        lines += [
            "set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY)",
            f"set(ORTILO_EMULATED_RAM {MORE[target]}) # of {BOARDS[target]}, for the golden ticks",
        ]
    else:
        lines.append('set(CMAKE_EXE_LINKER_FLAGS_INIT "-static")')
    return "\n".join(lines) + "\n"
