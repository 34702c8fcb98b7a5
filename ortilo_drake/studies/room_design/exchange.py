"""Exact designs: n of many candidates, chosen one by one and then exchanged one by one.

The exchange is Fedorov's (V. V. Fedorov, "Theory of Optimal Experiments", Academic Press, 1972, section 3.3; Cook and
Nachtsheim, "A comparison of algorithms for constructing exact D-optimal designs", Technometrics 22, 1980), in its
modified form: each chosen candidate in turn gives way to the one that lowers the cost most, until none does. The cost
is evaluated, not linearised. The result is a local minimum, always the same one, since nothing is random.
"""

from collections.abc import Callable, Sequence

import numpy as np

GAIN = 1e-6  # an exchange must lower the cost by more than this, relative
MAX_SWEEPS = 30

Cost = Callable[[np.ndarray, np.ndarray], float]


def greedy(information: np.ndarray, there: np.ndarray, n: int, cost: Cost, tick: Callable[[], None]) -> list[int]:
    """Return n candidates, each chosen because it lowers the cost most, given those chosen before.

    information (c, steps, 3, 3) is that of c candidates in each step, and there (c, steps) says whether each is heard.
    cost takes a design's information (steps, 3, 3) and number heard (steps). tick is called after each choice.
    """
    chosen: list[int] = []
    for _ in range(n):
        chosen.append(_best(information, there, chosen, cost)[0])
        tick()
    return chosen


def exchange(
    information: np.ndarray, there: np.ndarray, chosen: Sequence[int], cost: Cost, tick: Callable[[], None]
) -> list[int]:
    """Return the design after exchanges that each lower the cost, until no single one does; arguments as for greedy."""
    found = list(chosen)
    value = cost(information[found].sum(axis=0), there[found].sum(axis=0))
    unchanged = 0
    for turn in range(MAX_SWEEPS * len(found)):
        i = turn % len(found)
        best, new = _best(information, there, found[:i] + found[i + 1 :], cost)
        unchanged += 1
        if new < value * (1.0 - GAIN):
            found[i], value, unchanged = best, new, 0
        tick()
        if unchanged >= len(found):
            break
    return found


def _best(information: np.ndarray, there: np.ndarray, beside: Sequence[int], cost: Cost) -> tuple[int, float]:
    """Return the candidate that, added to `beside`, lowers the cost most, and the cost with it."""
    J, heard = information[list(beside)].sum(axis=0), there[list(beside)].sum(axis=0)
    costs = [np.inf if c in beside else cost(J + information[c], heard + there[c]) for c in range(len(information))]
    best = int(np.argmin(costs))
    return best, float(costs[best])
