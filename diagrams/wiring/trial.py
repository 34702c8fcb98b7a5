"""A trial call of the functions of an element of one's own, in plain Python, before numba compiles them.

numba answers a misspelt name with a page, and does not check an index: a write beyond an array would go into whatever
lies there.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ortilo_drake.loop.element import Box, takes
from ortilo_drake.model.typed_yaml import InputError


def try_out(box: Box, sizes: Mapping[str, int], whose: str) -> None:
    """Call out and step once with inputs of zeros.

    Other errors than those below may come of the zeros, so they are left to the flight.

    Args:
        box: the element's.
        sizes: of the inputs that it may read.
        whose: it is, for the error.

    Raises:
        InputError: if a name or an attribute is unknown, or an index lies outside its array.
    """
    element, given = box.element, box.given
    n: Any = np.zeros(1, element.dtype).view(np.recarray)[0]
    for name, value in given.numbers.items():
        n[name] = value
    known: dict[str, Any] = {"n": n, "k": 0, "seed": 0, "out": np.zeros(box.size)}
    known |= {name: np.array(value, dtype=float) for name, value in given.start.items()}
    known |= {name: np.array(value) for name, value in given.tables.items()}
    known |= {name: np.zeros(shape) for name, shape in box.work.items()}
    for what, function in element.functions.items():
        inputs = {name: np.zeros(sizes[name]) for name in takes(function) if name in sizes and name not in known}
        if not {*takes(function)} <= {*known, *inputs}:
            continue
        try:
            with np.errstate(all="ignore"):
                function(**{name: (known | inputs)[name] for name in takes(function)})
        except (NameError, AttributeError, IndexError) as error:
            said = f"n has no {error.name!r}" if isinstance(error, AttributeError) and error.obj is n else f"{error}"
            raise InputError(f"{whose}: {what}: {said}") from None
        except Exception:
            continue
