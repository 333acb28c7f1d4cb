"""Keep-outs made with the CAD kernel: STEP files of boxes, balls and boards."""

from pathlib import Path
from typing import Any


def box(size: tuple[float, float, float], centre: tuple[float, float, float]) -> Any:
    """A box by its sides and its centre (mm)."""
    import cadquery as cq

    return cq.Workplane("XY").box(*size).translate(centre).val()


def ball(radius: float, centre: tuple[float, float, float]) -> Any:
    """A ball (mm)."""
    import cadquery as cq

    return cq.Workplane("XY").sphere(radius).translate(centre).val()


def step_file(path: Path, *shapes: Any) -> Path:
    """Write ``shapes`` to one STEP file."""
    import cadquery as cq

    cq.exporters.export(cq.Workplane(cq.Compound.makeCompound(list(shapes))), str(path))
    return path
