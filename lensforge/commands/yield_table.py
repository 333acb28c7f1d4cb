"""The yield study on stdout: a line for each number, as of the other commands."""

import click

from lensforge.commands.printing import print_table, printable
from lensforge.tolerancing.yield_result import BudgetRow, Yield

_SHOWN = 5  # causes of a spread; the record has them all


def print_yield(result: Yield) -> None:
    """Print who passes, the spread of each metric, its main causes, and what each tolerance may be."""
    print_table({"parts": result.parts, "rays": result.rays, "pass_rate": result.pass_rate.model_dump()})
    for bound in result.bounds:
        click.echo(printable(f"bound\t{bound}"))
    for name, spread in result.metrics.items():
        content = spread.model_dump(mode="json", include={"designed", "mean"})
        rounded = {key: float(f"{getattr(spread, key):.4g}") for key in ("p5", "p50", "p95", "spread")}
        print_table({**content, **rounded}, f"{name}.")
        if name in result.variance:
            for cause in result.variance[name].causes[:_SHOWN]:
                click.echo(f"{name}.share\t{cause.share:.3f} ± {cause.standard_error:.3f}\t{cause.words}")
            click.echo(f"{name}.share\t{result.variance[name].interactions}\tseveral together")
    if result.budget is not None:
        for row in (*result.budget.alone, result.budget.together):
            click.echo(f"at_most.{row.tolerance}\t{budget_words(row)}")
    for note in result.notes:
        click.echo(printable(f"note\t{note}"))


def budget_words(row: BudgetRow) -> str:
    """Largest amount of a tolerance, beside the one that is specified."""
    unit = f" {row.unit}" if row.unit else ""
    specified = f"(specified {row.specified:.3g}{unit})"
    if row.unlimited:
        return f"above {row.searched_to:.3g}{unit} {specified}"
    if row.at_most is None:
        return f"no amount is small enough: the others alone let too few parts pass {specified}"
    return f"{row.at_most:.3g}{unit}, {row.low:.2g} to {row.high:.2g} {specified}"
