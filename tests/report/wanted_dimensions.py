"""Dimensions that page, PDF and drawing for the shop must show: of the exact surfaces, and of the base by the spec."""

import re

import numpy as np
from shown_numbers import shown

from lensforge.surfaces.srbf import fibonacci_hemisphere


def dimension_numbers(lens):
    """Entries of every dimension: its row, its line in the PDF, and where it is drawn."""
    scopes = {
        "axis": "on the axis", "section": "in the section S–S", "second": "in the section T–T",
        "largest": "largest about the axis", "part": "of the whole part",
        "base": "of the base, all around", "box": "of the box around the base",
    }  # fmt: skip
    gap = lens.spec.tolerances.of("gap_mm").amount
    for name, value, scope, drawn in _dimensions(lens):
        own = name == "thickness on the axis"
        kind, tolerance = ("±{}", (gap,)) if own else ("general" if scope in ("base", "box") else "auxiliary", ())
        yield shown(f"Datums and dimensions / {name} / mm", "{}", value)
        yield shown(f"Datums and dimensions / {name} / Tolerance", kind, *tolerance)
        yield shown(f"Datums and dimensions / {name} / Where", scopes[scope])
        yield shown(f"PDF / Sizes / {name} / mm", "{}", value)
        yield shown(f"PDF / Sizes / {name} / Tolerance", kind, *tolerance)
        if drawn:
            after = " ±{}" if own else " general" if kind == "general" else ""
            yield shown(f"Drawing / {name}", f"{drawn}{after}", value, *tolerance)
    plane = _plane(lens)
    for label in ("Datums and dimensions / p", "PDF / Datums", "Drawing / notes"):
        yield shown(label, *plane)
    yield shown("Datums and dimensions / Notes of the drawing / li", *plane)
    yield shown("PDF / Notes of the drawing", *plane)


def _plane(lens):
    """Words and values of datum A: the top of the base or the rim where it can be touched in z = 0, else the bottom."""
    base = lens.spec.base
    if base.kind in ("none", "step"):
        return ("Datum A: plane z = 0",)
    half = min(base.side_mm / 2.0 if base.kind == "square" else base.diameter_mm / 2.0, base.flat_mm or np.inf)
    if base.relief_step_mm or _rim_of(lens.outer).max() > half:
        return (
            "Datum A: bottom of the base, BASE_BOTTOM, at z = {}; no face to be touched lies in z = 0",
            -base.height_mm,
        )
    return ("Datum A: plane z = 0",)


def _dimensions(lens):
    """Name, value (mm), scope, and the text on the drawing ("" where it is not drawn)."""
    dome = np.concatenate([[[0.0, 0.0, 1.0]], fibonacci_hemisphere(200_000)])
    radius = lens.outer.radius(dome)
    apex, cavity = (float(face.radius(dome[:1])[0]) for face in (lens.outer, lens.inner))
    yield "outer apex above z = 0", apex, "axis", "({})"
    yield "highest point above z = 0", float((radius * dome[:, 2]).max()), "largest", ""
    yield "apex of the cavity above z = 0", cavity, "axis", "({})"
    yield "thickness on the axis", apex - cavity, "axis", "{}"
    yield "width of the dome", widest_of(lens.outer), "largest", "(⌀{})"
    for name, face in (("outer rim", lens.outer), ("opening of the cavity", lens.inner)):
        rim = _rim_of(face)
        yield f"{name} in z = 0, along x", float(rim[0] + rim[3600]), "section", "({})"
        if _second(lens):
            yield f"{name} in z = 0, along y", float(rim[1800] + rim[5400]), "second", "({})"
        yield f"{name} in z = 0, circle about the axis that holds it", 2.0 * float(rim.max()), "largest", ""
    if lens.spec.base.kind in ("cylinder", "square"):
        for name, value, drawn in _of_base(lens, lens.spec.base):
            yield name, value, "base", drawn
    if lens.spec.base.kind == "step":
        x, y, z = _box_of(lens.spec.base.file)
        yield "base below z = 0, in the section", z, "section", "({})"
        yield "base along x, in the section", x, "section", "({})"
        for name, value in (("width along x", x), ("width along y", y), ("height below z = 0", z)):
            yield f"base of {lens.spec.base.file.name}, {name}", value, "box", ""

    yield from _of_part(lens, float((radius * dome[:, 2]).max()))


def _of_part(lens, highest):
    """Length and largest width of the whole part."""
    base, below, width = lens.spec.base, 0.0, widest_of(lens.outer)
    if base.kind == "step":
        x, y, below = _box_of(base.file)
        width = max(width, float(np.hypot(x, y)))
    elif base.kind != "none":
        below = base.height_mm
        width = max(width, base.side_mm * 2.0**0.5 if base.kind == "square" else base.diameter_mm)
        width = max(width, base.flange_diameter_mm or 0.0)
    yield "overall length", highest + below, "part", "({})"
    yield "largest width", width, "part", "(⌀{})"


def widest_of(face):
    """Diameter (mm) of the cylinder about the axis that holds a face: of dense directions, near the widest denser."""
    turn, tilt = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 721), np.linspace(0.0, np.pi / 2.0, 361))
    for _ in range(4):
        across = np.sin(tilt)
        places = np.stack([across * np.cos(turn), across * np.sin(turn), np.maximum(np.cos(tilt), 0.0)], axis=-1)
        widths = face.radius(places.reshape(-1, 3)).reshape(turn.shape) * across
        at = np.unravel_index(np.argmax(widths), widths.shape)
        steps = np.linspace(-1.0, 1.0, 101)
        near = 3.0 * abs(tilt[1, 0] - tilt[0, 0])
        turn, tilt = np.meshgrid(turn[at] + 3.0 * near * steps, np.clip(tilt[at] + near * steps, 0.0, np.pi / 2.0))
    return 2.0 * float(widths.max())


def _second(lens):
    """True where the rims, of lenses whose faces are no mirror images, differ across x and y."""
    return any(abs(rim[0] - rim[1800]) > 1e-3 for rim in map(_rim_of, (lens.inner, lens.outer)))


def _box_of(file):
    """Sides (mm) of the box around the points of a STEP file, whose body is a block with bores."""
    points = re.findall(r"CARTESIAN_POINT\('[^']*',\(([^)]*)\)\)", file.read_text(encoding="utf-8"))
    places = [[float(number) for number in point.split(",")] for point in points]
    return np.ptp([place for place in places if len(place) == 3], axis=0).tolist()  # others are of curves on a face


def _of_base(lens, base):
    """Name, value (mm) and text on the drawing of each size of a built-in base."""
    yield "height of the base below z = 0", base.height_mm, "{}"
    if base.kind == "square":
        yield "side of the base across x", base.side_mm, "□{}"
        yield "side of the base across y", base.side_mm, "{}"
    else:
        yield "diameter of the base", base.diameter_mm, "⌀{}"
    if base.flat_mm is not None:
        yield "clocking flat across +x, from the axis", base.flat_mm, "{}"
    if base.flange_diameter_mm is not None:
        yield "height of the flange", base.flange_height_mm, "{}"
        yield "diameter of the flange", base.flange_diameter_mm, "⌀{}"
    if base.pocket_diameter_mm is not None:
        yield "depth of the pocket", base.pocket_depth_mm, "{}"
        yield "diameter of the pocket", base.pocket_diameter_mm, "⌀{}"
    if base.relief_step_mm:
        yield "depth of the relief step below z = 0", base.relief_step_mm, "{}"
    if base.relief_setback_mm:
        yield "diameter of the step's wall", 2.0 * (float(_rim_of(lens.outer).min()) - base.relief_setback_mm), "⌀{}"
    if base.bore_setback_mm:
        yield "diameter of the bore", 2.0 * (float(_rim_of(lens.inner).max()) + base.bore_setback_mm), "⌀{}"


def _rim_of(face):
    """Distances (mm) of the rim of ``face`` from the axis, from +x around."""
    turn = np.linspace(0.0, 2.0 * np.pi, 7200, endpoint=False)
    return face.radius(np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=-1))
