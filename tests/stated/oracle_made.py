"""Every figure of ``yield`` by docs/definitions.md, section 16, from its table of parts alone."""

from itertools import combinations

import numpy as np
from crooked import Expected

BLOCKS, LEAST, CERTAIN, Z = 20, 0.005, 2.0, 1.959963984540054
SHARES = ("efficiency", "share_in_target")


class Parts:
    """The table of a study: numbers drawn by tolerance, metrics by name, and the bounds that a part must keep."""

    def __init__(self, table, bounds, numbers, noise, designed):
        """``numbers``: columns of each tolerance; ``noise``: standard error of a part, and ``designed``, by metric."""
        self.table, self.bounds, self.noise, self.designed = table, bounds, noise, designed
        self.numbers = {
            name: np.column_stack([table[column] for column in columns]) for name, columns in numbers.items()
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

    def shares(self, values, noise):
        """Share of the variance of ``values`` by each tolerance with its standard error, the most certain first."""
        y = values - values.mean()
        block = np.arange(self.count) % BLOCKS
        found, sums = {}, np.zeros(BLOCKS + 1)
        without = [np.ones(self.count, dtype=bool)] + [block != k for k in range(BLOCKS)]
        total = np.array([(y[rows] ** 2).mean() * self.count / (self.count - 1) for rows in without]) - noise**2
        for name, numbers in self.numbers.items():
            f = functions(numbers) * y[:, None]
            pairs = [(f[rows].sum(axis=0) ** 2 - (f[rows] ** 2).sum(axis=0)).sum() / (rows.sum() * (rows.sum() - 1))
                     for rows in without]  # fmt: skip
            sums += pairs
            found[name] = jackknife(np.array(pairs) / total)
        order = sorted(found, key=lambda name: -(found[name][0] - CERTAIN * found[name][1]))
        certain = [name for name in order if found[name][0] > CERTAIN * found[name][1]]
        return found, certain, jackknife(1 - sums / total)


def functions(numbers):
    """Polynomials of degree 4 in one number, up to a total of 4 in two, orthonormal over the parts."""
    single = []
    for x in numbers.T:
        powers = np.vander(x / abs(x).max(), 5, increasing=True)
        single.append(np.linalg.qr(powers)[0][:, 1:] * np.sqrt(len(x)))
    both = [a[:, i] * b[:, j] for a, b in combinations(single, 2) for i in range(4) for j in range(4) if i + j + 2 <= 4]
    return np.column_stack([*single, *both])


def jackknife(values):
    """Value of all parts, and its standard error by those without a block each."""
    left = values[1:]
    return values[0], np.sqrt((len(left) - 1) * left.var())


def wilson(passed, count):
    p = passed / count
    middle, wide = p + Z**2 / 2 / count, Z * np.sqrt(p * (1 - p) / count + Z**2 / 4 / count**2)
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
    own = np.sqrt(max(scatter**2 - parts.noise[metric] ** 2, 0))
    drawn = values.mean() + (values - values.mean()) * own / scatter
    return {
        "p5": np.percentile(drawn, 5),
        "p50": np.percentile(drawn, 50),
        "p95": np.percentile(drawn, 95),
        "spread": own,
    }


def value_of(metric, value, within, unit):
    factor, unit = (100.0, "%") if metric.rpartition(": ")[2] in SHARES else (1.0, unit)
    return Expected(factor * value, factor * within, unit)
