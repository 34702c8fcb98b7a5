"""Arrays and records at an address, for compiled code.

They replace numba's carray, which counts references: elements that allocate nothing are compiled without counting.
"""

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array


@intrinsic
def array_at(typing_context: Any, address: Any, shape: Any) -> Any:
    """Return the array, stored row by row, of this shape (a tuple of integers) that begins at a pointer."""
    kind = types.Array(address.dtype, len(shape), "C")

    def codegen(context: Any, builder: ir.IRBuilder, signature: Any, arguments: Any) -> ir.Value:
        array = context.make_array(kind)(context, builder)
        size = context.get_constant(types.intp, context.get_abi_sizeof(context.get_data_type(kind.dtype)))
        sizes = cgutils.unpack_tuple(builder, arguments[1], kind.ndim)
        strides = [size]
        for length in reversed(sizes[1:]):
            strides.insert(0, builder.mul(strides[0], length))
        data = builder.bitcast(arguments[0], context.get_data_type(kind.dtype).as_pointer())
        populate_array(array, data=data, shape=sizes, strides=strides, itemsize=size, meminfo=None)
        return array._getvalue()

    return kind(address, shape), codegen


@intrinsic
def record_at(typing_context: Any, address: Any) -> Any:
    """Return the record that a pointer points to."""

    def codegen(context: Any, builder: ir.IRBuilder, signature: Any, arguments: Any) -> ir.Value:
        return builder.bitcast(arguments[0], context.get_value_type(signature.return_type))

    return address.dtype(address), codegen
