"""Put the tables of tradeoff.json into docs/accuracy.md, between the marks that name each folder.

python benchmarks/accuracy_tables.py cad_out/flat_top cad_out/pi
"""

import re
import sys
from collections.abc import Iterator
from pathlib import Path

from lensforge.results.files import replacing
from lensforge.runs.tradeoff.convergence import ConvergenceStudy
from lensforge.runs.tradeoff.page import PRESET_HEAD, preset_rows, study_section
from lensforge.runs.tradeoff.record import Tradeoff

PAGE = Path(__file__).parents[1] / "docs" / "accuracy.md"


def table(head: list[str], rows: list[list[str]]) -> Iterator[str]:
    """A Markdown table."""
    yield "| " + " | ".join(head) + " |"
    yield "|" + "---|" * len(head)
    for row in rows:
        yield "| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |"


def study_text(study: ConvergenceStudy) -> Iterator[str]:
    """A convergence study in words and numbers."""
    section = study_section(study)
    yield from ("", f"### {section.title}", "", f"Set by `{section.knob}`. Reference: {section.reference}.")
    if section.orders:
        yield f"Measured order, the power of the setting: {'; '.join(section.orders)}."
    yield ""
    yield from table(section.head, section.rows)


def text_of(tradeoff: Tradeoff) -> Iterator[str]:
    """Everything that tradeoff.html says in words and numbers."""
    yield f"Lens: `--accuracy {tradeoff.lens.accuracy}`, seed {tradeoff.lens.seed}."
    yield from ("", "### Presets", "")
    yield from table(PRESET_HEAD, preset_rows(tradeoff.presets))
    for study in tradeoff.studies.values():
        yield from study_text(study)


def main() -> None:
    """Replace the text between the marks of each folder."""
    page = PAGE.read_text(encoding="utf-8")
    for directory in map(Path, sys.argv[1:]):
        name = directory.name
        marks = f"<!-- {name} -->\n", f"<!-- end of {name} -->"
        body = "\n".join(text_of(Tradeoff.read(directory)))
        pattern = re.escape(marks[0]) + ".*?" + re.escape(marks[1])
        page, count = re.subn(pattern, lambda _, m=marks, b=body: f"{m[0]}\n{b}\n\n{m[1]}", page, flags=re.DOTALL)
        if count != 1:
            sys.exit(f"{PAGE}: no marks for {name}")
    with replacing(PAGE) as temporary:
        temporary.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
