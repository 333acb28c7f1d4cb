"""The error of a distance from the keep-out: that of the meshes of both bodies."""

from math import cos, pi

from lensforge.spec import BaseSection

# Largest distance of the meshes from curved faces. The CAD kernel keeps its chord at the edges of its triangles; in the
# middle of those of a ball it is off by 1.7 times as much.
FACET_MM = 2e-3


def mesh_error_mm(base: BaseSection, rings: int, chord_mm: float) -> float:
    """Largest error (mm) of a distance between the meshes of body and keep-out.

    ``chord_mm``: of the optical facets. A cylinder of the base is a polygon of 6 ``rings`` corners, or more.
    """
    widest = (base.flange_diameter_mm or base.widest_mm) if base.kind in ("cylinder", "square") else 0.0
    return max(chord_mm, widest / 2.0 * (1.0 - cos(pi / (6 * rings)))) + FACET_MM
