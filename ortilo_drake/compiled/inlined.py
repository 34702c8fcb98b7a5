"""How numba compiles a function that only compiled code calls, and that is linked into its callers.

By default numba optimises such a function and makes machine code of it, and then does both again in each caller.
Here it stays as it was lowered, or is optimised once if it is njit, without the wrappers that Python and C call.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache, partial
from types import SimpleNamespace
from typing import Any

import llvmlite.binding as llvm
from numba.core import ir
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_lock import global_compiler_lock
from numba.core.compiler_machinery import FunctionPass, LoweringPass, register_pass
from numba.core.registry import CPUDispatcher
from numba.core.target_extension import jit_registry, target_registry
from numba.core.typed_passes import AnnotateTypes
from numba.core.untyped_passes import TranslateByteCode

from ortilo_drake.compiled.shorter import shorter_ways

NO_WRAPPERS = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
OPTIONS = {"forceinline": True, **NO_WRAPPERS}


class OnlyLinked(JITCodeLibrary):
    """Code to be linked into other code; it has no addresses of its own."""

    @property
    def codegen(self) -> Any:
        """Stands in for numba's codegen, which would write the environment's address into machine code."""
        return SimpleNamespace(set_env=lambda name, environment: None)

    def _optimize_functions(self, module: llvm.ModuleRef) -> None:
        """Do what numba does to what is defined; it makes its passes anew for each function, declared ones as well."""
        module.data_layout = self._codegen._data_layout
        passes, builder = self._codegen._function_pass_manager()
        for its in module.functions:
            if not its.is_declaration:
                passes.run(its, builder)

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        for its in self._final_module.functions:
            if not its.is_declaration and its.linkage == llvm.Linkage.external:
                its.linkage = "linkonce_odr"
        self._shared_module = self._final_module  # callers link this, not a copy: nobody else needs it
        self._finalized = True


class OnceOptimised(OnlyLinked):
    """Likewise of a longer function, optimised once before its callers are."""

    def _optimize_final_module(self) -> None:
        vectorize, level = self._codegen._loopvect, self._codegen._opt_level
        passes, builder = self._codegen._module_pass_manager(loop_vectorize=vectorize, opt=level, cost="cheap")
        passes.run(self._final_module, builder)


@register_pass(mutates_CFG=False, analysis_only=False)
class KeepLowered(LoweringPass):
    """Lowers into code that is only linked into other code."""

    _name = "keep_lowered"

    def __init__(self) -> None:
        LoweringPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        """Give the function its library; numba makes one where there is none."""
        name = state.func_id.func_qualname
        state.library = state.pipeline.library(state.targetctx.codegen(), name)
        return True


@cache
def only_linked(function: CPUDispatcher, counts: bool, checks: bool) -> CPUDispatcher:
    """Return an njit function as elements call it: one for those that count references, and for those that do not.

    Where they check indices, it checks its own too.
    """
    options = OPTIONS | function.targetoptions | ({"boundscheck": True} if checks else {})
    return CPUDispatcher(function.py_func, function.locals, options, pipeline_class=Linked)


@register_pass(mutates_CFG=False, analysis_only=False)
class CallOnlyLinked(FunctionPass):
    """Has a function call njit functions in their form that is only linked."""

    _name = "call_only_linked"

    def __init__(self) -> None:
        FunctionPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        """Change the njit functions among the globals that a function reads."""
        read = [its.value for block in state.func_ir.blocks.values() for its in block.find_insts(ir.Assign)]
        called = [its for its in read if isinstance(its, ir.Global | ir.FreeVar)]
        called = [its for its in called if isinstance(its.value, CPUDispatcher)]
        for its in called:
            its.value = only_linked(its.value, bool(state.flags.nrt), bool(state.flags.boundscheck))
        return bool(called)


class Calling(CompilerBase):
    """numba's compiler for a function that Python calls; the njit functions that it calls are only linked into it."""

    library: Any = None

    def define_pipelines(self) -> list[Any]:
        """Return numba's passes, with CallOnlyLinked and, where there is a library, KeepLowered among them."""
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.add_pass_after(CallOnlyLinked, TranslateByteCode)
        if self.library:
            passes.add_pass_after(KeepLowered, AnnotateTypes)  # the last one before the lowering
        passes.finalize()
        return [passes]


class Inlined(Calling):
    """The same compiler for a function that is itself only linked into its callers."""

    library = OnlyLinked


class Linked(Inlined):
    """The same compiler for njit functions, which are longer and are optimised once before they are linked."""

    library = OnceOptimised


@contextmanager
def helpers_only_linked(checks: bool = False) -> Iterator[None]:
    """Compile what is register_jitable, and NumPy's functions as numba has them, in the same way meanwhile.

    Python cannot call what numba makes of them, only its callers' code can. They check indices where `checks` is true:
    numba hands its other options from a caller to what it calls, but not this one.
    """
    processor = target_registry["cpu"]
    with global_compiler_lock:
        usual = jit_registry.pop(processor)  # only what is not there can be set
        jit_registry[processor] = partial(usual, pipeline_class=Inlined, boundscheck=checks or None, **OPTIONS)
        try:
            with shorter_ways():
                yield
        finally:
            del jit_registry[processor]
            jit_registry[processor] = usual
