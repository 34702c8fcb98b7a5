"""Arrays that nobody counts the references to.

numba counts the references to an array whenever one leaves a tuple or is put into one, atomically, which was two fifths
of a flight's time: its constants are tuples of a hundred arrays. Those live as long as the flight, so that they need
not be counted.
"""

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic


def _without_counts(context: Any, builder: ir.IRBuilder, kind: types.Type, value: ir.Value) -> ir.Value:
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder, value)
        array.meminfo = ir.Constant(array.meminfo.type, None)
        return array._getvalue()
    if isinstance(kind, types.BaseTuple):
        for i, part in enumerate(kind):
            its = _without_counts(context, builder, part, builder.extract_value(value, i))
            value = builder.insert_value(value, its, i)
    return value


@intrinsic
def borrowed(typing_context: Any, value: Any) -> Any:
    """Return an array, or a tuple of arrays and tuples, whose references are not counted; for compiled code.

    What it is made of must live longer: an argument of the function that was called from Python does, a local does not.
    """

    def codegen(context: Any, builder: ir.IRBuilder, signature: Any, arguments: Any) -> ir.Value:
        return _without_counts(context, builder, signature.args[0], arguments[0])

    return value(value), codegen
