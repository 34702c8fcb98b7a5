"""Object code for a processor, from IR."""

import re
from collections.abc import Iterable

import llvmlite.binding as llvm

from ortilo_drake.codegen.targets import Target
from ortilo_drake.model.typed_yaml import InputError

LEVEL = 2  # optimisation level
# Functions that every C library computes exactly, with the same bits.
EXACT = "sqrt|fmod|floor|ceil|trunc|rint|nearbyint|round"
# All other functions, which a processor's C library rounds differently from the library that Python uses.
LIBRARY = re.compile(
    rf"llvm\.(?:a?(?:sin|cos|tan)h?|atan2|sincos\w*|(?:exp|log)(?:2|10)?|powi?)\.|(?!llvm\.|ortilo_|(?:{EXACT})f?$)"
)


def object_code(irs: dict[str, str], target: Target) -> bytes:
    """Return the object file of neutral IR; a linker sees only the functions named by the keys of `irs`.

    InputError if this LLVM lacks the processor, or code for a processor other than x86-64 calls an inexact function.
    """
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    try:
        found = llvm.Target.from_triple(target.triple)
    except RuntimeError as error:
        raise InputError(f"--target: {target.cpu}: {error}") from None
    reloc = "static" if target.is_arm32 else "pic"
    machine = found.create_target_machine(
        cpu=target.cpu, features=target.features, opt=LEVEL, reloc=reloc, codemodel="default"
    )
    whole = linked(irs.values(), target, str(machine.target_data))
    for function in whole.functions:
        if not function.is_declaration and function.name not in irs:
            function.linkage = "internal"
        if not function.is_declaration and target.is_arm32:
            function.add_function_attribute("optsize")  # flash is small: copies of loops need a fifth more of it
    for variable in whole.global_variables:
        if not variable.is_declaration:
            variable.linkage = "internal"
    whole.verify()
    options = llvm.create_pipeline_tuning_options(speed_level=LEVEL)
    options.loop_vectorization = options.slp_vectorization = False
    for _ in range(2):  # the second pass removes what the first pass made unreachable
        builder = llvm.create_pass_builder(machine, options)
        builder.getModulePassManager().run(whole, builder)
    for name in [its.name for its in whole.functions if its.is_declaration and LIBRARY.match(its.name)]:
        if target.cpu != "x86-64":
            caller = next(its.name for its in whole.functions if not its.is_declaration and f"@{name}(" in str(its))
            raise InputError(f"export: {caller}: calls {name} of the processor's library, which has other bits")
    return bytes(machine.emit_object(whole))


def linked(irs: Iterable[str], target: Target, layout: str) -> llvm.ModuleRef:
    """Return one module for a processor, linked from all IR."""
    whole = None
    for ir in irs:
        module = llvm.parse_assembly(with_own_sums(ir) if target.adds_in_library else ir)
        module.triple, module.data_layout = target.triple, layout
        if whole is None:
            whole = module
        else:
            whole.link_in(module)
    return whole


def with_own_sums(ir: str) -> str:
    """Return IR that adds and subtracts doubles with templates/sum.c, which rounds correctly where libgcc does not."""
    for did, name in (("fadd", "ortilo_sum"), ("fsub", "ortilo_difference")):
        ir, count = re.subn(
            rf"= {did} double ([^,\n]+), ([^,\n]+)$", rf"= call double @{name}(double \1, double \2)", ir, flags=re.M
        )
        if count:
            ir += f"\ndeclare double @{name}(double, double) nounwind willreturn memory(none)\n"
    return ir
