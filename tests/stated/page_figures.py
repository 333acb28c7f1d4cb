"""Figures of replicates with their standard errors by section 10 of docs/definitions.md alone."""

from itertools import combinations

import numpy as np

FOURS = [b for b in combinations(range(16), 4) if b[0] ^ b[1] ^ b[2] ^ b[3] == 0]
EIGHTS = [[k for k in range(16) if (k & q).bit_count() % 2 == odd] for q in range(1, 16) for odd in (0, 1)]


def jackknife(values, figure=None):
    """A figure of the mean over the replicates, and its standard error."""
    values = np.array(values)
    figure = figure or float
    count = len(values)
    left_out = np.array([figure(np.delete(values, k, axis=0).mean(axis=0)) for k in range(count)])
    return figure(values.mean(axis=0)), np.sqrt((count - 1) / count * ((left_out - left_out.mean()) ** 2).sum())


def apart_of(errors, scales):
    """Mean over pairs k != l of E_k E_l over that of s_k s_l, and how far each pair is from it."""
    r = len(errors)
    products = np.zeros((len(errors),) * 2)
    norms = np.zeros((len(errors),) * 2)
    for k in range(r):
        for m in range(r):
            products[k, m] = (errors[k] * errors[m]).sum()
            norms[k, m] = scales[k] * scales[m]
    norm = (norms.sum() - np.trace(norms)) / (r * (r - 1))
    value = (products.sum() - np.trace(products)) / (r * (r - 1)) / norm
    return value, (products - value * norms) / norm


def error_over_pairs(apart):
    """Standard error of the mean over all pairs of what stands apart from it."""
    r = len(apart)
    mean = [np.delete(np.delete(apart, k, 0), k, 1) for k in range(r)]
    left_out = np.array([(m.sum() - np.trace(m)) / ((r - 1) * (r - 2)) for m in mean])
    squared = (r - 1) / r * ((left_out - left_out.mean()) ** 2).sum()
    whole = (apart.sum() - np.trace(apart)) / (r * (r - 1))
    effect = [(np.delete(apart[k], k).sum() - (r - 1) * whole) / (r - 2) for k in range(r)]
    z = sum((apart[k, m] - whole - effect[k] - effect[m]) ** 2 for k in range(r) for m in range(r) if k != m)
    z /= r * (r - 3)
    interactions = 2 * z / (r * (r - 1))
    return np.sqrt(max(squared - 4 * z / (r * (r - 2)) + interactions, interactions / 2))


def over_pairs(errors, scales):
    """The mean over pairs, and its standard error."""
    value, apart = apart_of(errors, scales)
    return value, error_over_pairs(apart)


def root(square, error):
    """The root of a square without noise, at least 0, and its error."""
    value = np.sqrt(max(square, 0))
    return value, error / (2 * max(value, np.sqrt(error) or 1.0))


def nmse(images, target):
    scales = [image.sum() for image in images]
    errors = [image - scale * target / target.sum() for image, scale in zip(images, scales, strict=True)]
    return over_pairs(errors, np.array(scales) * np.sqrt((target**2).sum()) / target.sum())


def rsd(values):
    means = [value.mean() for value in values]
    return root(*over_pairs([(v - m) / np.sqrt(v.size) for v, m in zip(values, means, strict=True)], means))


def least(values, most=None):
    """Least of the values at places, by 16 replicates, without noise; and its standard error."""
    value, by_halves, unsure = least_parts(values, most)
    return value, np.hypot(by_half_samples(by_halves), unsure)


def by_half_samples(by_halves):
    """Error of a value of all replicates by those of halves, a pair of halves in each row."""
    return np.sqrt(np.mean([((half - complement) / 2) ** 2 for half, complement in by_halves]))


def least_parts(values, most=None):
    """The least; the same by either half of the replicates, 15 times; and what nothing tells of it."""
    values = np.array(values)
    assert len(values) == 16

    def choice(block):
        """The light of all replicates where that of the block is least."""
        mean = values[list(block)].mean(axis=0)
        return values[:, mean <= mean.min() + 1e-12 * abs(mean).max()].mean(axis=1)

    chosen = {tuple(block): choice(block) for block in [*combinations(range(16), 2), *FOURS, *EIGHTS]}

    def level(sample, size):
        """u and v by the blocks of so many in a sample."""
        blocks = [block for block in chosen if len(block) == size and set(block) <= set(sample)]
        darkest = [chosen[block][list(block)].mean() for block in blocks]
        others = [chosen[block][[k for k in sample if k not in block]].mean() for block in blocks]
        return np.mean(darkest), np.mean(others)

    def extrapolated(sample):
        """The value by a sample, h, and v by blocks of half of it."""
        u, v = level(sample, len(sample) // 2)
        u_few, v_few = level(sample, len(sample) // 4)
        below = (v_few - u_few) - (v - u)
        h = min(max((u - u_few) / below, 0), 1) if below > 1e-12 * abs(v) else 1.0
        mean = values[list(sample)].mean(axis=0)
        return min(max(u + h * (v - u), mean.min()), mean.mean() if most is None else most), h, v

    value, h, v_8 = extrapolated(range(16))
    by_half = [extrapolated(half)[0] for half in EIGHTS]
    return value, np.reshape(by_half, (15, 2)), 0.0 if h else max(v_8 - value, 0.0)


def largest(values, at_least=None):
    value, error = least(-np.array(values), None if at_least is None else -at_least)
    return -value, error


def least_over_mean(values):
    values = np.array(values)
    return least(values / values.mean(axis=1)[:, None], 1.0)


def ratio(above, below):
    """Of a figure to the largest, whose errors are independent: at most 1."""
    value = above[0] / below[0]
    return min(value, 1.0), np.hypot(above[1], value * below[1]) / below[0]


def scaled(figure, factor):
    return figure[0] * factor, figure[1] * factor


def width_above(at, light, level):
    """Between the outermost places at ``level``, linear in between."""
    above = np.flatnonzero(light >= level)
    first = above[0]
    last = above[-1]
    low = at[first]
    high = at[last]
    if first > 0:
        low = np.interp(level, [light[first - 1], light[first]], [at[first - 1], at[first]])
    if last + 1 < len(light):
        high = np.interp(-level, [-light[last], -light[last + 1]], [at[last], at[last + 1]])
    return high - low


# -- Figures as a record has them, and how near the program must come ---------------------------------------------

# A ray or two may land beside an edge by the tables of the faces; a hit is off by less than 0.1 µm in a lens.
NEAR = 0.02  # of a standard error
RAY = 0.1  # of that of an extreme, which one ray may move
CLOSE = 1e-4  # of a figure, by wavelength and polarisation


def metric(pair, unit="", near=NEAR):
    """A figure as a record has it, within a small part of its error."""
    value, error = pair
    within = near * error + CLOSE * abs(value) + 1e-7
    return {"value": (value, within), "unit": unit, "standard_error": (error, max(within, RAY * error))}


def plain(value, near=CLOSE, floor=0.0):
    """A figure without an error."""
    return value, near * abs(value) + near + floor


def state_of(value, sense, bound):
    """Undecided within two standard errors."""
    by = value["value"][0] - bound
    if abs(by) <= 2 * value["standard_error"][0]:
        return "undecided"
    return "held" if (by > 0) == (sense == ">=") else "missed"
