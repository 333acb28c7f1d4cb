"""Sum of patches on a table, its refinement, and the adjoints of both: rows that become vector instructions.

A patch holds the spline coefficients of one basis function on the rectangle of nodes where they are not negligible.
A finer table is the same spline on half the step, by the two-scale relation 1/8 (1, 4, 6, 4, 1) of cubic B-splines.
"""

from lensforge.kernels.jit import kernel


@kernel
def add_patches(boxes, starts, values, weights, table):
    """Add all patches, times their weights (m), to a table (side, side).

    ``boxes`` (m, 4): first row and column, rows and columns of each patch; its ``values`` begin at ``starts``.
    """
    for j in range(len(boxes)):
        row, column, rows, columns = boxes[j, 0], boxes[j, 1], boxes[j, 2], boxes[j, 3]
        weight, begin = weights[j], starts[j]
        for r in range(rows):
            line, own = table[row + r, column : column + columns], values[begin : begin + columns]
            for c in range(columns):
                line[c] += weight * own[c]
            begin += columns


@kernel
def patch_sums(boxes, starts, values, table, by_weights):
    """Adjoint of :func:`add_patches`: fill ``by_weights`` (m).

    Eight partial sums for each product, so that the additions need not wait for one another.
    """
    for j in range(len(boxes)):
        row, column, rows, columns = boxes[j, 0], boxes[j, 1], boxes[j, 2], boxes[j, 3]
        eights, begin = columns // 8 * 8, starts[j]
        s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = 0.0
        for r in range(rows):
            line, own = table[row + r, column : column + columns], values[begin : begin + columns]
            for c in range(0, eights, 8):
                s0 += own[c] * line[c]
                s1 += own[c + 1] * line[c + 1]
                s2 += own[c + 2] * line[c + 2]
                s3 += own[c + 3] * line[c + 3]
                s4 += own[c + 4] * line[c + 4]
                s5 += own[c + 5] * line[c + 5]
                s6 += own[c + 6] * line[c + 6]
                s7 += own[c + 7] * line[c + 7]
            for c in range(eights, columns):
                s0 += own[c] * line[c]
            begin += columns
        by_weights[j] = ((s0 + s1) + (s2 + s3)) + ((s4 + s5) + (s6 + s7))


@kernel
def refine(coarse, halfway, fine):
    """Fill ``fine`` (t, t) with the spline of ``coarse`` (s, s); ``halfway`` (t, s) is for the work between."""
    for r in range(len(fine)):
        first, line = r // 2, halfway[r]
        if r % 2:
            one, two, three = coarse[first], coarse[first + 1], coarse[first + 2]
            for c in range(len(line)):
                line[c] = 0.125 * (one[c] + three[c]) + 0.75 * two[c]
        else:
            one, two = coarse[first], coarse[first + 1]
            for c in range(len(line)):
                line[c] = 0.5 * (one[c] + two[c])
        for c in range(len(fine) // 2):
            fine[r, 2 * c] = 0.5 * (line[c] + line[c + 1])
            fine[r, 2 * c + 1] = 0.125 * (line[c] + line[c + 2]) + 0.75 * line[c + 1]
        fine[r, len(fine) - 1] = 0.5 * (line[len(line) - 2] + line[len(line) - 1])


@kernel
def refine_adjoint(by_fine, halfway, by_coarse):
    """Adjoint of :func:`refine`: fill ``by_coarse`` (s, s) from ``by_fine`` (t, t)."""
    by_coarse[:] = 0.0
    for r in range(len(by_fine)):
        line, own = halfway[r], by_fine[r]
        line[:] = 0.0
        for c in range(len(own) // 2):
            even, odd = 0.5 * own[2 * c], own[2 * c + 1]
            line[c] += even + 0.125 * odd
            line[c + 1] += even + 0.75 * odd
            line[c + 2] += 0.125 * odd
        line[len(line) - 2] += 0.5 * own[len(own) - 1]
        line[len(line) - 1] += 0.5 * own[len(own) - 1]
        first = r // 2
        if r % 2:
            _add(by_coarse[first], 0.125, line)
            _add(by_coarse[first + 1], 0.75, line)
            _add(by_coarse[first + 2], 0.125, line)
        else:
            _add(by_coarse[first], 0.5, line)
            _add(by_coarse[first + 1], 0.5, line)


@kernel
def _add(total, factor, line):
    for c in range(len(line)):
        total[c] += factor * line[c]
