"""A trial call of the functions of an element of one's own, in plain Python, before numba compiles them.

numba answers a misspelt name with a page, and does not check an index: a write beyond an array would go into whatever
lies there.
"""

from collections.abc import Mapping

import numpy as np

from ortilo_drake.loop.element import Box, takes
from ortilo_drake.loop.own import plain_arguments
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
    known = plain_arguments(box)
    for what, function in box.element.functions.items():
        inputs = {name: np.zeros(sizes[name]) for name in takes(function) if name in sizes and name not in known}
        if not {*takes(function)} <= {*known, *inputs}:
            continue
        try:
            with np.errstate(all="ignore"):
                function(**{name: (known | inputs)[name] for name in takes(function)})
        except (NameError, AttributeError, IndexError) as error:
            of_n = isinstance(error, AttributeError) and error.obj is known["n"]
            said = f"n has no {getattr(error, 'name', '')!r}" if of_n else f"{error}"
            raise InputError(f"{whose}: {what}: {said}") from None
        except Exception:
            continue
