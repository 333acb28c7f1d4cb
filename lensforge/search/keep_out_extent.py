"""Extent of the keep-out as the cavity sees it: along each ray from the origin, the last point that must stay clear.

A cavity that reaches further in every direction z >= 0 holds all of the keep-out above z = 0, grown by its margin. The
part below z = 0 concerns the base, which the search does not change: the finished part is measured against it.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial import cKDTree
from torch import Tensor

from lensforge.cad.keep_out import FACET_MM, KeepOut, read_keep_out
from lensforge.errors import InputError
from lensforge.kernels.clearance import grown_extents
from lensforge.kernels.parallel import in_chunks
from lensforge.search.constraint_points import ChartPoints
from lensforge.spec import Spec
from lensforge.spec.spec_section import rounded_up
from lensforge.surfaces import surface
from lensforge.surfaces.mirror_group import group
from lensforge.surfaces.srbf import fibonacci_hemisphere

# Directions at which the outline is looked for around the points of a search, and their distance on the chart: a bond
# wire with its margin is 0.2 mm across, 0.1 rad at 2 mm.
_DIRECTIONS, _SPACING = 60_000, 0.01
_GROUP = 32  # neighbouring triangles that a ray passes by in one test: a ball of 10,000 takes 0.9 s of one core


@dataclass(frozen=True)
class KeepOutExtent:
    """Extent (mm) of a keep-out, grown by ``growth_mm``, for a lens of mirror group ``symmetry``.

    A symmetric lens stays clear of all mirror images. Solids that lie beyond ``largest_mm``, the largest radius of the
    lens, stand beside it and do not concern the cavity.
    """

    keep_out: KeepOut
    growth_mm: float
    largest_mm: float
    symmetry: str

    @staticmethod
    def of(spec: Spec) -> "KeepOutExtent":
        """The keep-out of ``spec``; symmetry "auto" counts as none. Raises :class:`InputError`."""
        limits = spec.constraints
        assert limits.keep_out is not None
        symmetry = "none" if spec.lens.symmetry == "auto" else spec.lens.symmetry
        growth_mm = limits.keep_out_margin_mm + FACET_MM  # a mesh lies within its curved faces
        return KeepOutExtent(read_keep_out(limits.keep_out), growth_mm, limits.max_radius_mm, symmetry)

    def at(self, points: ChartPoints) -> Float[Tensor, " k"]:
        """Extent at ``points``, computed once for them; the largest within their spacing, 0 where nothing is."""
        return _extent_at(self, points)

    def along(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """Extent along unit ``directions``; 0 where there is nothing."""
        corners, balls, groups = _in_groups(self._corners_inside(), self.growth_mm)
        found = np.zeros(len(directions))
        for image in group(self.symmetry):
            turned, extents = np.ascontiguousarray(directions @ image), np.zeros(len(directions))

            def work(_: int, rows: slice, turned: np.ndarray = turned, extents: np.ndarray = extents) -> None:
                grown_extents(turned[rows], corners, balls, groups, _GROUP, self.growth_mm, extents[rows])

            in_chunks(work, len(directions))
            found = np.maximum(found, extents)
        return found

    def _corners_inside(self) -> Float[np.ndarray, "t 3 3"]:
        """Triangles of the solids that are not beside the lens, those that reach above z = 0 when grown."""
        kept = [np.zeros((0, 3, 3))]
        for solid in self.keep_out.solids:
            corners = solid.corners
            corners = corners[corners[:, :, 2].max(axis=1) > -self.growth_mm]
            if len(corners) and _nearest_mm(corners) < self.largest_mm + self.growth_mm:
                kept.append(corners)
        return np.concatenate(kept)


def _in_groups(
    corners: Float[np.ndarray, "t 3 3"], growth_mm: float
) -> tuple[Float[np.ndarray, "k 3 3"], Float[np.ndarray, "k 4"], Float[np.ndarray, "g 4"]]:
    """The triangles in the order of their groups, a ball around each when grown, and a ball around each group.

    The last triangle fills its group up. The groups that reach furthest come first: most others end before the extent
    that these have found.
    """
    order = cKDTree(corners.mean(axis=1), leafsize=_GROUP).indices if len(corners) else np.zeros(0, dtype=int)
    order = np.pad(order, (0, -len(order) % _GROUP), mode="edge") if len(order) else order
    blocks = corners[order].reshape(-1, _GROUP, 3, 3)
    centres = blocks.mean(axis=2)
    reaches = np.linalg.norm(blocks - centres[:, :, None], axis=3).max(axis=2) + growth_mm
    middle = centres.mean(axis=1)
    radius = (np.linalg.norm(centres - middle[:, None], axis=2) + reaches).max(axis=1)
    first = np.argsort(-(np.linalg.norm(middle, axis=1) + radius), kind="stable")
    balls = np.concatenate([centres, reaches[:, :, None]], axis=2)[first].reshape(-1, 4)
    groups = np.column_stack([middle, radius])[first]
    return np.ascontiguousarray(blocks[first].reshape(-1, 3, 3)), np.ascontiguousarray(balls), groups


def _nearest_mm(corners: Float[np.ndarray, "t 3 3"]) -> float:
    """Least distance (mm) of the origin from triangles."""
    import trimesh

    return float(np.linalg.norm(trimesh.triangles.closest_point(corners, np.zeros((len(corners), 3))), axis=1).min())


@lru_cache(maxsize=8)
def _extent_at(extent: KeepOutExtent, points: ChartPoints) -> Float[Tensor, " k"]:
    places = np.stack([points.x.numpy(), points.y.numpy()], axis=1)
    found = extent.along(surface.to_sphere(places))
    if points.spacing > 0.0:
        around, values = _outline(extent)
        near = cKDTree(around).query_ball_point(places, points.spacing + _SPACING)
        found = np.array([max(own, values[k].max(initial=0.0)) for own, k in zip(found, near, strict=True)])
    return torch.from_numpy(found)


@lru_cache(maxsize=2)
def _outline(extent: KeepOutExtent) -> tuple[Float[np.ndarray, "m 2"], Float[np.ndarray, " m"]]:
    """Chart places and extents (mm) of the directions in which there is something, all over the hemisphere."""
    directions = fibonacci_hemisphere(_DIRECTIONS)
    extents = extent.along(directions)
    return surface.to_chart(directions[extents > 0.0]), extents[extents > 0.0]


def require_keep_out_fits(spec: Spec) -> None:
    """Raise :class:`InputError` where the keep-out and the wall around it do not fit into the largest lens."""
    limits = spec.constraints
    directions = fibonacci_hemisphere(_DIRECTIONS)
    extents = KeepOutExtent.of(spec).along(directions)
    rooms = [("max_radius_mm", limits.max_radius_mm, np.ones(len(directions)))]
    if limits.max_height_mm is not None:
        rooms.append(("max_height_mm", limits.max_height_mm, directions[:, 2]))
    for name, most, share in rooms:
        needed = np.where(extents > 0.0, (extents + limits.min_thickness_mm) * share, 0.0) + 3.0 * limits.margin_mm
        worst = int(needed.argmax())
        if needed[worst] > most:
            x, y, z = extents[worst] * directions[worst]
            raise InputError(
                f"constraints.keep_out: {limits.keep_out} with keep_out_margin_mm = {limits.keep_out_margin_mm:g} "
                f"reaches ({x:.4g}, {y:.4g}, {z:.4g}) mm; around it a wall of min_thickness_mm = "
                f"{limits.min_thickness_mm:g} needs a {name} of at least {rounded_up(float(needed[worst]))}, it is "
                f"{most:g}: raise it, move the solid below z = 0, or leave out what stands beside the lens"
            )
