"""Section of the report on tolerances and yield: the sentence on it, bounds, causes, and the budget."""

from dataclasses import dataclass
from pathlib import Path

from lensforge.made.tolerance_result import Yield
from lensforge.report.yield_rows import (
    BoundRow,
    BudgetLine,
    CausesRow,
    bound_rows,
    budget_lines,
    budget_sentence,
    cause_rows,
    pass_sentence,
)
from lensforge.runs.results import Results


@dataclass(frozen=True)
class YieldSection:
    """Words and tables; ``page``: name of the page beside the report that has more, empty where there is none."""

    sentence: str
    page: str
    bounds: list[BoundRow]
    causes: list[CausesRow]
    budget_sentence: str
    budget: list[BudgetLine]


def yield_section(results: Results, folder: Path | None) -> YieldSection | None:
    """The section; None where the study has not run."""
    found = results.find(Yield)
    if found is None:
        return None
    page = f"{Yield.stage}.html"
    return YieldSection(
        sentence=pass_sentence(found),
        page=page if folder is not None and (folder / page).is_file() else "",
        bounds=bound_rows(found),
        causes=cause_rows(found),
        budget_sentence=budget_sentence(found),
        budget=budget_lines(found),
    )
