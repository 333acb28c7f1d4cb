"""The handover to the shop without its pictures: places of page, PDF and drawing, and the tables with their heads."""

import csv
import io
import re
from dataclasses import dataclass

import numpy as np
import pytest
from page_places import places_of
from shown_numbers import Place

from lensforge.shop import handover_files
from lensforge.shop.point_grids import GridRequest

_NUMBERED = re.compile(r"(?:^|(?<=[.] ))\d+\. (?=[A-Z])")  # a note
REQUEST = GridRequest(spacing_mm=1.0)  # coarse: few points


@dataclass(frozen=True)
class Seen:
    """The ``handover`` of a folder, its drawn ``sheet``, the dense ``grids``, and ``tables`` of the PDF."""

    handover: object
    sheet: object
    grids: list
    tables: list

    @property
    def places(self):
        """Every text of page, PDF and drawing."""
        return [*places_of(self.handover.html.decode()), *_pdf_places(self.tables), *_sheet_places(self.sheet)]

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

    make_grids = handover_files.make_grids
    with pytest.MonkeyPatch.context() as patch:
        for name in ("sag_map", "curvature_map"):
            patch.setattr(handover_files, name, lambda *_: None)
        patch.setattr(handover_files, "to_svg", lambda *_: "")
        patch.setattr(handover_files, "sheet_figure", lambda sheet: kept.update(sheet=sheet))
        patch.setattr(handover_files, "sheet_dxf", lambda _: b"")
        patch.setattr(
            handover_files, "pdf_of", lambda title, drawing, tables, pictures: kept.update(tables=tables) or b""
        )
        patch.setattr(handover_files, "make_grids", kept_grids)
        handover = handover_files.make_handover(results, REQUEST)
    return Seen(handover, kept["sheet"], kept["grids"], kept["tables"])


def _pdf_places(tables):
    """Sentences by the title of their table, and its cells by row and column where it has a head."""
    for table in tables:
        yield from (Place(f"PDF / {table.title}", _NUMBERED.sub("", each)) for each in table.sentences)
        for name, *cells in table.rows:
            if not table.head:
                yield Place(f"PDF / {table.title}", f"{name}: {cells[0]}")
            for column, text in zip(table.head[1:], cells, strict=bool(table.head)):
                yield Place(f"PDF / {table.title} / {name} / {column}", text)


def _sheet_places(sheet):
    """Dimensions by name, columns of the table of the faces, notes as one text, all others one by one."""
    texts = [each.text for each in sheet.words]
    start = next(index for index, text in enumerate(texts) if text.startswith("Outer face, "))
    heads = {each.at[0]: each.text.partition(",")[0] for each in sheet.words[start : start + 3]}
    rest = sheet.words[start:]
    yield from (Place("Drawing", text) for text in texts[:start])
    for left, name in heads.items():
        yield Place(f"Drawing / {name}", " ".join(each.text for each in rest if each.at[0] == left))
    notes = [each.text for each in rest if each.at[0] not in heads]
    yield Place("Drawing / notes", _NUMBERED.sub("", " ".join(notes)))
    yield from (Place(f"Drawing / {each.name}", each.text) for each in sheet.dimensions)


def table_of(content):
    """Columns of a table by name, numbers as an array."""
    lines = [line for line in content.decode().splitlines() if not line.startswith("#")]
    rows = list(csv.DictReader(io.StringIO("\n".join(lines))))
    return {
        name: [row[name] for row in rows] if name == "surface" else np.array([float(row[name]) for row in rows])
        for name in rows[0]
    }
