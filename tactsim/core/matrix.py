"""Row-column cross-talk of resistive matrices without guards, and how it is taken out of readings again.

A cell joins its row's wire to its column's. To read one, its row is driven and its column is held at virtual ground (or
measured over a resistor), while all other wires hang free: then current also takes ways through three or more other
cells, and the corner opposite to three pressed ones lights up (T. D'Alessio, "Measurement errors in the scanning of
piezoresistive sensors arrays", Sensors and Actuators A 72, 1999; R. S. Saxena et al., "Virtual ground technique for
crosstalk suppression in networked resistive sensors", IEEE Sensors Journal 11, 2011). A matrix all of whose wires are
driven or held at ground while a cell is read has no such cross-talk (the zero potential method).
"""

from __future__ import annotations

import numpy as np

from tactsim.core.poses import FloatArray

STEPS = 50  # of `unmixed`: past them what it finds moves by less than the noise of a reading
_RELAXATION = 1.5
_AT_REST = 1e-10  # relative change of a conductance in a step at which nothing moves any more


def mixed(conductance: FloatArray) -> FloatArray:
    """Give what is read of the cells of a matrix whose idle wires hang free, (..., rows, columns), in the same unit.

    conductance: (..., rows, columns), above 0. What is read is the conductance between a row's wire and a column's
    through the whole network, the inverse of the resistance distance K_ii + K_jj - 2 K_ij, K the inverse of the
    network's Laplacian where charge is kept (D. J. Klein and M. Randic, J. Math. Chem. 12, 1993). Cells that all
    conduct the same are read too high by rows * columns / (rows + columns - 1).
    """
    rows, columns = conductance.shape[-2:]
    node = np.arange(rows + columns)
    laplacian = np.zeros((*conductance.shape[:-2], len(node), len(node)))
    laplacian[..., :rows, rows:] = -conductance
    laplacian[..., rows:, :rows] = -conductance.swapaxes(-1, -2)
    laplacian[..., node, node] = -laplacian.sum(axis=-1)
    # The same number everywhere changes no difference of voltages, and makes the matrix regular.
    inverse = np.linalg.inv(laplacian + conductance.mean(axis=(-2, -1), keepdims=True))
    own = inverse[..., node, node]
    return 1 / (own[..., :rows, None] + own[..., None, rows:] - 2 * inverse[..., :rows, rows:])


def unmixed(measured: FloatArray, least: float, steps: int = STEPS) -> FloatArray:
    """Find the conductances of the cells from what `mixed` made of them, (..., rows, columns), in the same unit.

    least: no cell conducts less, above 0. As many values are read as there are cells, so they decide all of them. Each
    step corrects a cell by the ratio of what was measured of it to what the cells as found so far would give (compare
    J. A. Hidalgo-Lopez et al., Journal of Sensors 2018, 9735741). At the solution, and in logarithms, a step shrinks
    the error by 1 - w D: the derivatives D of what is read have eigenvalues in (0, 1], so relaxation w below 2
    converges. Noisy values that no conductances give are met as nearly as cells of at least `least` can.
    """
    rows, columns = measured.shape[-2:]
    measured = np.maximum(measured, least)
    found = np.maximum(measured * (rows + columns - 1) / (rows * columns), least)
    for _ in range(steps):
        before, found = found, np.maximum(found * (measured / mixed(found)) ** _RELAXATION, least)
        if np.abs(found - before).max(initial=0.0) <= _AT_REST * found.max(initial=0.0):
            break
    return found


def of_uniform(conductance: float, rows: int, columns: int) -> float:
    """Give what `mixed` reads of a matrix whose cells all have this conductance."""
    return conductance * rows * columns / (rows + columns - 1)
