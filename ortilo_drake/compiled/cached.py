"""njit functions whose compiled code is kept on the disk until they, or a function that they call, change.

numba's own cache (`njit(cache=True)`) looks only at the file of the function itself. After a change in another file it
returns the old code, and so old numbers, without a word.
"""

import pickle
from collections.abc import Callable
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import Any

import numba
from numba import types
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.registry import CPUDispatcher

from ortilo_drake.compiled.digest import digest_of


class DigestCache(FunctionCache):
    """numba's cache of one function, in files named by the digest of the function and of all that it calls."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]):
        super().__init__(function)
        self._options = options

    @cached_property
    def _files(self) -> IndexDataCacheFile:
        # Not before the first call: a function may call another that its module defines below it.
        digest = digest_of(self._py_func, sorted(self._options.items()))
        name = self._impl.filename_base.rpartition("-")[0]  # without the function's line and Python's version
        return IndexDataCacheFile(self.cache_path, f"{name}-{digest}", source_stamp=digest)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled code for a signature; None if none is kept, or none that can be read."""
        self._cache_file = self._files
        try:
            return super().load_overload(sig, target_context)
        except (ImportError, AttributeError, EOFError, pickle.UnpicklingError):  # a class has moved, a file is cut off
            self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the compiled code for a signature, and delete what was kept of the function before it changed."""
        kept = self._files._index_name.removesuffix("nbi")
        for file in Path(self.cache_path).glob(f"{kept.rpartition('-')[0]}-*.nb[ci]"):
            if not file.name.startswith(kept):
                with suppress(OSError):  # another process may delete it at the same time
                    file.unlink()
        super().save_overload(sig, data)

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        return *super()._index_key(sig, codegen), fields_in(sig)


def fields_in(signature: Any) -> tuple[Any, ...]:
    """Return the names of all fields of NamedTuples in types: numba takes two orders of fields for the same type."""
    if not isinstance(signature, (tuple, types.BaseTuple)):
        return ()
    return getattr(signature, "fields", ()), *filter(None, map(fields_in, signature))


def cached_njit(function: Any = None, **options: Any) -> Any:
    """Compile a function as numba.njit does, and keep the code; for `@cached_njit` and `@cached_njit(nogil=True)`.

    Args:
        function: to be compiled.
        options: of numba.njit, without `cache`.
    """
    if function is None:
        return lambda its: cached_njit(its, **options)
    compiled = numba.njit(**options)(function)
    if isinstance(compiled, CPUDispatcher):  # not where NUMBA_DISABLE_JIT leaves it as it is
        compiled._cache = DigestCache(function, options)
    return compiled
