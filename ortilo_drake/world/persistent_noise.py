"""Noise with a slow share, yet a pure function of the tick.

A slow noise number of tick t, between nodes N ticks apart, is

    ((1 - a) n_k + a n_{k+1}) / sqrt((1 - a)^2 + a^2),   k = t div N,   a = (t mod N) / N,

standard normal in every tick.
"""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.model.triples import Four
from ortilo_drake.world.noise import four_normals


@register_jitable
def _mixed(new: float, before: float, after: float, share: float, a: float) -> float:
    """Return a number whose slow part lies at the fraction a of the way from one node to the next."""
    scale = np.sqrt(share / ((1.0 - a) ** 2 + a**2))
    return np.sqrt(1.0 - share) * new + scale * ((1.0 - a) * before + a * after)


@register_jitable(forceinline=True)
def persistent_normals(
    seed: int, of_nodes: np.ndarray, white: np.uint64, nodes: np.uint64, tick: int, share: float, spacing: int
) -> Four:
    """Return a tick's four standard normal numbers, of whose variance a share changes slowly.

    The function is inlined where it is called, so that unused numbers are not drawn. `seed` is that of the tick's
    noise; of_nodes (2) are the seeds of the nodes before and after, the same unless each tick of the flight has its own
    seed. `white` is the stream of what is new in every tick, `nodes` that of the nodes, `spacing` ticks apart.
    """
    z = four_normals(seed, white, tick)
    if share <= 0.0:
        return z
    a = (tick % spacing) / spacing
    before = four_normals(of_nodes[0], nodes, tick // spacing)
    after = four_normals(of_nodes[1], nodes, tick // spacing + 1)
    return (
        _mixed(z[0], before[0], after[0], share, a),
        _mixed(z[1], before[1], after[1], share, a),
        _mixed(z[2], before[2], after[2], share, a),
        _mixed(z[3], before[3], after[3], share, a),
    )


@register_jitable
def seeds_of_nodes(slow: np.ndarray, seeds: np.ndarray, k: int) -> np.ndarray:
    """Return the seeds of the nodes before and after tick k, for each slowly changing number: the nodes' ticks' seeds.

    `slow` (n, 2) holds for each number the share that changes slowly, and the ticks between its nodes. `seeds` holds
    the seed of each tick; a node after the last tick has the last seed. The result is (n, 2).
    """
    found = np.empty((slow.shape[0], 2), dtype=np.int64)
    for i in range(slow.shape[0]):
        spacing = max(int(slow[i, 1]), 1)
        for j in range(2):
            found[i, j] = seeds[min((k // spacing + j) * spacing, seeds.size - 1)]
    return found
