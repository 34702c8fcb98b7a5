"""How numba compiles a function that is called from one place alone, and is inlined there.

By default numba optimises such a function and makes machine code of it, and then does both again where it is inlined.
Here it stays as it was lowered, without the wrappers that Python and C call.
"""

from types import SimpleNamespace
from typing import Any

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import LoweringPass, register_pass
from numba.core.typed_passes import AnnotateTypes

OPTIONS = {"forceinline": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}


class OnlyLinked(JITCodeLibrary):
    """Code to be linked into other code; it has no addresses of its own."""

    @property
    def codegen(self) -> Any:
        """Stands in for numba's codegen, which would write the environment's address into machine code."""
        return SimpleNamespace(set_env=lambda name, environment: None)

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


@register_pass(mutates_CFG=False, analysis_only=False)
class KeepLowered(LoweringPass):
    """Lowers into code that is only linked into other code."""

    _name = "keep_lowered"

    def __init__(self) -> None:
        LoweringPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        """Give the function its library; numba makes one where there is none."""
        name = state.func_id.func_qualname
        state.library = OnlyLinked(state.targetctx.codegen(), name)
        return True


class Inlined(CompilerBase):
    """numba's compiler, with that library."""

    def define_pipelines(self) -> list[Any]:
        """Return numba's passes, and before the lowering that one."""
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.add_pass_after(KeepLowered, AnnotateTypes)  # the last one before the lowering
        passes.finalize()
        return [passes]
