"""32-bit floats for processors without doubles: what numba treats as a double is computed and stored as a float.

A separate process calls this before it compiles, and then ends (ir.py). All outputs, states and arrays of the elements
are then narrow; their numba types, and so their source, stay unchanged.
"""

import importlib
import re
from collections.abc import Iterable
from typing import Any, Final

import numpy as np
from llvmlite import ir
from numba import from_dtype, types
from numba.core.datamodel import default_manager, models
from numba.core.pythonapi import PythonAPI

from ortilo_drake.loop.element import Box
from ortilo_drake.model.typed_yaml import InputError

# Elements that flew within 1 mm and 0.1 degree of the flight with doubles (scripts/export_single.py).
NEAR: Final = {
    "outside", "constant", "bundle", "multilateration", "learning_multilateration", "survey_bank", "handler",
    "imu_rows", "filter", "told_filter", "vehicle_belief", "reference", "servo", "belief_parts", "extra_part",
}  # fmt: skip
# Elements that flew farther from the flight with doubles, and how far.
FAR: Final = {"tight": "850 mm and 52 degrees within 46 ticks"}
NARROW: Final = {"f8": "f4"}  # kind in memory of each changed kind
# Constants of the elements that fit the rounding of doubles. Floats need others: pi / 2 and ln 2 in parts whose
# products with an integer are exact in 24 bits, and the limits of what counts as singular and as equal.
CHANGED: Final[dict[str, dict[str, float]]] = {
    "ortilo_drake.model.elementary": {
        "LARGE": 3.0e3, "SENSELESS": 1.0e6,
        "Q_1": 201.0 / 128.0, "Q_2": 4.837512969970703125e-04, "Q_3": 7.549789948768648e-08,
        "REST_3": np.pi / 2.0 - 201.0 / 128.0 - 4.837512969970703125e-04 - 7.549789948768648e-08,
        "LN_2": 355.0 / 512.0, "LN_2_LOW": np.log(2.0) - 355.0 / 512.0, "HIGHEST": 88.72, "LOWEST": -103.0,
        "FLAT": 2.0**-13, "SPLIT": 4097.0, "HUGE": 2.0**60, "SCALE": 2.0**80,
    },
    "ortilo_drake.onboard.ranging.range_equations": {"REGULAR": 1e-6, "STEP": 2e-5},
    "ortilo_drake.onboard.ranging.clock_offset": {"STEP": 2e-5, "REGULAR": 1e-5, "NO_RISE": 1.0 + 1e-5},
    "ortilo_drake.onboard.landmarks.known_attitude": {"_CONVERGED": 1e-5, "_REGULAR": 1e-6},
    "ortilo_drake.onboard.estimator.robust.weights": {"ROUNDING": 1e-4},
    "ortilo_drake.onboard.estimator.tight.tick": {"ROUNDING": 1e-4},
}  # fmt: skip


def check_near(boxes: Iterable[Box]) -> None:
    """Raise InputError, naming the first wrong box, unless all boxes are known to fly well in floats."""
    boxes = list(boxes)
    for box in boxes:
        if far := FAR.get(box.element.name):
            said = f"the element {box.element.name!r} came {far} from doubles, 1 mm and 0.1 degree are allowed"
            raise InputError(f"--precision: single: {box.name}: {said}")
    for box in boxes:
        if box.element.name not in NEAR:
            said = f"the element {box.element.name!r} has not been flown within 1 mm of doubles"
            raise InputError(f"--precision: single: {box.name}: {said}")


def narrow_record(wide: np.dtype) -> types.Record:
    """Return the record type of constants that are floats in memory but doubles in numba's types."""
    fields = [(name, wide[name].base, wide[name].shape) for name in wide.names or ()]
    narrow = [(name, np.dtype(NARROW.get(kind.str[1:], kind)), shape) for name, kind, shape in fields]
    record = from_dtype(np.dtype(narrow, align=True))
    for name, of in record.fields.items():
        record.fields[name] = of._replace(type=_widely_typed(of.type))
    return record


def _widely_typed(kind: Any) -> Any:
    if isinstance(kind, types.NestedArray):
        return types.NestedArray(_widely_typed(kind.dtype), kind.shape)
    return types.float64 if kind == types.float32 else kind


def with_floats(text: str) -> str:
    """Return C source with floats in place of doubles."""
    return re.sub(r"\bdouble\b", "float", text)


def with_whole_words(ir: str) -> str:
    """Return IR that converts floats to 32-bit integers: a library's conversion to 64 bits may use doubles.

    On every processor, a float that is too large becomes the largest integer, and NaN becomes 0.
    """
    made = re.compile(r"^( *)(%\S+) = fptosi float (\S+) to i64(.*)$", flags=re.M)
    if not made.search(ir):
        return ir
    call = r"\1%ortilo_of\2 = call i32 @llvm.fptosi.sat.i32.f32(float \3)\n\1\2 = sext i32 %ortilo_of\2 to i64\4"
    return made.sub(call, ir).replace("%ortilo_of%", "%ortilo_of.") + "\ndeclare i32 @llvm.fptosi.sat.i32.f32(float)\n"


class _FloatModel(models.PrimitiveModel):
    """The LLVM type of numba's floating-point numbers: a float."""

    def __init__(self, manager: Any, kind: Any):
        super().__init__(manager, kind, ir.FloatType())


def compute_in_floats() -> None:
    """Let all code that this process compiles from now on compute in floats and store floats."""
    default_manager.register(types.Float, _FloatModel)
    types.float64.bitwidth = 32  # for arrays within records
    own, given = PythonAPI.float_from_double, PythonAPI.float_as_double
    PythonAPI.float_from_double = lambda api, value: own(api, api.builder.fpext(value, ir.DoubleType()))
    PythonAPI.float_as_double = lambda api, value: api.builder.fptrunc(given(api, value), ir.FloatType())
    for module, changes in CHANGED.items():
        vars(importlib.import_module(module)).update(changes)
