"""Every figure of ``yield`` by docs/definitions.md, section 16, from its table of parts and their errors alone."""

from itertools import combinations

import numpy as np
from crooked import Expected

BLOCKS = 20
LEAST = 0.005
CERTAIN = 2.0
Z = 1.959963984540054
SHARES = ("efficiency", "share_in_target")


class Parts:
    """The table of a study: numbers drawn by tolerance, metrics by name, and the bounds that a part must keep."""

    def __init__(self, table, bounds, numbers, amounts, errors, designed):
        """``errors`` of all parts, and ``designed``: by metric.

        ``numbers``: columns of each tolerance, truncated at the ``amounts``.
        """
        self.table = table
        self.bounds = bounds
        self.errors = errors
        self.designed = designed
        self.numbers = {
            name: np.column_stack([table[column] for column in columns]) / amounts[name]
            for name, columns in numbers.items()
        }
        self.count = len(next(iter(table.values())))

    def kept(self, bound):
        values = self.table[bound["metric"]]
        return values <= bound["bound"] if bound["sense"] == "<=" else values >= bound["bound"]

    def passing(self, bounds=None):
        return np.all([self.kept(bound) for bound in bounds or self.bounds], axis=0)

    def failing_first(self):
        """Metrics that have a bound, that with the most failing parts first."""
        failing = {}
        for bound in self.bounds:
            failing[bound["metric"]] = failing.get(bound["metric"], 0) + (~self.kept(bound)).sum()
        return sorted(failing, key=lambda name: -failing[name])

    def shares(self, values, errors):
        """Share of the variance of ``values`` by each tolerance with its standard error, the most certain first."""
        y = values - values.mean()
        block = np.arange(self.count) % BLOCKS
        shares = {}
        sums = np.zeros(BLOCKS + 1)
        without = [np.ones(self.count, dtype=bool)] + [block != k for k in range(BLOCKS)]
        total = np.array([(y[rows] ** 2).mean() * self.count / (self.count - 1) for rows in without])
        total -= (np.array(errors) ** 2).mean()
        for name, numbers in self.numbers.items():
            f = functions(numbers) * y[:, None]
            pairs = [(f[rows].sum(axis=0) ** 2 - (f[rows] ** 2).sum(axis=0)).sum() / (rows.sum() * (rows.sum() - 1))
                     for rows in without]  # fmt: skip
            sums += pairs
            shares[name] = jackknife(np.array(pairs) / total)
        order = sorted(shares, key=lambda name: -(shares[name][0] - CERTAIN * shares[name][1]))
        certain = [name for name in order if shares[name][0] > CERTAIN * shares[name][1]]
        return shares, certain, jackknife(1 - sums / total)


def functions(numbers):
    """Polynomials of degree 4 in one number, up to a total of 4 in two, orthonormal over those within 2 sigma."""
    x = (np.arange(40_001) - 20_000) / 20_000
    weights = np.exp(-2 * x**2)
    weights[[0, -1]] /= 2
    triangle = np.linalg.qr(np.vander(x, 5, increasing=True) * np.sqrt(weights / weights.sum())[:, None])[1]
    single = [np.linalg.solve(triangle.T, np.vander(column, 5, increasing=True).T).T[:, 1:] for column in numbers.T]
    both = [a[:, i] * b[:, j] for a, b in combinations(single, 2) for i in range(4) for j in range(4) if i + j + 2 <= 4]
    return np.column_stack([*single, *both])


def jackknife(values):
    """Value of all parts, and its standard error by those without a block each."""
    left = values[1:]
    return values[0], np.sqrt((len(left) - 1) * left.var())


def wilson(passed, count):
    p = passed / count
    middle = p + Z**2 / 2 / count
    wide = Z * np.sqrt(p * (1 - p) / count + Z**2 / 4 / count**2)
    return p, (middle - wide) / (1 + Z**2 / count), (middle + wide) / (1 + Z**2 / count)


def percent(share):
    return f"{100 * share:.3g}\u2009%"


def in_words(metric):
    receiver, colon, name = metric.rpartition(": ")
    return f"{receiver}{colon}{name}" if receiver else f"{name[:1].upper()}{name[1:]}"


def spread(parts, metric):
    """Mean, 5, 50 and 95 % and standard deviation of the parts without the scatter that noise adds."""
    values = parts.table[metric]
    scatter = values.std(ddof=1)
    deviation = np.sqrt(max(scatter**2 - (parts.errors[metric] ** 2).mean(), 0))
    drawn = values.mean() + (values - values.mean()) * deviation / scatter
    return {
        "p5": np.percentile(drawn, 5),
        "p50": np.percentile(drawn, 50),
        "p95": np.percentile(drawn, 95),
        "spread": deviation,
    }


def value_of(metric, value, within, unit):
    factor, unit = (100.0, "%") if metric.rpartition(": ")[2] in SHARES else (1.0, unit)
    return Expected(factor * value, factor * within, unit)
