"""Fused kernel of the search: rows of a sparse matrix times a dense one.

SciPy's product has one core and keeps the interpreter's lock; this one is shared among all, row by row, so that the
sums do not depend on the number of threads.
"""

from lensforge.tracing.jit import kernel


@kernel
def multiply_rows(starts, columns, values, dense, first, last, product):
    """Fill rows ``first`` to ``last`` of ``product`` (r, c) with those of the matrix (CSR) times ``dense`` (s, c)."""
    if dense.shape[1] == 2:  # both surfaces at once: their sums stay in registers
        for row in range(first, last):
            inner, outer = 0.0, 0.0
            for k in range(starts[row], starts[row + 1]):
                value, column = values[k], columns[k]
                inner += value * dense[column, 0]
                outer += value * dense[column, 1]
            product[row, 0], product[row, 1] = inner, outer
        return
    for row in range(first, last):
        total = product[row]
        total[:] = 0.0
        for k in range(starts[row], starts[row + 1]):
            value, source = values[k], dense[columns[k]]
            for c in range(len(source)):
                total[c] += value * source[c]


@kernel
def add_transposed(starts, columns, values, dense, first, last, total):
    """Add to ``total`` (s, 2) the transposed rows ``first`` to ``last`` times those of ``dense`` (r, 2)."""
    for row in range(first, last):
        inner, outer = dense[row, 0], dense[row, 1]
        for k in range(starts[row], starts[row + 1]):
            value, column = values[k], columns[k]
            total[column, 0] += value * inner
            total[column, 1] += value * outer
