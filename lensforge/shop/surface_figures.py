"""Maps over a face: departure from its best-fit sphere, curvature against the mill, uncut material, and faults.

Maps are on the stereographic chart, [X, Y] over [-1, 1], NaN outside the rim and where another face is, and are drawn
on it: there a face never folds over itself, even where it is undercut. The axis is at the centre, the rim (90 deg) is
the unit circle.
"""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, ListedColormap
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Circle, Patch
from scipy.ndimage import distance_transform_edt

from lensforge.cad.part_limits import FIT_TOLERANCE
from lensforge.results.figure_style import INK, add_colour_bar, in_report_style, new_map
from lensforge.results.verdict import within
from lensforge.shop.face_faults import Fault

ChartMap = Float[np.ndarray, "n n"]

_SHOWN_QUANTILE = 0.995  # of |curvature|: a few extreme points at a rim would wash out all other colours
_PLACE = {"left": 0.1, "bottom": 0.1, "right": 1.34}  # no axes to label
_REACHED = "#dfe2e6"
_BESIDE_NODES = 2.0  # so that the nodes do not show at the rim; farther off is another face, and the map stays empty
_FAULTS = {
    Fault.STEEP: ("#e8a33d", "too steep"),
    Fault.BASE: ("#4a7fb5", "base in the way"),
    Fault.TOOL: ("#7b4fa3", "tool does not reach"),
    Fault.UNDERCUT: ("#c8372d", "undercut"),
}
_LINE = "#111111"  # on pale map colours, in light and dark mode


@in_report_style
def sag_map(sag_mm: ChartMap) -> Figure:
    """Deviation from the best-fit sphere along its normal; positive if farther from the centre than the sphere."""
    unit, scale = _readable(sag_mm)
    return _deviation_map(sag_mm * scale, f"deviation from the sphere ({unit})")


@in_report_style
def form_map(deviation_um: ChartMap) -> Figure:
    """Deviation (µm) of a measured surface from the design along its normal; positive: away from the origin."""
    return _deviation_map(deviation_um, "deviation from the design (µm)")


def _deviation_map(deviation: ChartMap, label: str) -> Figure:
    figure, axes, bar = new_map(**_PLACE)
    reach = float(np.nanmax(np.abs(deviation))) or 1.0
    add_colour_bar(bar, _show(axes, deviation, "RdBu_r", -reach, reach), label)
    return figure


@in_report_style
def curvature_map(kappa_min: ChartMap, tip_radius_mm: float | None) -> Figure:
    """Smaller principal curvature (1/mm, concave is negative), with the line where the tip of the tool just fits."""
    figure, axes, bar = new_map(**_PLACE)
    limit = -np.inf if tip_radius_mm is None else -1.0 / tip_radius_mm
    inside = kappa_min[np.isfinite(kappa_min)]
    reach = max(float(np.quantile(np.abs(inside), _SHOWN_QUANTILE)), 1e-9)
    exceeded = tip_radius_mm is not None and not within(float(inside.min()), ">=", limit, -FIT_TOLERANCE * limit)
    if exceeded:
        reach = max(reach, -1.05 * limit)  # where the limit is exceeded, the scale includes it
    shown = _show(axes, kappa_min, "PuOr_r", -reach, reach)
    low = bool(inside.min() < -reach)
    high = bool(inside.max() > reach)
    extend = {(True, True): "both", (True, False): "min", (False, True): "max"}.get((low, high), "neither")
    scale = add_colour_bar(bar, shown, "smaller curvature (1/mm)", extend)
    if exceeded:
        nodes = np.linspace(-1.0, 1.0, len(kappa_min))
        axes.contour(nodes, nodes, kappa_min.T, levels=[limit], colors=_LINE, linewidths=0.9, linestyles="solid")
    if limit >= -reach:
        scale.ax.axhline(limit, color=_LINE, linewidth=1.2)
    return figure


@in_report_style
def uncut_map(residual_mm: ChartMap) -> Figure:
    """Height of material left by the cutter; grey where none is left."""
    figure, axes, bar = new_map(**_PLACE)
    axes.add_patch(Circle((0.0, 0.0), 1.0, color=_REACHED, linewidth=0, zorder=-1.0))
    unit, scale = _readable(residual_mm)
    left = np.where(residual_mm > 0.0, residual_mm * scale, np.nan)
    shown = _show(axes, left, "viridis", 0.0, float(np.nanmax(left)), fill=False)
    add_colour_bar(bar, shown, f"uncut height ({unit})")
    return figure


@in_report_style
def fault_map(kinds: ChartMap) -> Figure:
    """Map of the obstacles where a face cannot be made as designed; grey elsewhere."""
    figure, axes, bar = new_map(**_PLACE)
    bar.set_axis_off()
    axes.add_patch(Circle((0.0, 0.0), 1.0, color=_REACHED, linewidth=0, zorder=-1.0))
    found_faults = [fault for fault in Fault if (kinds == fault).any() and fault is not Fault.NONE]
    shown = np.where(kinds > Fault.NONE, kinds, np.nan)
    colours = ListedColormap([_FAULTS[fault][0] for fault in _FAULTS])
    _show(axes, shown, colours, min(_FAULTS) - 0.5, max(_FAULTS) + 0.5)
    patches = [Patch(color=_FAULTS[fault][0], label=_FAULTS[fault][1]) for fault in found_faults]
    axes.legend(handles=patches, loc="upper left", bbox_to_anchor=(0.0, 0.0), frameon=False, fontsize=8.0)
    return figure


def _readable(values_mm: ChartMap) -> tuple[str, float]:
    return ("mm", 1.0) if float(np.nanmax(np.abs(values_mm))) >= 0.05 else ("µm", 1e3)


def _show(
    axes: Axes, values: ChartMap, colours: str | Colormap, low: float, high: float, fill: bool = True
) -> AxesImage:
    """Draw the map with its rim, and circles every 30 deg from the axis."""
    half = 1.0 + 1.0 / max(len(values) - 1, 1)
    shown = axes.imshow(
        (_filled(values) if fill else values).T,
        origin="lower",
        extent=(-half, half, -half, half),
        cmap=colours,
        vmin=low,
        vmax=high,
        interpolation="none",
    )
    shown.set_clip_path(Circle((0.0, 0.0), 1.0, transform=axes.transData))
    axes.add_patch(Circle((0.0, 0.0), 1.0, fill=False, edgecolor=INK, linewidth=0.7))
    for degrees in (30.0, 60.0, 90.0):
        radius = float(np.tan(np.radians(degrees) / 2.0))
        if degrees < 90.0:
            axes.add_patch(Circle((0.0, 0.0), radius, fill=False, edgecolor=_LINE, linewidth=0.4, alpha=0.5))
        where = radius / np.sqrt(2.0)
        axes.text(
            where, -where, f" {degrees:.0f}°", color=_LINE if degrees < 90.0 else INK, fontsize=7.0, ha="left", va="top"
        )
    axes.text(1.04, 0.0, "x", ha="left", va="center")
    axes.text(0.0, 1.04, "y", ha="center", va="bottom")
    axes.set(xlim=(-1.08, 1.14), ylim=(-1.08, 1.14), aspect="equal")
    axes.set_axis_off()
    return shown


def _filled(values: ChartMap) -> ChartMap:
    """Values with NaN beside the face replaced by the nearest node, so that the rim alone clips the picture."""
    away, nearest = distance_transform_edt(np.isnan(values), return_indices=True)
    return np.where(away <= _BESIDE_NODES, values[tuple(nearest)], np.nan)
