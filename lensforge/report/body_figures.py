"""Pictures of the light on a measured body of the scene: its patches in false colour, as seen from two sides."""

from typing import Literal

import numpy as np
from jaxtyping import Float
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from lensforge.optics.pose import Pose
from lensforge.results.chart import LightUnit
from lensforge.results.figure_style import add_colour_bar, in_report_style, new_map
from lensforge.scene.body_view import BodyView

Side = Literal["lit", "far"]
_ASIDE_DEG = 25.0  # of the view, about both axes: it shows three sides of a box
_IS_OPEN = 0.5  # length of the mean normal of a surface, which is 0 of a closed one
_LEAST = 0.5  # height over width of a picture
_OVERLAP = 0.3  # points, by which neighbours overlap: no ground is seen between them


def sides_of(view: BodyView) -> tuple[Side, ...]:
    """Sides from which the measured surface is seen: one of a wall that is measured on its front alone."""
    return ("lit", "far") if _front(view) is None else ("lit",)


@in_report_style
def lit_body(view: BodyView, irradiance: Float[np.ndarray, " p"], unit: LightUnit, side: Side) -> Figure:
    """The ``irradiance`` (W/m²) of each patch of the body, as seen from the lens, or from behind the body."""
    corners = view.pose.points(view.patches.corners)
    middle = corners.mean(axis=(0, 1))
    front = _front(view)
    ahead = middle if front is None else -front
    away = 1.0 if side == "lit" else -1.0
    seen = _eye(away * ahead).to_local_points(corners.reshape(-1, 3) - middle).reshape(corners.shape)
    first, second, third = np.moveaxis(seen, 1, 0)
    facing = np.cross(second - first, third - first)[:, 2] < 0.0
    order = np.argsort(-seen[facing].mean(axis=1)[:, 2], kind="stable")  # the farthest first
    light = unit.per_watt * irradiance
    colours = ScalarMappable(Normalize(0.0, float(light.max()) or 1.0), "inferno")
    shown = seen[facing][order]
    painted = colours.to_rgba(light[view.patches.numbers[facing][order]])
    low = shown[..., :2].min(axis=(0, 1))
    high = shown[..., :2].max(axis=(0, 1))
    width, height = (high - low).tolist()
    figure, axes, bar = new_map(tall=max(height / width, _LEAST))
    pieces = PolyCollection(list(shown[..., :2]), facecolors=painted, edgecolors=painted, linewidths=_OVERLAP)
    pieces.set_rasterized(True)
    axes.add_collection(pieces)
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.set_axis_off()
    add_colour_bar(bar, colours, unit.label)
    return figure


def _front(view: BodyView) -> Float[np.ndarray, "3"] | None:
    """Mean direction that an open surface faces; None for a closed one."""
    areas_mm2 = view.patches.areas_mm2
    mean = areas_mm2 @ view.pose.directions(view.patches.normals) / areas_mm2.sum()
    return mean if np.linalg.norm(mean) > _IS_OPEN else None


def _eye(direction: Float[np.ndarray, "3"]) -> Pose:
    """The frame of a picture whose z axis goes away from the eye, nearly along ``direction``."""
    x, y, z = direction.tolist()
    return Pose.facing((x, y, z)).after(Pose.of_tilts(tilt_deg=(_ASIDE_DEG, -_ASIDE_DEG)))
