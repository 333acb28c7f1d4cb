"""Commented TOML of a new spec: what was asked for, and what follows from it, each with its reason."""

from collections.abc import Iterator, Mapping
from typing import Any

import tomli_w

from lensforge.spec.fields import words_of
from lensforge.spec.json_schema import SCHEMA_FILE
from lensforge.spec.search import ConstraintsSection

_COLUMN = 36  # of the comments
_HEAD = """#:schema ./{schema}
# {title}
# Lengths in mm, angles in degrees; every field: docs/spec.md, or `lensforge schema --page`.
# A value that is "derived" may be left out: it then follows when source, target or size change.
# {possible}
"""
_OPTIONS = {
    "source": ["flux_lm = 200.0: of the LED; without it 1 W", "position_mm, tilt_deg: where it sits in the lens"],
    "lens": ['symmetry = "auto": the largest that source and target share'],
    "constraints": [
        "inner_concave_radius_mm = 1.0: the ball that mills the cavity; outer_... likewise",
        "max_height_mm: of the lens; keep_out = \"board.step\": what it stays away from",
    ],
    "target": ["edge_mm: soft edges, as no lens makes sharp ones from a source with a size"],
}  # fmt: skip
_NOTES = {
    "lens.levels": "coarse to fine, for as long as each level gains",
    "lens.material": "its index by wavelength comes from the catalogue",
    "source.origin": "the file's virtual focus lies at the lens origin",
    "base.diameter_mm": "1.8 x max_radius_mm, around the cavity",
    "constraints.max_radius_mm": words_of(ConstraintsSection, "max_radius_mm").split(".")[0].lower(),
}


def new_text(content: Mapping[str, Any], derived: Mapping[str, str], title: str, possible: str) -> str:
    """TOML of ``content``, with the reasons of ``derived`` values by their dotted names; the rest is as asked for."""
    head = _HEAD.format(schema=SCHEMA_FILE, title=title, possible=possible)
    return "\n".join([head + _line("name", content["name"], ""), *_sections(content, derived)]) + "\n"


def _sections(content: Mapping[str, Any], derived: Mapping[str, str]) -> Iterator[str]:
    for section, table in content.items():
        if not isinstance(table, Mapping):
            continue
        yield f"\n[{section}]"
        for field, value in table.items():
            name = f"{section}.{field}"
            why = f"derived: {derived[name]}" if name in derived else _NOTES.get(name, "")
            yield _line(field, value, why)
        far = section == "target" and "distance_mm" not in table
        yield from (f"# {words}" for words in _OPTIONS.get(section, ()) if not far)


def _line(field: str, value: object, comment: str) -> str:
    text = " ".join(tomli_w.dumps({field: value}).split())
    return f"{text:<{_COLUMN}} # {comment}" if comment else text
