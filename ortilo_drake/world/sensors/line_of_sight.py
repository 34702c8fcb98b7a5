"""The lines of sight of model/geometry/line_of_sight.py under their old name.

Kernels that numba compiled and kept before they moved look for them here.
"""

from ortilo_drake.model.geometry.line_of_sight import crosses_box, crosses_cylinder, is_hidden, walls_crossed

__all__ = ["crosses_box", "crosses_cylinder", "is_hidden", "walls_crossed"]
