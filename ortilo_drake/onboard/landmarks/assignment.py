"""The assignment problem, compiled: each row gets its own column, and the sum of the costs is minimal.

The method is shortest augmenting paths, D. F. Crouse, "On implementing 2D rectangular assignment algorithms", IEEE
Trans. Aerospace and Electronic Systems 52 (2016). Its steps are the ones of scipy.optimize.linear_sum_assignment, so
that both find the same one of several best assignments.
"""

import numpy as np

from ortilo_drake.compiled.cached import cached_njit


@cached_njit
def assign(costs: np.ndarray) -> np.ndarray:
    """Return the column assigned to each row (k), given finite costs (k, n) with k <= n."""
    rows, columns = costs.shape
    u, v = np.zeros(rows), np.zeros(columns)
    shortest, path = np.empty(columns), np.full(columns, -1)
    column_of, row_of = np.full(rows, -1), np.full(columns, -1)
    in_rows, in_columns = np.empty(rows, np.bool_), np.empty(columns, np.bool_)
    remaining = np.empty(columns, np.int64)
    for row in range(rows):
        n_remaining = columns
        for j in range(columns):
            remaining[j] = columns - j - 1
        in_rows[:], in_columns[:], shortest[:] = False, False, np.inf
        least, i, sink = 0.0, row, -1
        while sink < 0:
            index, lowest = -1, np.inf
            in_rows[i] = True
            for a in range(n_remaining):
                j = remaining[a]
                reduced = least + costs[i, j] - u[i] - v[j]
                if reduced < shortest[j]:
                    path[j], shortest[j] = i, reduced
                # Among several columns of least cost, prefer one that no row has yet: it ends the path.
                if shortest[j] < lowest or (shortest[j] == lowest and row_of[j] < 0):
                    lowest, index = shortest[j], a
            least, j = lowest, remaining[index]
            if row_of[j] < 0:
                sink = j
            else:
                i = row_of[j]
            in_columns[j] = True
            n_remaining -= 1
            remaining[index] = remaining[n_remaining]
        u[row] += least
        for i in range(rows):
            if in_rows[i] and i != row:
                u[i] += least - shortest[column_of[i]]
        for j in range(columns):
            if in_columns[j]:
                v[j] -= least - shortest[j]
        j = sink
        while True:
            i = path[j]
            row_of[j] = i
            column_of[i], j = j, column_of[i]
            if i == row:
                break
    return column_of
