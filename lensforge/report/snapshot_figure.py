"""One level of a design in one picture, as in the paper's Fig. 5e: the outer surface by its slope, and the light."""

from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from lensforge.figures.light_unit import WATTS, LightUnit
from lensforge.report.drawing import add_colour_bar, in_house_style
from lensforge.report.irradiance_figures import drawn

_WIDTH, _HEIGHT = 2.7, 5.0
_SLOPES, _LIGHT = "coolwarm", "inferno"
_SHADE = 0.35  # what a facet loses that is turned away from the light
_TOWARDS_LIGHT = np.array([0.35, -0.75, 0.56])


@in_house_style
def snapshot_figure(
    surface_mm: Float[np.ndarray, "i j 3"],
    slope: Float[np.ndarray, "i j"],
    irradiance: Float[np.ndarray, "p p"],
    receiver_mm: float,
    unit: LightUnit = WATTS,
    steepest: float | None = None,
    top: float | None = None,
) -> Figure:
    """Above: ``surface_mm`` coloured by ``slope`` (mm/rad) from -``steepest`` to it. Below: the light, 0 to ``top``.

    ``steepest`` and ``top`` (W/m^2) are by default the largest values, and given to put several levels on one scale.
    """
    figure = Figure(figsize=(_WIDTH, _HEIGHT))
    steepest = steepest or float(np.abs(slope).max()) or 1.0
    top = top or float(irradiance.max()) or 1.0
    slopes = ScalarMappable(Normalize(-steepest, steepest), _SLOPES)
    _draw_surface(figure, surface_mm, slope, slopes)
    add_colour_bar(_bar(figure, 0.625), slopes, "dρ/dθ (mm/rad)", orientation="horizontal")
    axes = figure.add_axes((0.15, 0.15, 0.7, 0.7 * _WIDTH / _HEIGHT))
    half = 0.5 * receiver_mm
    light = axes.imshow(
        unit.per_w_m2 * drawn(irradiance), origin="lower", extent=(-half, half, -half, half), cmap=_LIGHT, vmin=0.0,
        vmax=unit.per_w_m2 * top, interpolation="none",
    )  # fmt: skip
    axes.set_axis_off()
    add_colour_bar(_bar(figure, 0.12), light, unit.label, orientation="horizontal")
    return figure


def _bar(figure: Figure, height: float) -> Axes:
    return figure.add_axes((0.15, height, 0.7, 0.016))


def _draw_surface(
    figure: Figure, points: Float[np.ndarray, "i j 3"], slope: Float[np.ndarray, "i j"], slopes: ScalarMappable
) -> None:
    """The surface from above, one raster image in a drawing of lines."""
    axes: Any = figure.add_axes((0.0, 0.64, 1.0, 0.36), projection="3d", computed_zorder=False)
    colours = np.asarray(colormaps[_SLOPES](slopes.norm(slope[:-1, :-1])))
    colours[..., :3] *= _light_on(points)[..., None]
    x, y, z = np.moveaxis(points, -1, 0)
    surface = axes.plot_surface(
        x, y, z, facecolors=colours, rcount=len(x), ccount=x.shape[1], linewidth=0, antialiased=False, shade=False
    )
    surface.set_rasterized(True)
    reach = float(np.abs(points).max())
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), zlim=(0.0, reach))
    axes.set_box_aspect((2.0, 2.0, 1.0), zoom=1.6)
    axes.view_init(elev=32.0, azim=-60.0)
    axes.set_axis_off()


def _light_on(points: Float[np.ndarray, "i j 3"]) -> Float[np.ndarray, "k l"]:
    """Brightness of each facet, never so low that its colour could not be read."""
    down, around = points[1:, :-1] - points[:-1, :-1], points[1:, 1:] - points[1:, :-1]
    normal = np.cross(down, around)
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
    lit: Float[np.ndarray, "k l"] = np.clip(normal @ _TOWARDS_LIGHT, 0.0, 1.0)
    return 1.0 - _SHADE * (1.0 - lit)
