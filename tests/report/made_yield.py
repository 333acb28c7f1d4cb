"""A yield record of a few made-up parts, whose numbers follow from each other by formulas written here."""

import numpy as np

from lensforge.made.tolerance_result import (
    ApplicationYield,
    Budget,
    BudgetRow,
    CauseShare,
    MetricBound,
    MetricSpread,
    PassRate,
    ToleranceAmount,
    Variance,
    WorstPart,
    Yield,
)
from lensforge.results import Metric
from lensforge.spec.tolerances_section import factors_of

PARTS = 40
Z = 1.959963984540054


def make_yield(lens):
    """A study of ``lens``: NMSE and flux in the target of 40 parts, 38 of which pass."""
    rng = np.random.default_rng(3)
    factors = factors_of(lens.spec.part_tolerances)
    names = [name for factor in factors for name in _columns(factor)]
    drawn = rng.uniform(-1.0, 1.0, (PARTS, len(names)))
    nmse, share = np.linspace(0.02, 0.1025, PARTS), np.linspace(0.82, 0.78, PARTS)
    metrics = {"nmse": nmse, "share_in_target": share}
    bounds = (
        MetricBound(metric="nmse", sense="<=", bound=0.0985, unit=""),
        MetricBound(metric="share_in_target", sense=">=", bound=0.7, unit=""),
    )
    last = PARTS - 1
    return Yield(
        inputs={"lens": lens.sha256},
        parts=PARTS,
        rays=512,
        seed=0,
        preset=lens.spec.tolerances.preset,
        tolerances=tuple(_amount(factor) for factor in factors),
        bounds=bounds,
        pass_rate=_wilson(int((nmse <= 0.0985).sum()), PARTS),
        metrics={name: _spread(values) for name, values in metrics.items()},
        variance={name: _variance(factors) for name in metrics},
        roads=tuple(
            ApplicationYield(
                name=f"road {number}",
                lighting_class="M3",
                pass_rate=_wilson(36, PARTS),
                nearest="nmse",
                nearest_share=0.625,
                variance=variance,
            )
            for number, variance in ((1, _variance(factors)), (2, None))
        ),
        budget=_budget(factors),
        worst=(WorstPart(part=last, metrics={n: float(v[last]) for n, v in metrics.items()}, passes=False),),
        notes=("a <remark> of the study",),
        seconds=1.5,
        columns=(*names, *metrics),
        table=np.column_stack([drawn, nmse, share]),
        worst_maps=np.ones((1, 16, 16)),
    )


def _columns(factor):
    return [factor.name] if factor.numbers == 1 else [f"{factor.name} {k + 1}" for k in range(factor.numbers)]


def _amount(factor):
    distribution = "Gaussian field" if factor.kind == "field" else factor.distribution
    return ToleranceAmount(
        name=factor.name, words=factor.phrase, unit=factor.unit, amount=factor.amount, distribution=distribution
    )


def _wilson(passed, count):
    """By the roots of the quadratic (p - share)^2 = z^2 p (1 - p) / n."""
    share = passed / count
    roots = np.roots([1.0 + Z**2 / count, -(2.0 * share + Z**2 / count), share**2])
    return PassRate(value=share, low=float(roots.min()), high=float(roots.max()))


def _spread(values):
    """Ray noise has a tenth of the variance."""
    scatter = float(values.std(ddof=1))
    spread = np.sqrt(0.9) * scatter
    scaled = values.mean() + (values - values.mean()) * np.sqrt(0.9)
    p5, p50, p95 = np.percentile(scaled, [5, 50, 95]).tolist()
    mean = Metric(value=float(values.mean()), standard_error=scatter / PARTS**0.5)
    return MetricSpread(
        unit="", designed=Metric(value=float(values[0])), p5=p5, p50=p50, p95=p95, mean=mean, spread=float(spread),
        standard_error=scatter * 0.1**0.5,
    )  # fmt: skip


def _variance(factors):
    shares = [0.5, 0.25, *(0.001 for _ in factors[2:])]
    causes = tuple(
        CauseShare(tolerance=factor.name, words=factor.phrase, share=share, standard_error=0.0625)
        for factor, share in zip(factors, shares, strict=True)
    )
    return Variance(causes=causes, interactions=Metric(value=1.0 - sum(shares), standard_error=0.125))


def _budget(factors):
    """The first may be as large as 1.5 times, the second is unlimited; of the first 40 parts 95 % pass."""
    rows = []
    for number, factor in enumerate(factors):
        scales = (1.5, 1.25, 1.75) if number != 1 else (None, None, None)
        at_most, low, high = (None if scale is None else scale * factor.amount for scale in scales)
        rows.append(
            BudgetRow(
                tolerance=factor.name, words=factor.phrase, unit=factor.unit, specified=factor.amount, at_most=at_most,
                low=low, high=high, searched_to=16.0 * factor.amount, unlimited=number == 1,
            )
        )  # fmt: skip
    together = BudgetRow(
        tolerance="all", words="all tolerances, by one factor", unit="", specified=1.0, at_most=0.875, low=0.75,
        high=1.0, searched_to=16.0, unlimited=False,
    )  # fmt: skip
    return Budget(pass_rate=0.95, parts=PARTS, alone=tuple(rows), together=together)
