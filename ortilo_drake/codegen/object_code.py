"""Object code of IR for a processor."""

import re
from collections.abc import Iterable

import llvmlite.binding as llvm

from ortilo_drake.codegen.targets import Target
from ortilo_drake.model.typed_yaml import InputError

LEVEL = 2  # of optimisation
# What a processor's C library computes exactly, so that every library has the same bits of it.
EXACT = "sqrt|fmod|floor|ceil|trunc|rint|nearbyint|round"
# What else it computes it rounds otherwise than the library that Python flies with.
LIBRARY = re.compile(
    rf"llvm\.(?:a?(?:sin|cos|tan)h?|atan2|sincos\w*|(?:exp|log)(?:2|10)?|powi?)\.|(?!llvm\.|ortilo_|(?:{EXACT})f?$)"
)


def object_code(irs: dict[str, str], target: Target) -> bytes:
    """Return the object file of neutral IR; the names by which the IR is given are seen by a linker, no others.

    InputError if this LLVM was built without the processor, or if code for another than x86-64 calls its library.
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
            function.add_function_attribute("optsize")  # flash is small there; copies of loops cost a fifth more of it
    for variable in whole.global_variables:
        if not variable.is_declaration:
            variable.linkage = "internal"
    whole.verify()
    options = llvm.create_pipeline_tuning_options(speed_level=LEVEL)
    options.loop_vectorization = options.slp_vectorization = False
    for _ in range(2):  # the second sees what the first found unreachable
        builder = llvm.create_pass_builder(machine, options)
        builder.getModulePassManager().run(whole, builder)
    for name in [its.name for its in whole.functions if its.is_declaration and LIBRARY.match(its.name)]:
        if target.cpu != "x86-64":
            caller = next(its.name for its in whole.functions if not its.is_declaration and f"@{name}(" in str(its))
            raise InputError(f"export: {caller}: calls {name} of the processor's library, which has other bits")
    return bytes(machine.emit_object(whole))


def linked(irs: Iterable[str], target: Target, layout: str) -> llvm.ModuleRef:
    """Return one module of all IR, for a processor."""
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
    """Return IR that adds and subtracts doubles by templates/sum.c, which rounds where libgcc does not."""
    for did, name in (("fadd", "ortilo_sum"), ("fsub", "ortilo_difference")):
        ir, count = re.subn(
            rf"= {did} double ([^,\n]+), ([^,\n]+)$", rf"= call double @{name}(double \1, double \2)", ir, flags=re.M
        )
        if count:
            ir += f"\ndeclare double @{name}(double, double) nounwind willreturn memory(none)\n"
    return ir
