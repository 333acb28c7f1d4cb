"""Dimensions that page, PDF and drawing for the shop must show: of the exact surfaces, and of the base by the spec."""

import numpy as np
from shown_numbers import shown

from lensforge.surfaces.srbf import fibonacci_hemisphere


def dimension_numbers(lens):
    """Entries of every dimension: its row, its line in the PDF, and where it is drawn."""
    scopes = {"axis": "on the axis", "section": "in the section S–S", "largest": "largest about the axis"}
    gap = lens.spec.tolerances.of("gap_mm").amount
    for name, value, scope, drawn in _dimensions(lens):
        words = scopes.get(scope, "of the base, all around")
        label, line, numbers = f"Datums and dimensions / {name}", f"{{}}  {name}; {words}", (value,)
        text = f"{{}} mm {words}"
        if name == "thickness on the axis":
            text, line, drawn, numbers = f"{text}; ±{{}}", f"{line}; ±{{}}", f"{drawn} ±{{}}", (value, gap)
        yield shown(label, text, *numbers)
        yield shown("PDF / Dimensions (mm)", line, *numbers)
        if drawn:
            yield shown(f"Drawing / {name}", drawn, *numbers)
    for label in ("Datums and dimensions / p", "PDF / Datums", "Drawing / notes"):
        yield shown(label, "Datum A: plane z = 0")
    yield shown("Datums and dimensions / Notes of the drawing / li", "Datum A: plane z = 0")
    yield shown("PDF / Notes of the drawing", "Datum A: plane z = 0")


def _dimensions(lens):
    """Name, value (mm), scope, and the text on the drawing ("" where it is not drawn)."""
    dome = np.concatenate([[[0.0, 0.0, 1.0]], fibonacci_hemisphere(200_000)])
    radius = lens.outer.radius(dome)
    apex, cavity = (float(face.radius(dome[:1])[0]) for face in (lens.outer, lens.inner))
    yield "outer apex above z = 0", apex, "axis", "({})"
    yield "highest point above z = 0", float((radius * dome[:, 2]).max()), "largest", ""
    yield "apex of the cavity above z = 0", cavity, "axis", "({})"
    yield "thickness on the axis", apex - cavity, "axis", "{}"
    yield "width of the dome", 2.0 * float((radius * np.hypot(dome[:, 0], dome[:, 1])).max()), "largest", ""
    for name, face in (("outer rim", lens.outer), ("opening of the cavity", lens.inner)):
        turn = np.linspace(0.0, 2.0 * np.pi, 7200, endpoint=False)
        rim = face.radius(np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=-1))
        yield f"{name} in z = 0, along x", float(rim[0] + rim[3600]), "section", "({})"
        yield f"{name} in z = 0, circle about the axis that holds it", 2.0 * float(rim.max()), "largest", ""
    base = lens.spec.base
    yield "height of the base below z = 0", base.height_mm, "base", "{}"
    yield "diameter of the base", base.diameter_mm, "base", "⌀{}"
    if base.flange_diameter_mm is not None:
        yield "height of the flange", base.flange_height_mm, "base", "{}"
        yield "diameter of the flange", base.flange_diameter_mm, "base", "⌀{}"
    if base.pocket_diameter_mm is not None:
        yield "depth of the pocket", base.pocket_depth_mm, "base", "{}"
        yield "diameter of the pocket", base.pocket_diameter_mm, "base", "⌀{}"
