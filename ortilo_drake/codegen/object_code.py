"""Object code of IR for a processor."""

import re
from collections.abc import Iterable

import llvmlite.binding as llvm

from ortilo_drake.codegen.targets import Target
from ortilo_drake.model.typed_yaml import InputError

# What a processor's C library computes exactly, so that every library has the same bits of it.
EXACT = "sqrt|fmod|floor|ceil|trunc|rint|nearbyint|round"
# What else it computes it rounds otherwise than the library that Python flies with.
LIBRARY = re.compile(
    rf"llvm\.(?:a?(?:sin|cos|tan)h?|atan2|sincos\w*|(?:exp|log)(?:2|10)?|powi?)\.|(?!llvm\.|ortilo_|(?:{EXACT})f?$)"
)
IN_REGISTERS = "arm_aapcs_vfpcc"  # how a function of ARM takes doubles where the triple ends with 'hf'


def object_code(irs: dict[str, str], target: Target, level: int = 2) -> bytes:
    """Return the object file of neutral IR; the names by which the IR is given are seen by a linker, no others.

    Raises:
        InputError: if this LLVM was built without the processor, or if code for another than x86-64 calls its library.
    """
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    try:
        found = llvm.Target.from_triple(target.triple)
    except RuntimeError as error:
        raise InputError(f"--target: {target.cpu}: {error}") from None
    reloc = "static" if target.is_arm32 else "pic"
    machine = found.create_target_machine(
        cpu=target.cpu, features=target.features, opt=level, reloc=reloc, codemodel="default"
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
    options = llvm.create_pipeline_tuning_options(speed_level=level)
    options.loop_vectorization = options.slp_vectorization = False
    for _ in range(2):  # the second sees what the first found unreachable
        builder = llvm.create_pass_builder(machine, options)
        builder.getModulePassManager().run(whole, builder)
    for name in [its.name for its in whole.functions if its.is_declaration and LIBRARY.match(its.name)]:
        if target.cpu != "x86-64":
            caller = next(its.name for its in whole.functions if not its.is_declaration and f"@{name}(" in str(its))
            raise InputError(f"export: {caller}: calls {name} of the processor's library, which has other bits")
    code: bytes = machine.emit_object(whole)
    return with_any_float_abi(code) if target.is_arm32 else code


def linked(irs: Iterable[str], target: Target, layout: str) -> llvm.ModuleRef:
    """Return one module of all IR, for a processor."""
    whole = None
    for ir in irs:
        module = llvm.parse_assembly(with_hard_floats(ir, target) if target.is_arm32 else ir)
        module.triple, module.data_layout = target.triple, layout
        if whole is None:
            whole = module
        else:
            whole.link_in(module)
    return whole


def with_any_float_abi(code: bytes) -> bytes:
    """Return an object file of ARM marked as compatible with both ABIs of floats.

    llvmlite cannot say it. The attribute Tag_ABI_FP_number_model (23) = 3 is overwritten by Tag_ABI_VFP_args (28) = 3,
    "compatible with both", of "ABI for the Arm Architecture: Addenda". What is exported takes no floats by value.
    """
    at = code.index(b"aeabi\x00")
    told = code.index(bytes((23, 3)), at)
    return code[:told] + bytes((28, 3)) + code[told + 2 :]


def with_hard_floats(ir: str, target: Target) -> str:
    """Return IR in which an ARM of 32 bits calls exact functions of its library as the library takes numbers.

    LLVM would hand them over in other registers, without a word. No ARM has a remainder; one without doubles has no
    square root of doubles, and does not round floats either. What is exported takes pointers and whole numbers alone,
    and is the same either way.
    """
    for kind, bits, suffix in (("double", "f64", ""), ("float", "f32", "f")):
        remainder = rf"= frem ((?:\w+ )*?){kind} ([^,\s]+), ([^,\s]+)"
        if re.search(remainder, ir):
            ir = re.sub(remainder, rf"= call \1{IN_REGISTERS} {kind} @fmod{suffix}({kind} \2, {kind} \3)", ir)
            ir += f"\ndeclare {IN_REGISTERS} {kind} @fmod{suffix}({kind}, {kind})\n"
        if target.rounds_in_library:
            own = EXACT if kind == "double" else EXACT.removeprefix("sqrt|")
            ir = re.sub(
                rf"declare {kind} @llvm\.({own})\.{bits}\(.*", rf"declare {IN_REGISTERS} {kind} @\1{suffix}({kind})", ir
            )
            ir = re.sub(
                rf"call ((?:\w+ )*?){kind} @llvm\.({own})\.{bits}\(", rf"call \1{IN_REGISTERS} {kind} @\2{suffix}(", ir
            )
    return ir
