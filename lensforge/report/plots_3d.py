"""Three-dimensional views for notebooks and scripts; each returns a pyvista plotter: call its ``show()``."""

from pathlib import Path
from typing import Any

import numpy as np

from lensforge.errors import InputError
from lensforge.lens import Lens
from lensforge.report.snapshots import outer_slope

_GLASS = "#a3bfd8"


def plot_part(directory: Path | str, *, cut: bool = False, off_screen: bool | None = None) -> Any:
    """The exported mesh of the folder; ``cut``: without the half at y < 0.

    Raises :class:`InputError` where there is no ``lens.stl``.
    """
    import pyvista as pv

    path = Path(directory) / "lens.stl"
    if not path.exists():
        raise InputError(f"{path}: no such file; run `lensforge export {directory}` first")
    mesh = pv.read(path)
    if cut:
        mesh = mesh.clean().clip_closed_surface(normal="y", origin=(0.0, 0.0, 0.0))
    plotter = pv.Plotter(off_screen=off_screen)
    plotter.add_mesh(mesh, color=_GLASS, smooth_shading=True, split_sharp_edges=True, feature_angle=35.0)
    plotter.add_axes()
    return plotter


def plot_outer_surface(lens: Lens, *, off_screen: bool | None = None) -> Any:
    """The outer surface coloured by d rho / d theta (mm/rad), as in the paper's Fig. 5e."""
    import pyvista as pv

    points, slope = outer_slope(lens)
    surface = pv.StructuredGrid(*np.moveaxis(points, -1, 0))
    name, steepest = "dρ/dθ (mm/rad)", float(np.abs(slope).max()) or 1.0
    surface.point_data[name] = slope.ravel(order="F")
    plotter = pv.Plotter(off_screen=off_screen)
    plotter.add_mesh(surface, scalars=name, cmap="coolwarm", clim=(-steepest, steepest), smooth_shading=True)
    plotter.add_axes()
    return plotter
