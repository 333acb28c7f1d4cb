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
# A line such as `# cavity_radius_mm = ...  # derived` is what follows from source, target and size, and goes on
# following them; without its first # it is fixed.
# {possible}
"""
_OPTIONS = {
    "source": ["flux_lm = 200.0: of the LED; without it 1 W", "position_mm, tilt_deg: where it sits in the lens"],
    "lens": ['symmetry = "auto": the largest that source and target share'],
    "constraints": [
        "max_height_mm: of the lens; keep_out = \"board.step\": what it stays away from",
    ],
    "target": ["edge_mm: soft edges, as no lens makes sharp ones from a source with a size"],
}  # fmt: skip
_MEASURED = "measured: 99 % of the ray file's flux starts inside"
_NOTES = {
    "lens.levels": "coarse to fine, for as long as each level gains",
    "lens.material": "its index by wavelength comes from the catalogue",
    "source.origin": "the file's virtual focus lies at the lens origin",
    **dict.fromkeys(("constraints.cavity_radius_mm", "constraints.cavity_height_mm"), _MEASURED),
    "constraints.inner_concave_radius_mm": "no hollow is tighter than the ball that mills it",
    "constraints.inner_draft_deg": "no undercut, as seen from the tool or the mould's other half",
    "manufacture.cutter_radius_mm": "of the ball",
    "manufacture.make": "inserts of a mould are cut, not the lens; shrinkage = 0.005: of its material",
    "base.diameter_mm": "1.8 x max_radius_mm, around the cavity",
    "constraints.max_radius_mm": words_of(ConstraintsSection, "max_radius_mm").split(".")[0].lower(),
}


def new_text(content: Mapping[str, Any], derived: Mapping[str, str], title: str, possible: str) -> str:
    """TOML of ``content``, its ``derived`` values as comments with the reasons under their dotted names."""
    head = _HEAD.format(schema=SCHEMA_FILE, title=title, possible=possible)
    return "\n".join([head + _line("name", content["name"], ""), *_sections(content, derived)]) + "\n"


def _sections(content: Mapping[str, Any], derived: Mapping[str, str]) -> Iterator[str]:
    for section, table in content.items():
        if not isinstance(table, Mapping):
            continue
        yield f"\n[{section}]"
        for field, value in table.items():
            name = f"{section}.{field}"
            if name in derived:
                yield _line(field, value, f"derived: {derived[name]}", "# ")
            else:
                yield _line(field, value, _NOTES.get(name, ""))
        far = section == "target" and "distance_mm" not in table
        yield from (f"# {words}" for words in _OPTIONS.get(section, ()) if not far)


def _line(field: str, value: object, comment: str, before: str = "") -> str:
    text = before + " ".join(tomli_w.dumps({field: value}).split())
    return f"{text:<{_COLUMN}} # {comment}" if comment else text
