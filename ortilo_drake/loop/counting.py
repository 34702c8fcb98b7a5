"""The arrays that an element makes within a call, counted by the one thread that makes the call.

numba counts an array's holders by atomic operations in functions that are not inlined, also those of arrays that nobody
holds, and takes memory through three more. Here all of it is inlined and not atomic: of an array that its caller lends
nothing is left. The block before an array's numbers is numba's, so that numba can free it as well.
"""

import llvmlite.binding as llvm
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler_machinery import register_pass

from ortilo_drake.loop.inlined import Inlined, KeepLowered

COUNTING = """
declare noalias ptr @malloc(i64)
declare void @free(ptr)
declare void @NRT_MemInfo_call_dtor(ptr)
define ptr @NRT_MemInfo_alloc_aligned(i64 %size, i32 %align) noinline {
  %whole = add i64 %size, 112  ; 48 of the block, and up to 63 so that the numbers begin at a multiple of 64
  %made = call noalias ptr @malloc(i64 %whole)
  %none = icmp eq ptr %made, null
  br i1 %none, label %done, label %fill
fill:
  %block = ptrtoint ptr %made to i64
  %behind = add i64 %block, 111
  %at = and i64 %behind, -64
  %data = inttoptr i64 %at to ptr
  store { i64, ptr, ptr, ptr, i64, ptr } { i64 1, ptr null, ptr null, ptr null, i64 0, ptr null }, ptr %made
  %of_data = getelementptr i8, ptr %made, i64 24
  store ptr %data, ptr %of_data
  %of_size = getelementptr i8, ptr %made, i64 32
  store i64 %size, ptr %of_size
  br label %done
done:
  ret ptr %made
}
define void @NRT_incref(ptr %held) {
  %none = icmp eq ptr %held, null
  br i1 %none, label %done, label %count
count:
  %holders = load i64, ptr %held
  %more = add i64 %holders, 1
  store i64 %more, ptr %held
  br label %done
done:
  ret void
}
define void @NRT_decref(ptr %held) {
  %none = icmp eq ptr %held, null
  br i1 %none, label %done, label %count
count:
  %holders = load i64, ptr %held
  %fewer = sub i64 %holders, 1
  store i64 %fewer, ptr %held
  %last = icmp eq i64 %fewer, 0
  br i1 %last, label %end, label %done
end:
  call void @ortilo_end(ptr %held)
  br label %done
done:
  ret void
}
define void @ortilo_end(ptr %held) noinline cold {
  %of_own = getelementptr i8, ptr %held, i64 8
  %own = load ptr, ptr %of_own
  %simple = icmp eq ptr %own, null
  br i1 %simple, label %give, label %call
give:
  call void @free(ptr %held)
  ret void
call:
  call void @NRT_MemInfo_call_dtor(ptr %held)
  ret void
}
"""
_NAMES = ("NRT_MemInfo_alloc_aligned", "NRT_incref", "NRT_decref", "ortilo_end")


class CountedByOne(JITCodeLibrary):
    """Code with this counting."""

    def _optimize_final_module(self) -> None:
        """Optimize as numba does: it takes out what need not be counted, by its functions' names; then inline these."""
        codegen, module = self._codegen, self._final_module
        options = {"slp_vectorize": False, "opt": codegen._opt_level, "cost": "cheap"}
        first, its = codegen._module_pass_manager(loop_vectorize=codegen._loopvect, **options)
        first.run(module, its)
        own = llvm.parse_assembly(COUNTING)
        own.data_layout, own.triple = module.data_layout, module.triple
        module.link_in(own)
        for name in _NAMES:
            module.get_function(name).linkage = "internal"
        then, its = codegen._module_pass_manager()
        then.run(module, its)


@register_pass(mutates_CFG=False, analysis_only=False)
class CountAlone(KeepLowered):
    """Lowers into such code."""

    _name = "count_alone"
    library = CountedByOne


class Counted(Inlined):
    """numba's compiler, with this counting."""

    lowering = CountAlone
