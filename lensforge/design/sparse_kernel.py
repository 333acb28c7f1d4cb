"""Fused kernel of the search: rows of a sparse matrix times a narrow dense one.

SciPy's product has one core and keeps the interpreter's lock; this one is shared among all, row by row, so that the
sums do not depend on the number of threads.
"""

from lensforge.tracing.jit import kernel


@kernel
def multiply_rows(starts, columns, values, dense, first, last, product):
    """Fill rows ``first`` to ``last`` of ``product`` (r, c) with those of the matrix (CSR) times ``dense`` (s, c)."""
    width = dense.shape[1]
    for row in range(first, last):
        for c in range(width):
            product[row, c] = 0.0
        for k in range(starts[row], starts[row + 1]):
            value, column = values[k], columns[k]
            for c in range(width):
                product[row, c] += value * dense[column, c]
