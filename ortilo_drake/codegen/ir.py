"""The compiled functions of elements as LLVM IR that belongs to no processor.

numba writes IR for the processor that it runs on. A separate process, told that its processor is a generic one, writes
IR for any processor. Calls into Python that would raise an exception become unreachable: C has no exceptions, and the
tests run the same code with exceptions.
"""

import json
import os
import pickle
import re
import subprocess
import sys
from dataclasses import replace
from functools import lru_cache
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import Final

from numba import cloudpickle

from ortilo_drake.codegen.half import onboard_half
from ortilo_drake.codegen.single import compute_in_floats, narrow_record, with_whole_words
from ortilo_drake.loop.element import Element
from ortilo_drake.loop.native import known_to, native_text
from ortilo_drake.model.parts import load_plugin, plugin_files
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario

GENERIC: Final = {
    "NUMBA_CPU_NAME": "generic",
    "NUMBA_CPU_FEATURES": "",
    "NUMBA_LOOP_VECTORIZE": "0",
    "NUMBA_SLP_VECTORIZE": "0",
}
RAISES: Final = re.compile(r"^(?:Py\w+|_Py\w+|numba_(?:unpickle|runtime_build_excinfo_struct|fatal_error))$")
COUNTED: Final = {
    "NRT_incref", "NRT_decref", "NRT_MemInfo_alloc_aligned", "NRT_MemInfo_alloc", "NRT_Allocate", "NRT_Free",
}  # fmt: skip
ROOM: Final = "ptr %ortilo_room"
# An array that a function makes lies in the room, memory that the caller lends (templates/room.c). References to the
# array are counted here, because numba's own counting is for x86 only. Strings are made only where Python would raise:
# their allocation (NRT_MemInfo_alloc) returns null, so that the function stops. NRT_Allocate returns memory without a
# count, behind the 32 bytes of a block: for exceptions, and for the copy of a part of an array that is written to
# another part of the same array (x[:3] /= 2.0).
COUNTING: Final = f"""
declare ptr @ortilo_take(ptr, i64)
declare void @ortilo_give(ptr, ptr)
define internal ptr @NRT_MemInfo_alloc_aligned({ROOM}, i64 %size, i32 %align) alwaysinline {{
  %made = call ptr @ortilo_take({ROOM}, i64 %size)
  ret ptr %made
}}
define internal ptr @NRT_MemInfo_alloc({ROOM}, i64 %size) alwaysinline {{
  ret ptr null
}}
define internal ptr @NRT_Allocate({ROOM}, i64 %size) alwaysinline {{
  %made = call ptr @ortilo_take({ROOM}, i64 %size)
  %none = icmp eq ptr %made, null
  %data = getelementptr i8, ptr %made, i64 32
  %said = select i1 %none, ptr null, ptr %data
  ret ptr %said
}}
define internal void @NRT_Free({ROOM}, ptr %given) alwaysinline {{
  %made = getelementptr i8, ptr %given, i64 -32
  call void @ortilo_give({ROOM}, ptr %made)
  ret void
}}
define internal void @NRT_incref({ROOM}, ptr %held) {{
  %none = icmp eq ptr %held, null
  br i1 %none, label %done, label %count
count:
  %holders = load i64, ptr %held
  %more = add i64 %holders, 1
  store i64 %more, ptr %held
  br label %done
done:
  ret void
}}
define internal void @NRT_decref({ROOM}, ptr %held) {{
  %none = icmp eq ptr %held, null
  br i1 %none, label %done, label %count
count:
  %holders = load i64, ptr %held
  %fewer = sub i64 %holders, 1
  store i64 %fewer, ptr %held
  %last = icmp eq i64 %fewer, 0
  br i1 %last, label %free, label %done
free:
  call void @ortilo_give({ROOM}, ptr %held)
  br label %done
done:
  ret void
}}
"""
# numba asks a C function whether an array can be read in another shape. A contiguous array always can.
RESHAPE: Final = """
define internal i32 @numba_attempt_nocopy_reshape(i64 %nd, ptr %dims, ptr %strides, i64 %newnd, ptr %newdims,
                                                  ptr %newstrides, i64 %size, i32 %by_column) alwaysinline {
entry:
  br label %next
next:
  %i = phi i64 [ %newnd, %entry ], [ %j, %body ]
  %stride = phi i64 [ %size, %entry ], [ %wider, %body ]
  %more = icmp sgt i64 %i, 0
  br i1 %more, label %body, label %done
body:
  %j = sub i64 %i, 1
  %at = getelementptr i64, ptr %newstrides, i64 %j
  store i64 %stride, ptr %at
  %of = getelementptr i64, ptr %newdims, i64 %j
  %dim = load i64, ptr %of
  %wider = mul i64 %stride, %dim
  br label %next
done:
  ret i32 1
}
"""


def symbol_of(box: str, what: str) -> str:
    """Return the C name of a box's function."""
    return f"ortilo_{box}_{what}"


def box_ir(box: str, element: Element, single: bool) -> dict[str, str]:
    """Return the IR of a box's functions by their C names, as numba makes it in this process, in floats if `single`.

    InputError if a function calls code that needs Python.
    """
    module = ModuleType("ortilo_exported")
    vars(module).update(known_to(replace(element, checked=False)))
    text = native_text(element).replace("cache=True", "cache=False")
    if single:
        text = text.replace("from_dtype(", "narrow_record(")
        vars(module)["narrow_record"] = narrow_record
    exec(compile(text, f"<{element.name}>", "exec"), vars(module))
    found = {}
    for what in element.functions:
        its = getattr(module, f"{what}_c")
        symbol = symbol_of(box, what)
        ir = its._library.get_llvm_str()
        found[symbol] = neutral(with_whole_words(ir) if single else ir, what, symbol)
        if element.name == "own" and makes_arrays(found[symbol]):
            raise InputError(f"export: {box}: {what} makes arrays while it flies: an element of your own must not")
    return found


def makes_arrays(ir: str) -> bool:
    """Return whether functions make arrays in the room that the caller lends."""
    return "@ortilo_take(" in ir


def neutral(ir: str, what: str, symbol: str) -> str:
    """Return numba's IR of `what` (`out` or `step`), changed to belong to no processor and to call no Python.

    The C function `symbol` takes (room, arguments); it returns 0, or another number if it had to stop. InputError if
    the function calls code that needs Python.
    """
    ir = re.sub(r"^target (?:datalayout|triple) = .*$", "", ir, flags=re.M)
    ir = re.sub(r'"(?:target-cpu|target-features|tune-cpu)"="[^"]*"', "", ir)
    for kind, name, own in (("double", "sqrt", "llvm.sqrt.f64"), ("float", "(?:sqrtf|sqrt)", "llvm.sqrt.f32")):
        if re.search(rf"declare {kind} @{name}\({kind}", ir):  # use the processor's instruction, exact on all targets
            ir = re.sub(rf"call ((?:\w+ )*?){kind} @{name}\(", rf"call \1{kind} @{own}(", ir)
            ir = re.sub(rf"declare {kind} @(?:{re.escape(own)}|{name})\({kind}.*", "", ir)
            ir += f"\ndeclare {kind} @{own}({kind})\n"
    # Pointers in structs take eight bytes, as the IR's offsets assume.
    ir = re.sub(r"alloca \{[^}]*\}", lambda found: re.sub(r"\bptr\b", "i64", found[0]), ir)
    lines, skipping, makes = list[str](), False, False
    for line in ir.splitlines():
        defined = re.match(r'define .*?@"?((?:NRT_|cfunc\.)\w+)"?', line)
        declared = re.match(r'declare (.*?)@"?([\w.]+)"?\((.*)\)', line)
        if defined:
            skipping = True
        elif skipping:
            skipping = line != "}"
        elif declared and RAISES.match(declared[2]):
            said = re.sub(r"\b(?:noalias|noundef|nonnull|dso_local|local_unnamed_addr)\b", "", declared[1]).strip()
            lines += [f"define internal {said} @{declared[2]}({declared[3]}) {{", "  unreachable", "}"]
        elif declared and declared[2] == "numba_attempt_nocopy_reshape":
            lines.append(RESHAPE)
        elif declared and declared[2] in COUNTED:
            makes = True
        elif declared and re.match(r"NRT_MemInfo_call_dtor|numba_(?:do_raise|gil_ensure|gil_release)", declared[2]):
            pass
        elif declared and re.match(r"NRT_|numba_|_?Py", declared[2]):
            raise InputError(f"export: {symbol}: calls {declared[2]}: needs Python, or memory while it flies")
        elif not (declared and declared[2].startswith("llvm.x86.")):
            lines.append(line)
    ir = "\n".join(lines)
    makes |= "@NRT_" in ir
    return with_room(ir, what, symbol) + (COUNTING if makes else "")


def with_room(ir: str, what: str, symbol: str) -> str:
    """Return IR in which every function also takes the room, with a C function `symbol` that calls `what`."""
    head = re.search(rf'^define [^@]*@"?(_ZN\w*?\d+{what}_c\w*)"?\((.*)\)', ir, flags=re.M)
    assert head is not None, symbol
    names = {*re.findall(r'^define [^@]*@"?([\w.]+)"?\(', ir, flags=re.M)}
    names = {name for name in names if name.startswith(("_ZN", "__excinfo"))} | COUNTED
    taking = re.compile(r'@"?([\w.]+)"?\((?=(\)?))')
    ir = taking.sub(lambda at: f"@{at[1]}({ROOM}{'' if at[2] else ', '}" if at[1] in names else at[0], ir)
    taken = re.findall(r"(ptr|i64) (?:[^%,]*(?:\([^)]*\))?[^%,]*)?(%[\w.]+)", head[2])[2:]
    said = "".join(f", {kind} {name}" for kind, name in taken)
    return f"""{ir}
define i32 @{symbol}({ROOM}{said}) {{
  %ortilo_said = alloca i64
  %ortilo_why = alloca i64
  %ortilo_status = call i32 @{head[1]}({ROOM}, ptr %ortilo_said, ptr %ortilo_why{said})
  ret i32 %ortilo_status
}}
"""


@lru_cache(maxsize=4)
def neutral_irs(scenario: Scenario, single: bool = False) -> dict[str, str]:
    """Return the IR of all functions of a scenario's onboard half, made in a new process, in floats if `single`.

    Errors as in onboard_half and box_ir.
    """
    elements = [(box.name, box.element) for box in onboard_half(scenario).wiring.boxes.values()]
    told = pickle.dumps((single, plugin_files(), cloudpickle.dumps(elements)))
    with TemporaryDirectory() as compiled:
        around = os.environ | GENERIC | ({"NUMBA_CACHE_DIR": compiled} if single else {})
        command = (sys.executable, "-m", "ortilo_drake.codegen.ir")
        done = subprocess.run(command, input=told, capture_output=True, check=False, env=around)
    said = done.stderr.decode(errors="replace").strip()
    if done.returncode == 2:
        raise InputError(said)
    if done.returncode != 0:
        raise RuntimeError(f"the process that compiles ended with code {done.returncode}:\n{said}")
    found: dict[str, str] = json.loads(done.stdout)
    return found


def main() -> int:
    """Read names and elements of boxes from standard input; write the IR of their functions to standard output."""
    single, plugins, elements = pickle.loads(sys.stdin.buffer.read())
    try:
        if single:
            compute_in_floats()
        for file in plugins:
            load_plugin(file)
        found: dict[str, str] = {}
        for name, element in cloudpickle.loads(elements):
            found |= box_ir(name, element, single)
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    json.dump(found, sys.stdout)
    return 0


if __name__ == "__main__":
    sys.exit(main())
