"""The bodies of a ``[[scene]]`` in the way of light from the lens to a receiver or an eye.

A ray that meets one of them before its end is lost there, is reflected, or crosses a clear one, and so on from body to
body (``scene.housing_walk``). A search takes clear ones for air. As light must fade out in
it, it also dims rays that pass a rim closely. With c the distance of a place of a body from the ray's line, and L how
far that place lies along it from the origin of the lamp, the least t = c / L counts: below ``rim`` a ray has the weight
``x^2 (3 - 2 x)``, x = t / rim, whose slope is that of its distance from the body. Bodies then seem larger by half of
the angle ``rim``; with it that goes to 0, and the noise of the slope grows.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from math import radians, tan
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from lensforge.kernels.parallel import in_pieces
from lensforge.kernels.rims import dim_beside_rims
from lensforge.kernels.triangle_tree import TriangleTree, any_hits, first_hits, tree_of
from lensforge.optics.arrays import Array, lengths, like, replaced
from lensforge.optics.dielectric import unpolarised_fields
from lensforge.optics.pose import IN_PLACE, Pose, Vector
from lensforge.scene.clear_crossing import CrossedRays, RaysWithin, refracted, totally_reflected
from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.housing_mesh import contents_of, placed_mesh
from lensforge.scene.wall_reflection import AtWalls, diffused, mirrored, towards_light
from lensforge.spec.housing_sections import HousingSection, bodies_of
from lensforge.surfaces.mirror_group import group
from lensforge.surfaces.smooth_facets import facet_curvatures, smooth_faces
from lensforge.surfaces.solid_file import rims_of

_DIGITS = 5  # of a mm, to which corners have mirror images
_AT_END_MM = 1e-6  # a body in the very surface of a receiver is none before it
_OFF_WALL_MM = 1e-6  # from which reflected light starts: it does not meet the place that it leaves
_WORTH_SHARING = 2**10  # rays: a millisecond of work

_Vectors = Float[np.ndarray, "n 3"]
_Values = Float[np.ndarray, " n"]


class Shadow(NamedTuple):
    """Rays in the shadow of bodies: the ``weights`` with which they get through, and the body that each meets, or -1.

    ``places``: at which they meet it first (mm), in the frame of the bodies; 0 of others, and in a search beside black
    bodies, which asks for any that a ray meets. ``by_points``, ``by_directions``:
    slopes of the weights by the points (1/mm) and directions of the rays; of ``onward`` where they meet a body.
    ``triangles``: that each meets, or -1. ``onward``: share of the flux that goes on from there, 1 of rays that meet
    none. ``again``: True for rays that meet a further wall when they go on from no more.
    """

    weights: _Values
    bodies: Int[np.ndarray, " n"]
    places: _Vectors
    by_points: _Vectors
    by_directions: _Vectors
    triangles: Int[np.ndarray, " n"]
    onward: _Values
    again: Bool[np.ndarray, " n"]

    @staticmethod
    def none_of(count: int) -> "Shadow":
        """Rays that all get through."""
        places, by_points, by_directions = np.zeros((3, count, 3))
        return Shadow(
            weights=np.ones(count),
            bodies=np.full(count, -1),
            places=places,
            by_points=by_points,
            by_directions=by_directions,
            triangles=np.full(count, -1),
            onward=np.ones(count),
            again=np.zeros(count, dtype=bool),
        )

    def weights_by(self, points: Float[Array, "n 3"], directions: Float[Array, "n 3"]) -> Float[Array, " n"]:
        """The weights; of rays in torch differentiable."""
        return self._moved(self.weights, ~self.met, points, directions)

    def onward_by(self, points: Float[Array, "n 3"], directions: Float[Array, "n 3"]) -> Float[Array, " n"]:
        """The shares that go on; of rays in torch differentiable."""
        return self._moved(self.onward, self.met, points, directions)

    def _moved(
        self,
        shares: _Values,
        have_slopes: Bool[np.ndarray, " n"],
        points: Float[Array, "n 3"],
        directions: Float[Array, "n 3"],
    ) -> Float[Array, " n"]:
        values = like(points, shares)
        if isinstance(points, np.ndarray):
            return values
        sloping = have_slopes[:, None]
        by_points, by_directions = (like(points, slopes * sloping) for slopes in (self.by_points, self.by_directions))
        moved = (points - points.detach()) * by_points + (directions - directions.detach()) * by_directions
        return values + moved.sum(1)

    @property
    def met(self) -> Bool[np.ndarray, " n"]:
        """True for rays that meet a body."""
        return self.bodies >= 0

    @property
    def lost(self) -> _Values:
        """Share of the flux of each ray that bodies take."""
        return np.where(self.again, 1.0, 1.0 - self.onward)

    def take(self, rows: Int[np.ndarray, " k"] | slice) -> "Shadow":
        """The shadow on some of the rays."""
        return Shadow(*(column[rows] for column in self))


class Reflected(NamedTuple):
    """The ``rays`` from walls, and the ``rows`` that they had among those that came."""

    rows: Int[np.ndarray, " k"]
    rays: ExitRays


class Finishes(NamedTuple):
    """Finish of each body: the share of light that it reflects, 0 for a black one, and whether it spreads it.

    ``indices``, ``absorptions`` (1/mm): of clear bodies; 0 for others.
    """

    reflectances: Float[np.ndarray, " b"]
    diffuse: Bool[np.ndarray, " b"]
    indices: Float[np.ndarray, " b"]
    absorptions: Float[np.ndarray, " b"]

    @staticmethod
    def of(sections: Sequence[HousingSection]) -> "Finishes":
        """The finishes of bodies of a spec."""
        return Finishes(
            reflectances=np.array([section.reflectance or 0.0 for section in sections]),
            diffuse=np.array([section.surface == "diffuse" for section in sections]),
            indices=np.array([section.index for section in sections]),
            absorptions=np.array([section.absorption_per_mm or 0.0 for section in sections]),
        )

    @property
    def clear(self) -> Bool[np.ndarray, " b"]:
        """True for clear bodies."""
        return self.indices > 0.0

    @property
    def opaque(self) -> "Finishes":
        """The finishes without those of clear bodies."""
        none = np.zeros_like(self.indices)
        return self._replace(indices=none, absorptions=none)


@dataclass(frozen=True, eq=False)
class Housing:
    """The bodies of a scene: their ``names``, the ``tree`` of their triangles, and of each triangle its body.

    ``finishes``: of the bodies. ``edges``: the tree of the edges in which they are not flat, ``edge_bodies`` the body
    of each. ``events``: the most bodies from which light goes on; one less the most total reflections within a clear
    one. ``place``: of the bodies in the frame of the rays. ``rim``: largest tangent of the angle to an edge at which
    rays are dimmed; 0: none is. ``whole``: tree of all triangles, if light of lamps cannot meet all first;
    None: that is ``tree``.
    """

    names: tuple[str, ...]
    tree: TriangleTree
    edges: TriangleTree
    bodies: Int[np.ndarray, " t"]
    edge_bodies: Int[np.ndarray, " e"]
    finishes: Finishes
    events: int = 1
    place: Pose = IN_PLACE
    rim: float = 0.0
    whole: TriangleTree | None = None

    def __len__(self) -> int:
        return len(self.names)

    @staticmethod
    def of(sections: Sequence[HousingSection], events: int = 1) -> "Housing | None":
        """The bodies of a spec; None without any. Raises :class:`InputError` for a file that cannot be read."""
        bodies = bodies_of(sections)
        return _housing(bodies, contents_of(bodies), events) if bodies else None

    @property
    def reflects(self) -> bool:
        """True if light goes on from a body."""
        return bool(self.finishes.reflectances.any() or self.finishes.clear.any())

    @property
    def opaque(self) -> "Housing | None":
        """The bodies without clear ones; None if all are clear."""
        return _opaque(self) if self.finishes.clear.any() else self

    @property
    def black(self) -> "Housing | None":
        """The bodies as if all were black, without clear ones; None if all are clear."""
        return self.opaque and replace(self.opaque, finishes=Finishes(*map(np.zeros_like, self.finishes)))

    @property
    def reach_mm(self) -> float:
        """Largest distance of a place of a body from the origin."""
        return float(lengths(self.place.points(self.tree.corners.reshape(-1, 3))).max())

    def faded(self, rim_deg: float) -> "Housing":
        """Opaque bodies as a search sees them: they dim rays beside their rims."""
        return replace(self, finishes=self.finishes.opaque, rim=tan(radians(rim_deg)))

    def lit_from(self, centres_mm: Sequence[Vector], radius_mm: float) -> "Housing":
        """The bodies for rays that all begin in balls outside of them, by the triangles that light from there can meet
        first."""
        centres = self.place.to_local_points(np.array(centres_mm))
        lit = _lit_tree(self, tuple(map(tuple, centres.tolist())), radius_mm)
        return replace(self, tree=lit, whole=self._every)

    def seen_from(self, frame: Pose) -> "Housing":
        """The bodies as a lamp in ``frame`` sees them."""
        return replace(self, place=self.place.seen_from(frame))

    def has_mirrors(self, symmetry: str) -> bool:
        """True if the bodies together have the mirror group ``symmetry`` about the axis: each corner has its images.

        A corner and its images are of bodies that reflect light alike.
        """
        corners = self.place.points(self.edges.corners.reshape(-1, 3))
        bodies = np.repeat(self.edge_bodies[self.edges.numbers], 2)
        finishes = np.stack([finish[bodies] for finish in self.finishes], axis=1)
        known, *images = (_rounded(np.hstack([corners @ mirror.T, finishes])) for mirror in group(symmetry))
        return all(image <= known for image in images)

    def shadow(self, points: _Vectors, directions: _Vectors, reach_mm: _Values) -> Shadow:
        """Shadow on rays from ``points`` (mm) that end after ``reach_mm``; a ray of negative reach is in none."""
        starts = self._local(points, self.place.to_local_points)
        units = self._local(directions, self.place.to_local_directions)
        ends = reach_mm - _AT_END_MM
        shadow = Shadow.none_of(len(points))
        if self.rim == 0.0 or self.reflects:
            self._meet_first(shadow, starts, units, ends)
        else:
            shadow.triangles[:] = _any_met(starts, units, ends, self.tree)
        shadow.weights[shadow.triangles >= 0] = 0.0
        met = np.flatnonzero(shadow.triangles >= 0)
        shadow.bodies[met] = self.bodies[shadow.triangles[met]]
        shadow.onward[met] = self.finishes.reflectances[shadow.bodies[met]]
        clear = met[self.finishes.clear[shadow.bodies[met]]]
        if len(clear):
            shadow.onward[clear] = self._crossing(shadow, clear, units[clear]).share
        if self.rim > 0.0:
            self._dim(shadow, starts, units, ends)
        return shadow

    def endless_shadow(self, rays: ExitRays) -> Shadow:
        """Shadow on ``rays``, NumPy arrays, those that left the lens, however far they go."""
        return self.shadow(rays.points, rays.directions, np.where(rays.left_lens, np.inf, -np.inf))

    def blocks(self, points: _Vectors, directions: _Vectors, reach_mm: _Values) -> Bool[np.ndarray, " n"]:
        """True for rays from walls, which may meet any triangle, that do so before they end after ``reach_mm``."""
        starts = self._local(points, self.place.to_local_points)
        units = self._local(directions, self.place.to_local_directions)
        return np.asarray(_any_met(starts, units, reach_mm - _AT_END_MM, self._every) >= 0)

    def _meet_first(self, shadow: Shadow, starts: _Vectors, units: _Vectors, ends: _Values) -> None:
        """Fill the first triangles and places that rays in the frame of the bodies meet."""
        distances = np.empty(len(starts))

        def cast(part: slice) -> None:
            first_hits(starts[part], units[part], ends[part], self.tree, distances[part], shadow.triangles[part])

        in_pieces(cast, len(starts), worth=_WORTH_SHARING)
        met = np.flatnonzero(shadow.triangles >= 0)
        shadow.places[met] = starts[met] + distances[met, None] * units[met]

    def _dim(self, shadow: Shadow, starts: _Vectors, units: _Vectors, ends: _Values) -> None:
        """Dim the weights of the ``shadow`` beside rims, and what walls send on, and fill their slopes.

        Light that meets a wall fades out beside the rims of others before it, and towards that of the wall itself.
        """
        lens = np.array(self.place.inverse.origin_mm)
        shares = np.where(shadow.met, shadow.onward, shadow.weights)
        if self.reflects:
            faces, sides = self.faces
            lit = np.flatnonzero(shadow.met)
            ends = replaced(ends, lit, ((shadow.places - starts)[lit] * units[lit]).sum(axis=1))
            faces = np.where(shadow.met, faces[shadow.triangles], -1)
        else:
            sides = np.zeros((len(self.edges.corners), 2), dtype=np.int64)
            faces = np.full(len(starts), -1)
        weights = np.where(shares > 0.0, 1.0, 0.0)

        def cast(part: slice) -> None:
            rays = starts[part], units[part], ends[part], faces[part]
            slopes = shadow.by_points[part], shadow.by_directions[part]
            dim_beside_rims(*rays, lens, self.rim, self.edges, sides, weights[part], *slopes)

        in_pieces(cast, len(starts), worth=_WORTH_SHARING)
        rows = np.flatnonzero((weights < 1.0) & (weights > 0.0))
        for slopes in (shadow.by_points, shadow.by_directions):
            slopes[rows] = shares[rows, None] * self.place.directions(slopes[rows])
        shadow.weights[:] = np.where(shadow.met, 0.0, weights)
        shadow.onward[:] = np.where(shadow.met, shares * weights, 1.0)

    def reflected(self, rays: ExitRays, shadow: Shadow) -> Reflected:
        """Rays from where ``rays`` meet bodies that reflect light, or leave clear ones, with the flux that goes on.

        ``shadow``: theirs.
        """
        rows = np.flatnonzero(shadow.met & ~shadow.again & (shadow.onward > 0.0))
        coming = self.place.to_local_directions(rays.directions[rows])
        normals = towards_light(self.normals[shadow.triangles[rows]], coming)
        going = mirrored(coming, normals)
        spread = np.flatnonzero(self.finishes.diffuse[shadow.bodies[rows]])
        if len(spread):
            assert rays.draws is not None, "the media know of diffuse walls"
            going[spread] = diffused(coming[spread], normals[spread], rays.draws[rows[spread], :2])
        starts = shadow.places[rows] + _OFF_WALL_MM * normals
        clear = np.flatnonzero(self.finishes.clear[shadow.bodies[rows]])
        if len(clear):
            starts[clear], going[clear], _ = self._crossing(shadow, rows[clear], coming[clear])
        flux = shadow.onward[rows] * rays.flux[rows]
        ways = self.place.points(starts), self.place.directions(going)
        draws = None if rays.draws is None else rays.draws[rows, 2:]
        return Reflected(rows, ExitRays(*ways, flux, np.zeros_like(flux), rays.fates[rows], draws=draws))

    def at_walls(self, shadow: Shadow, reflected: Reflected) -> AtWalls:
        """The rays of a ``shadow`` at the opaque walls that send them on as ``reflected``."""
        rows = reflected.rows
        triangles = shadow.triangles[rows]
        curvatures = self.curvatures[triangles]
        if self.place.moves:
            curvatures = self.place.rotation @ curvatures @ self.place.rotation.T
        return AtWalls(
            places=self.place.points(shadow.places[rows]),
            normals=self.place.directions(self.normals[triangles]),
            curvatures=curvatures,
            starts=reflected.rays.points,
            going=reflected.rays.directions,
            diffuse=self.finishes.diffuse[shadow.bodies[rows]],
        )

    def _crossing(self, shadow: Shadow, rows: Int[np.ndarray, " k"], coming: _Vectors) -> CrossedRays:
        """Light behind the clear bodies that the rays ``rows`` of a ``shadow`` meet, in the frame of the bodies.

        One that meets another body within, as where bodies overlap, does not leave.
        """
        bodies = shadow.bodies[rows]
        inwards = -towards_light(self.normals[shadow.triangles[rows]], coming)
        within = refracted(coming, unpolarised_fields(coming), inwards, 1.0 / self.finishes.indices[bodies])
        starts = shadow.places[rows] + _OFF_WALL_MM * inwards
        return self._out_of(bodies, RaysWithin(starts, *within), self.events)

    def _out_of(self, bodies: Int[np.ndarray, " k"], rays: RaysWithin, events: int) -> CrossedRays:
        """Light that leaves ``bodies`` from within at one of so many ``events``; at others it is totally reflected."""
        starts, within, fields = rays
        index = self.finishes.indices[bodies]
        lengths_mm = np.empty(len(bodies))
        numbers = np.empty(len(bodies), dtype=np.int64)
        first_hits(starts, within, np.full(len(bodies), np.inf), self.tree, lengths_mm, numbers)
        leaves = (numbers >= 0) & (self.bodies[numbers] == bodies)
        lengths_mm = np.where(leaves, lengths_mm, 0.0)
        outwards = -towards_light(self.normals[numbers], within)
        going, passed = refracted(within, fields, outwards, index)
        left = np.exp(-self.finishes.absorptions[bodies] * lengths_mm)
        share = 0.5 * (np.abs(passed) ** 2).sum(axis=(1, 2)) * left
        ends = starts + lengths_mm[:, None] * within
        crossed = CrossedRays(ends + _OFF_WALL_MM * outwards, going, share * leaves)
        total = np.flatnonzero(leaves & ~passed.any(axis=(1, 2)))
        if events > 1 and len(total):
            amplitudes = fields[total] * np.sqrt(left[total])[:, None, None]
            again = totally_reflected(within[total], amplitudes, outwards[total], index[total])
            inside = RaysWithin(ends[total] - _OFF_WALL_MM * outwards[total], *again)
            for values, later in zip(crossed, self._out_of(bodies[total], inside, events - 1), strict=True):
                values[total] = later
        return crossed

    @cached_property
    def normals(self) -> _Vectors:
        """Unit normal of each triangle, in the order of their numbers."""
        normals = np.zeros((len(self.bodies), 3))
        first, second, third = np.moveaxis(self.tree.corners, 1, 0)
        normals[self.tree.numbers] = np.cross(second - first, third - first)
        return np.asarray(normals / np.maximum(lengths(normals), np.finfo(float).tiny)[:, None])

    @cached_property
    def curvatures(self) -> Float[np.ndarray, "t 3 3"]:
        """Change of the normal along each triangle (1/mm), in the order of their numbers: see ``facet_curvatures``."""
        curvatures = np.zeros((len(self.bodies), 3, 3))
        curvatures[self._every.numbers] = facet_curvatures(self._every.corners)
        return curvatures

    @cached_property
    def faces(self) -> tuple[Int[np.ndarray, " t"], Int[np.ndarray, "e 2"]]:
        """Number of the smooth face of each triangle, by its number, and of the two faces beside each edge."""
        faces = np.full(len(self.bodies), -1)
        faces[self._every.numbers], sides = smooth_faces(self._every.corners, self.edges.corners)
        return faces, sides

    @property
    def _every(self) -> TriangleTree:
        """The tree of all triangles."""
        return self.tree if self.whole is None else self.whole

    def _local(self, vectors: _Vectors, move: Callable[[_Vectors], _Vectors]) -> _Vectors:
        """Vectors in the frame of the bodies, in the order that kernels take."""
        return np.ascontiguousarray(move(vectors) if self.place.moves else vectors)


def _any_met(starts: _Vectors, units: _Vectors, ends: _Values, tree: TriangleTree) -> Int[np.ndarray, " n"]:
    """Number of any triangle that each ray meets, which is quicker than the first; -1 for none."""
    numbers = np.empty(len(starts), dtype=np.int64)

    def cast(part: slice) -> None:
        any_hits(starts[part], units[part], ends[part], tree, numbers[part])

    in_pieces(cast, len(starts), worth=_WORTH_SHARING)
    return numbers


def _rounded(points: Float[np.ndarray, "n k"]) -> set[tuple[float, ...]]:
    return {*map(tuple, (np.round(points, _DIGITS) + 0.0).tolist())}


@lru_cache(maxsize=8)
def _housing(sections: tuple[HousingSection, ...], _contents: tuple[str, ...], events: int) -> Housing:
    meshes = [placed_mesh(section) for section in sections]
    corners = np.concatenate([mesh.vertices[mesh.triangles] for mesh in meshes])
    bodies = np.repeat(np.arange(len(meshes)), [len(mesh.triangles) for mesh in meshes])
    rims = [rims_of(mesh) for mesh in meshes]
    names = tuple(section.name for section in sections)
    edge_bodies = np.repeat(np.arange(len(meshes)), [len(edges) for edges in rims])
    trees = tree_of(corners), tree_of(np.concatenate(rims))
    return Housing(names, *trees, bodies, edge_bodies, Finishes.of(sections), events)


@lru_cache(maxsize=8)
def _opaque(housing: Housing) -> Housing | None:
    """The housing without the triangles and edges of clear bodies."""
    clear = housing.finishes.clear
    if clear.all():
        return None
    tree, edges = (
        _some_of(tree, ~clear[bodies[tree.numbers]])
        for tree, bodies in ((housing.tree, housing.bodies), (housing.edges, housing.edge_bodies))
    )
    return replace(housing, tree=tree, edges=edges)


@lru_cache(maxsize=8)
def _lit_tree(housing: Housing, centres_mm: tuple[Vector, ...], radius_mm: float) -> TriangleTree:
    """The tree without triangles whose back faces all of the balls: light that meets one has met another before."""
    tree = housing.tree
    normals = housing.normals[tree.numbers]
    heights = np.array(centres_mm) @ normals.T - (tree.corners[:, 0] * normals).sum(axis=1)
    return _some_of(tree, heights.max(axis=0) > -radius_mm)


def _some_of(tree: TriangleTree, kept: Bool[np.ndarray, " t"]) -> TriangleTree:
    """The tree of some triangles or edges, with the numbers that they had; the same tree if none are ``kept``."""
    rows = np.flatnonzero(kept)
    if len(rows) in (0, len(kept)):
        return tree
    some = tree_of(tree.corners[rows])
    return some._replace(numbers=tree.numbers[rows][some.numbers])
