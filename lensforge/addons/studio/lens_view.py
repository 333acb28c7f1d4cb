"""A lens to look at: both sides of its body as nets with figures at every node, its section, and rays through it.

A net has rings about the axis and spokes, on the chart of the hemisphere. Its figures are by differences between the
nodes: to look at, not to measure by. Figures that are stated come from the check.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from lensforge.cad.patch import PrincipalCurvatures
from lensforge.cad.section import body_outlines
from lensforge.light.lens_light import source_of
from lensforge.light.ray_lines import trace_fan
from lensforge.light.simulation import TracedLens
from lensforge.light.table_trace import Scene, Tables, TracedBundle
from lensforge.scene.body import Face, radii
from lensforge.scene.lens import Lens
from lensforge.shop.ball_cutter import largest_ball_mm
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.bicubic_table import TableGrid, evaluate_table
from lensforge.surfaces.surface import Surface, gradient_on_sphere, to_chart, to_sphere

_RINGS = np.linspace(0.0, 1.0, 25)
_SPOKES = np.linspace(0.0, 2.0 * np.pi, 73)
_PROFILE = np.linspace(-1.0, 1.0, 121)
_FAN_RAD = np.radians(np.linspace(-75.0, 75.0, 21))
_NODES_PER_SIGMA = 2.0  # of the tables that rays of a drawing pass: a pixel, not a micrometre
_REACH = 1.6  # of rays beyond the lens, relative to its radius
_RAYS = 240  # in space
_SEED = 1
_STEP = 1e-4  # of the chart, by which the slope of a table is found
Arrays = dict[str, np.ndarray]
Net = Float[np.ndarray, "r s 3"]
Figure = Float[np.ndarray, "r s"]


@dataclass(frozen=True)
class _Tabulated(Surface):
    """A face by its table of a search, in a fiftieth of the time of the sum of its functions."""

    grid: TableGrid
    table: Float[np.ndarray, "side side"]

    @property
    def detail_rad(self) -> float:
        """Width (rad) of its narrowest feature: a few of its nodes."""
        return 4.0 * self.grid.step

    def radius(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
        """``rho`` (mm), the distance from the origin."""
        return evaluate_table(self.grid, self.table, directions)

    def gradient(self, directions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Tangential gradient of ``rho`` (mm/rad), by differences."""
        chart = to_chart(directions)
        steps = _STEP * np.eye(2)
        both = [[self.radius(to_sphere(chart + sign * step)) for sign in (1.0, -1.0)] for step in steps]
        return gradient_on_sphere(chart, np.stack([0.5 * (ahead - behind) / _STEP for ahead, behind in both], axis=1))


def as_tabulated(lens: Lens, grid: TableGrid, tables: Tables) -> tuple[Lens, TracedLens]:
    """A lens of one kind with the tables of its search as its faces, and as rays meet them."""
    faces = {name: _Tabulated(grid, table) for name, table in zip(lens.surfaces, tables, strict=True)}
    scene = Scene.of_lens(lens.spec.lens, lens.media, grid)
    return replace(lens, surfaces=faces), TracedLens(scene, tables, {})


@dataclass(frozen=True)
class Side:
    """A side of the body: the faces that bound it, and where the air is, 1 outside and -1 in the cavity."""

    faces: tuple[Face, ...]
    air: int

    @cached_property
    def net(self) -> Net:
        """Points (mm) by ring and spoke; the first and the last spoke are the same."""
        return self.along(_RINGS[:, None, None] * np.stack([np.cos(_SPOKES), np.sin(_SPOKES)], axis=1))

    def along(self, chart: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 3"]:
        """Points (mm) at points of the chart."""
        directions = to_sphere(chart)
        return np.asarray(radii(self.faces, directions).min(axis=0)[..., None] * directions)

    @cached_property
    def outward(self) -> Net:
        """Unit normals away from the origin."""
        normals = np.cross(*_slopes(self.net))
        normals[0] = normals[1, :-1].mean(axis=0)  # spokes meet at the axis
        return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-300))

    @cached_property
    def curvatures(self) -> PrincipalCurvatures:
        """Principal curvatures (1/mm) at the nodes, seen from the air: by the first and second fundamental forms."""
        (u, v) = _slopes(self.net)
        (du, dv) = _slopes(self.air * self.outward)
        e, f, g, of_u, of_uv, of_v = (
            np.sum(a * b, axis=-1) for a, b in ((u, u), (u, v), (v, v), (du, u), (du, v), (dv, v))
        )
        area = np.where(e * g > f * f, e * g - f * f, 1.0)
        mean = 0.5 * (of_u * g - 2.0 * of_uv * f + of_v * e) / area
        spread = np.sqrt(np.maximum(mean**2 - (of_u * of_v - of_uv**2) / area, 0.0))
        mean[0] = mean[1, :-1].mean()
        spread[0] = spread[1, :-1].mean()
        return PrincipalCurvatures((mean - spread).ravel(), (mean + spread).ravel())

    @property
    def points(self) -> Float[np.ndarray, "k 3"]:
        """All nodes (mm)."""
        return self.net.reshape(-1, 3)

    @property
    def normals(self) -> Float[np.ndarray, "k 3"]:
        """Unit normals into the air at all nodes."""
        return self.air * self.outward.reshape(-1, 3)

    def figure(self, name: str, other: "Side") -> Figure:
        """``sag`` (mm), ``slope`` (degrees), the lower ``curvature`` (1/mm), ``wall`` or ``ball``.

        The wall (mm) is the distance from the ``other`` side; the ball, the largest (mm) that touches the face there,
        -1 where any does.
        """
        shape = self.net.shape[:2]
        if name == "slope":
            return np.degrees(np.arccos(np.clip(self.outward[..., 2], -1.0, 1.0)))
        if name == "curvature":
            return self.curvatures.minimum.reshape(shape)
        if name == "wall":
            _, nearest = cKDTree(other.points).query(self.points)
            return np.abs(np.sum((self.points - other.points[nearest]) * other.normals[nearest], axis=1)).reshape(shape)
        if name == "ball":
            largest = largest_ball_mm(self)
            return np.where(np.isfinite(largest), largest, -1.0).reshape(shape)
        return np.asarray(self.net[..., 2])


def _slopes(net: Net) -> tuple[Net, Net]:
    """Differences along the rings, and along the spokes, which close."""
    closed = np.concatenate([net[:, -2:-1], net, net[:, 1:2]], axis=1)
    return np.gradient(net, axis=0, edge_order=2), np.asarray(0.5 * (closed[:, 2:] - closed[:, :-2]))


def drawn(lens: Lens, figure: str, traced: TracedLens | None = None, *, whole: bool = False) -> Arrays:
    """Nets and normals of both sides with a ``figure``, the section along x, and rays in it, through ``traced``.

    Of a ``whole`` lens the section of its part, and rays of the LED in space with their fates.
    """
    outer = Side(lens.body.envelope, 1)
    inner = Side(lens.body.cavity, -1)
    arrays: Arrays = {}
    for name, side, other in (("outer", outer, inner), ("inner", inner, outer)):
        arrays |= {name: side.net, f"{name}_normal": side.outward, f"{name}_figure": side.figure(figure, other)}
    if whole:
        arrays |= {f"outline{number}": outline for number, outline in enumerate(body_outlines(lens, 0.0))}
    else:
        across = np.stack([_PROFILE, 0.0 * _PROFILE], axis=1)
        arrays["outline0"] = np.concatenate([outer.along(across), inner.along(across)[::-1]])[:, [0, 2]]
    reach_mm = _REACH * max(lens.spec.constraints.max_radius_mm, float(np.abs(outer.net).max()))
    traced = traced or TracedLens.of(lens, _NODES_PER_SIGMA)
    fan = np.stack([np.sin(_FAN_RAD), 0.0 * _FAN_RAD, np.cos(_FAN_RAD)], axis=1)
    origins = np.tile(np.array(lens.spec.source.pose.origin_mm, dtype=float), (len(fan), 1))
    arrays["fan"] = trace_fan(lens, origins, fan, reach_mm, traced)[..., [0, 2]]
    if whole:
        rays = source_of(lens.spec.in_first_state).sample(_RAYS, _SEED)
        rays = rays.take(np.flatnonzero(rays.directions[:, 2] > 0.0))
        bare = RayBundle(rays.origins, rays.directions, np.ones(len(rays)))
        arrays["fates"] = TracedBundle.of(traced.tables, traced.scene, bare).exits.fates.astype(float)
        arrays["rays"] = trace_fan(lens, bare.origins, bare.directions, reach_mm, traced)
    return arrays
