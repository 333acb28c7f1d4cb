"""Tables of the pages in docs/, made of docs/figures.json: between `<!-- NAME -->` and `<!-- end of NAME -->`."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

COLUMNS = (
    "design", "uniformity", "efficiency", "NMSE", "r_max / height (mm)", "functions a surface, steps", "search",
    "STEP form / normal",
)  # fmt: skip
HEADLINE = ("flat_top", "flat_top_compact", "quickstart", "cross", "pi", "osram_pi")
Row = tuple[str, ...]


def stated(metric: dict[str, float | None] | None, digits: int) -> str:
    """A metric with its standard error: 0.965 ± 0.011, 0.9089 ± 3e-6."""
    if metric is None:
        return "–"
    error = metric["standard_error"]
    if error is None:
        return f"{metric['value']:.{digits}f}"
    rounded = f"{error:.{digits}f}" if error >= 1e-3 else f"{error:.0e}".replace("e-0", "e-")
    return f"{metric['value']:.{digits}f} ± {rounded}"


def row(name: str, found: dict[str, Any]) -> Row:
    """Figures of one design as the table of docs/validation.md has them."""
    search = f"{found['search_s']:.0f} s"
    return (
        name,
        stated(found["uniformity"], 3),
        stated(found["efficiency"], 4),
        stated(found["nmse"], 5),
        f"{found['max_radius_mm']:.3f} / {found['height_mm']:.3f}",
        f"{found['functions']}, {found['steps']}",
        f"({search})" if found.get("beside_other_work") else search,
        f"{found['form_error_nm']:.2f} nm / {1e3 * found['normal_error_mrad']:.1f} µrad",
    )


def table(rows: Sequence[Row], columns: Row = COLUMNS) -> str:
    """Rows as a Markdown table."""
    lines = ["| " + " | ".join(each) + " |" for each in (columns, *rows)]
    lines.insert(1, "|" + "---|" * len(columns))
    return "\n".join(lines)


def headline(designs: dict[str, Any]) -> str:
    """The first table of docs/validation.md: each design with its day and commit."""
    known = [(name, designs[name]) for name in HEADLINE if name in designs]
    rows = [(*row(name, design), design["date"], design["commit"]) for name, design in known]
    return table(rows, (*COLUMNS, "day", "commit"))


def flat_tops(designs: dict[str, Any]) -> str:
    """Both flat tops beside the paper's, whose figures are those of its abstract and section 3.A."""
    full, compact = designs["flat_top"], designs["flat_top_compact"]

    def line(label: str, paper: str, key: str, digits: int) -> Row:
        return label, paper, stated(full[key], digits), stated(compact[key], digits)

    rows = [
        line("uniformity (min/mean, 1155 × 1155 mm)", "0.93", "uniformity", 3),
        line("efficiency (2400 × 2400 mm)", "0.903", "efficiency", 4),
        ("largest radius / height (mm)", "2.42 / 2.17", *(row("", each)[4] for each in (full, compact))),
        ("gradient steps", "300, of 2^19 rays", *(str(each["steps"]) for each in (full, compact))),
        ("design time", "2.43 h, GPU", *(f"{row('', each)[6]}, two cores" for each in (full, compact))),
    ]
    return table(rows, ("", "paper", "flat_top", "flat_top_compact"))


TABLES = {"docs/validation.md": {"designs": headline, "flat tops": flat_tops}}


def filled(text: str, page: str, designs: dict[str, Any]) -> str:
    """The page with each of its tables made anew."""
    for name, make in TABLES[page].items():
        text = between_marks(text, page, name, make(designs))
    return text


def between_marks(text: str, page: str, name: str, made: str) -> str:
    """``text`` of a page with ``made`` between its marks of ``name``."""
    before, after = f"<!-- {name} -->\n", f"\n<!-- end of {name} -->"
    pattern = re.escape(before) + r".*?" + re.escape(after)
    text, count = re.subn(pattern, lambda _: f"{before}\n{made}\n{after}", text, flags=re.DOTALL)
    if count != 1:
        raise ValueError(f"{page}: {count} places for the table {name!r}")
    return text


def fill(root: Path, figures: dict[str, Any]) -> list[str]:
    """Write the tables of all pages; the pages that have some."""
    for page in TABLES:
        path = root / page
        path.write_text(filled(path.read_text(encoding="utf-8"), page, figures["designs"]), encoding="utf-8")
    return list(TABLES)
