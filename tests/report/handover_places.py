"""The handover to the shop without its pictures: places of page, PDF and drawing, and the tables with their heads."""

import csv
import io
import re
from dataclasses import dataclass

import numpy as np
import pytest
from page_places import places_of
from shown_numbers import Place

from lensforge.drawings import build
from lensforge.drawings.grids import GridRequest

_NUMBERED = re.compile(r"(?:^|(?<=[.] ))\d+\. (?=[A-Z])")  # a note
REQUEST = GridRequest(spacing_mm=1.0)  # coarse: few points


@dataclass(frozen=True)
class Seen:
    """The ``handover`` of a folder, its drawn ``sheet``, the dense ``grids``, and lines of text of the PDF."""

    handover: object
    sheet: object
    grids: list
    lines: list

    @property
    def places(self):
        """Every text of page, PDF and drawing."""
        return [*places_of(self.handover.html.decode()), *_pdf_places(self.lines), *_sheet_places(self.sheet)]

    @property
    def heads(self):
        """Lines above the tables, by file and what stands before the colon."""
        found = []
        for name, content in self.handover.files.items():
            if name.endswith(".csv"):
                lines = [line[2:] for line in content.decode().splitlines() if line.startswith("# ")]
                found += [Place(f"{name} / {line.partition(':')[0]}", line) for line in lines]
        return found


def seen(results, *, dense=True):
    """The handover of ``results``, its pictures left out; also its ``dense`` tables where not wanted."""
    kept = {}

    def kept_grids(*arguments):
        kept["grids"] = made = make_grids(*arguments) if dense else []
        return made

    make_grids = build.make_grids
    with pytest.MonkeyPatch.context() as patch:
        for name in ("sag_map", "curvature_map"):
            patch.setattr(build, name, lambda *_: None)
        patch.setattr(build, "to_svg", lambda *_: "")
        patch.setattr(build, "sheet_figure", lambda sheet: kept.update(sheet=sheet))
        patch.setattr(build, "sheet_dxf", lambda _: b"")
        patch.setattr(build, "pdf_of", lambda title, drawing, text, pictures: kept.update(lines=text) or b"")
        patch.setattr(build, "make_grids", kept_grids)
        handover = build.make_handover(results, REQUEST)
    return Seen(handover, kept["sheet"], kept["grids"], kept["lines"])


def _pdf_places(lines):
    """A place for each line, by the heading above it."""
    heading, found = "", []
    for number, line in enumerate(lines):
        if number and lines[number - 1] == "" and ":" not in line:
            heading = line
        else:
            found.append(Place(f"PDF / {heading}", _NUMBERED.sub("", line)))
    return found


def _sheet_places(sheet):
    """Dimensions by name, cells of the table of the faces by column, notes as one text, all others one by one."""
    texts = [each.text for each in sheet.words]
    table = next(index for index, text in enumerate(texts) if text.startswith("Outer face, "))
    columns = [f"Drawing / {texts[table + k].partition(',')[0]}" for k in range(3)]
    yield from (Place("Drawing", text) for text in texts[:table])
    yield from (Place(columns[k % 3], text) for k, text in enumerate(texts[table : table + 24]))
    yield Place("Drawing / notes", _NUMBERED.sub("", " ".join(texts[table + 24 :])))
    yield from (Place(f"Drawing / {each.name}", each.text) for each in sheet.dimensions)


def table_of(content):
    """Columns of a table by name, numbers as an array."""
    lines = [line for line in content.decode().splitlines() if not line.startswith("#")]
    rows = list(csv.DictReader(io.StringIO("\n".join(lines))))
    return {
        name: [row[name] for row in rows] if name == "surface" else np.array([float(row[name]) for row in rows])
        for name in rows[0]
    }
