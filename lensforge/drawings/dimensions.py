"""The sizes that a drawing states, measured on the exact surfaces."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lensforge.geometry.mesh_union import tessellated
from lensforge.geometry.plan import relief_ring
from lensforge.geometry.step_base import read_base
from lensforge.lens import Lens
from lensforge.surfaces.srbf import fibonacci_hemisphere

_AXIS = np.array([[0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class Dimension:
    """One size (mm) and what it is."""

    name: str
    value_mm: float


def dimensions(lens: Lens) -> list[Dimension]:
    """Sizes of the lens and of its base; widths of a rim are those of the circles that just hold it."""
    turn = np.linspace(0.0, 2.0 * np.pi, 1440, endpoint=False)
    rim = np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=-1)
    dome = fibonacci_hemisphere(20_000)
    radius = lens.outer.radius(dome)
    inner_apex, outer_apex = (float(surface.radius(_AXIS)[0]) for surface in (lens.inner, lens.outer))
    found = [
        Dimension("height of the outer apex above A", outer_apex),
        Dimension("highest point above A", float((radius * dome[:, 2]).max())),
        Dimension("depth of the cavity's apex above A", inner_apex),
        Dimension("thickness on the axis", outer_apex - inner_apex),
        Dimension("width of the dome", 2.0 * float((radius * np.hypot(dome[:, 0], dome[:, 1])).max())),
        Dimension("outer rim in A, outside width", 2.0 * float(lens.outer.radius(rim).max())),
        Dimension("opening of the cavity in A, outside width", 2.0 * float(lens.inner.radius(rim).max())),
    ]
    return found + _base_dimensions(lens)


def _base_dimensions(lens: Lens) -> list[Dimension]:
    base = lens.spec.base
    if base.kind == "none":
        return []
    if base.file is not None:
        return _box_of_file(base.file)
    ring = relief_ring(lens.inner, lens.outer, base)
    square = base.kind == "square"
    found = [
        Dimension(
            "side of the base" if square else "diameter of the base", base.side_mm if square else base.diameter_mm
        ),
        Dimension("height of the base below A", base.height_mm),
    ]
    for name, value in (
        ("relief step below A", base.relief_step_mm or None),
        ("diameter of the step's wall", None if ring is None else 2.0 * float(ring.radius(np.zeros(1))[0])),
        ("clocking flat, across +x, from the axis", base.flat_mm),
        ("diameter of the pocket", base.pocket_diameter_mm),
        ("depth of the pocket", base.pocket_depth_mm if base.pocket_diameter_mm else None),
        ("diameter of the flange", base.flange_diameter_mm),
        ("height of the flange", base.flange_height_mm if base.flange_diameter_mm else None),
    ):
        if value is not None:
            found.append(Dimension(name, value))
    return found


def _box_of_file(path: Path) -> list[Dimension]:
    """The box that holds a base from a STEP file, to a hundredth of a millimetre of its round faces."""
    vertices, _ = tessellated(read_base(path).solid, 1e-2)
    sizes = np.ptp(vertices, axis=0).tolist()
    names = ("width along x", "width along y", "height below A")
    return [Dimension(f"base of {path.name}, {name}", size) for name, size in zip(names, sizes, strict=True)]
