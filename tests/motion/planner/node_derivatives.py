"""Derivatives of nodes' quantities as full arrays, for comparison."""

import numpy as np


def all_slopes(at):
    """Slopes (N, 1 + m, S) of what `NodePhysics.jacobian` gives."""
    of_z = at.slopes.reshape(len(at.s), -1, len(at.y)).transpose(2, 1, 0)
    return np.concatenate([at.power.T[:, None], of_z], axis=1)


def bends(hessian):
    """Second derivatives (N, S, S) of what `NodePhysics.hessian` gives."""
    size, count = hessian.slopes.shape
    full = np.zeros((count, size, size))
    columns, rows = np.tril_indices(size)
    full[:, rows, columns] = full[:, columns, rows] = hessian.upper.T
    return full
