"""The bodies of a scene as verification sees them: a mesh in the way of rays to a receiver.

Turned by rotations of its own, and cast through the grid by which it casts the part. Rays of the design come with the
numbers by which diffuse walls reflect them; the proof's own rays have others.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

from lensforge.optics.media import Media
from lensforge.proof.clear_body import SwingingRays
from lensforge.proof.facet_casting import Grid, Leg
from lensforge.sources.ray_bundle import RayBundle

_AT_END_MM = 1e-6  # a body in the very surface of a receiver is none before it
_OFF_WALL_MM = 1e-6
_UPRIGHT = 1e-12  # sine of incidence below which a ray has no direction along the wall
_WALLS = 7  # of seeds: numbers that those of no face are


class ObstacleBody(NamedTuple):
    """Vertices (mm) and triangles of a body in its own frame, which is turned about z, tilted, and then placed.

    ``reflectance``: share of light that it reflects, 0 for a black one; ``diffuse``: in all directions.
    ``refractive_index``, ``absorption_per_mm``: of a clear one; 0 for others.
    """

    vertices: Float[np.ndarray, "v 3"]
    triangles: Int[np.ndarray, "t 3"]
    rotate_z_deg: float
    tilt_deg: tuple[float, float]
    centre_mm: tuple[float, float, float]
    reflectance: float = 0.0
    diffuse: bool = False
    refractive_index: float = 0.0
    absorption_per_mm: float = 0.0

    @property
    def corners(self) -> Float[np.ndarray, "t 3 3"]:
        """Corners (mm) of its triangles, in its place."""
        turn = Rotation.from_euler("zxy", [self.rotate_z_deg, *self.tilt_deg], degrees=True)  # small: about fixed axes
        return np.asarray((turn.apply(self.vertices) + self.centre_mm)[self.triangles])


class Met(NamedTuple):
    """Bodies that rays meet: numbers of their triangles, -1 for none, and the distances (mm).

    ``onward``: share of the light that goes on, 1 of a ray that meets none.
    """

    triangles: Int[np.ndarray, " n"]
    distances: Float[np.ndarray, " n"]
    onward: Float[np.ndarray, " n"]

    def take(self, rows: Int[np.ndarray, " k"]) -> "Met":
        """Bodies that some of the rays meet."""
        return Met(*(column[rows] for column in self))


class Way(NamedTuple):
    """Straight ways of some rays, from ``points`` (mm) along ``directions``, and what they have ``met`` at their ends.

    ``rows``: their numbers; ``share``: of their flux that is on the way. ``last``: True if they go on from no body.
    """

    rows: Int[np.ndarray, " k"]
    points: Float[np.ndarray, "k 3"]
    directions: Float[np.ndarray, "k 3"]
    share: Float[np.ndarray, " k"]
    met: Met
    last: bool


@dataclass(frozen=True, eq=False)
class Obstacles:
    """Triangles (mm) of all ``bodies``, in the coordinates of the screens, and how each turns light.

    ``events``: the most bodies from which light goes on, and ends of its way within a clear one.
    """

    corners: Float[np.ndarray, "t 3 3"]
    bodies: Int[np.ndarray, " t"]
    events: int
    reflectances: Float[np.ndarray, " t"]
    diffuse: Bool[np.ndarray, " t"]
    indices: Float[np.ndarray, " t"]
    absorptions: Float[np.ndarray, " t"]

    @staticmethod
    def of(bodies: Sequence[ObstacleBody], events: int = 1) -> "Obstacles | None":
        """All ``bodies``; None without any."""
        if not bodies:
            return None
        counts = [len(body.triangles) for body in bodies]
        finishes = zip(
            *((body.reflectance, body.diffuse, body.refractive_index, body.absorption_per_mm) for body in bodies),
            strict=True,
        )
        return Obstacles(
            np.concatenate([body.corners for body in bodies]),
            np.repeat(np.arange(len(bodies)), counts),
            events,
            *(np.repeat(finish, counts) for finish in finishes),
        )

    @cached_property
    def _grid(self) -> Grid:
        import trimesh

        numbers = np.arange(3 * len(self.corners)).reshape(-1, 3)
        return Grid(trimesh.Trimesh(self.corners.reshape(-1, 3), numbers, process=False))

    def met(
        self, points: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"], paths_mm: Float[np.ndarray, " n"]
    ) -> Met:
        """Bodies that rays meet before the end of their paths."""
        hits = self._grid.first_hits(Leg(points, directions, np.zeros(len(points))))
        blocked = hits.found & (hits.distances < paths_mm - _AT_END_MM)
        onward = np.where(blocked, self.reflectances[hits.triangles], 1.0)
        met = Met(np.where(blocked, hits.triangles, -1), hits.distances, onward)
        clear = np.flatnonzero(blocked & (self.indices[hits.triangles] > 0.0))
        if len(clear):
            onward[clear] = self._across(points[clear], directions[clear], met.take(clear))[2]
        return met

    def _across(
        self, points: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"], met: Met
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
        """Points and directions of rays behind clear bodies, and the share of their light that leaves."""
        index = self.indices[met.triangles]
        inwards = self._along(met.triangles, directions)
        light, _ = SwingingRays.unpolarised(directions).at_face(inwards, 1.0 / index)
        places = points + met.distances[:, None] * directions + _OFF_WALL_MM * inwards
        going = light.directions.copy()
        share = np.zeros(len(points))
        paths_mm = np.zeros(len(points))
        rows = np.arange(len(points))
        for _ in range(self.events):
            ends = self._grid.first_hits(Leg(places[rows], light.directions, np.zeros(len(rows))))
            within = np.flatnonzero(ends.found & (self.bodies[ends.triangles] == self.bodies[met.triangles[rows]]))
            rows = rows[within]
            ends = ends.take(within)
            light = light.take(within)
            paths_mm[rows] += ends.distances
            outwards = self._along(ends.triangles, light.directions)
            at = places[rows] + ends.distances[:, None] * light.directions
            light, passes = light.at_face(outwards, index[rows])
            going[rows] = light.directions
            places[rows] = at + np.where(passes, _OFF_WALL_MM, -_OFF_WALL_MM)[:, None] * outwards
            share[rows] = light.share * passes
            rows = rows[~passes]
            light = light.take(np.flatnonzero(~passes))
            if not len(rows):
                break
        return places, going, share * np.exp(-self.absorptions[met.triangles] * paths_mm)

    def _along(
        self, triangles: Int[np.ndarray, " n"], directions: Float[np.ndarray, "n 3"]
    ) -> Float[np.ndarray, "n 3"]:
        """Unit normals of triangles, turned along rays."""
        a, b, c = np.moveaxis(self.corners[triangles], 1, 0)
        across = np.cross(b - a, c - a)
        across *= np.sign(np.sum(across * directions, axis=1))[:, None]
        return np.asarray(across / np.linalg.norm(across, axis=1)[:, None])

    def ways(
        self,
        points: Float[np.ndarray, "n 3"],
        directions: Float[np.ndarray, "n 3"],
        numbers: Float[np.ndarray, "n d"],
        paths_to_end: Callable[[Float[np.ndarray, "k 3"], Float[np.ndarray, "k 3"]], Float[np.ndarray, " k"]],
    ) -> Iterator[Way]:
        """Ways of rays from body to body, the first of all of them; ``numbers``: two in [0, 1) of each at every body.

        ``paths_to_end``: paths (mm) of rays from these points along these directions to where they end without bodies.
        """
        rows = np.arange(len(points))
        share = np.ones(len(points))
        for event in range(self.events + 1):
            met = self.met(points, directions, paths_to_end(points, directions))
            last = event == self.events
            yield Way(rows, points, directions, share, met, last)
            on = np.flatnonzero((met.triangles >= 0) & (met.onward > 0.0))
            if last or not len(on):
                return
            rows = rows[on]
            share = share[on] * met.onward[on]
            two = numbers[rows, 2 * event : 2 * event + 2]
            points, directions = self.reflect(points[on], directions[on], met.take(on), two)

    def reflect(
        self,
        points: Float[np.ndarray, "n 3"],
        directions: Float[np.ndarray, "n 3"],
        met: Met,
        numbers: Float[np.ndarray, "n 2"],
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Points and directions from which rays go on that all ``met`` a body; ``numbers``: two in [0, 1) of each."""
        n = -self._along(met.triangles, directions)
        cosine = -np.sum(directions * n, axis=1)[:, None]
        flat = directions + cosine * n
        size = np.linalg.norm(flat, axis=1)[:, None]
        aside = np.cross(n, np.eye(3)[np.abs(n).argmin(axis=1)])
        t = np.where(size > _UPRIGHT, flat, aside / np.linalg.norm(aside, axis=1)[:, None])
        t /= np.linalg.norm(t, axis=1)[:, None]
        sine = np.sqrt(numbers[:, 0])
        spot = sine * np.exp(2j * np.pi * numbers[:, 1])
        spread = spot.real[:, None] * t + spot.imag[:, None] * np.cross(n, t) + np.sqrt(1.0 - sine**2)[:, None] * n
        going = np.where(self.diffuse[met.triangles][:, None], spread, flat + cosine * n)
        starts = points + met.distances[:, None] * directions + _OFF_WALL_MM * n
        clear = np.flatnonzero(self.indices[met.triangles] > 0.0)
        if len(clear):
            starts[clear], going[clear], _ = self._across(points[clear], directions[clear], met.take(clear))
        return starts, going


def wall_numbers(rays: RayBundle, media: Media, seed: int | None = None) -> Float[np.ndarray, "n d"]:
    """Two numbers in [0, 1) of each ray for every event at a wall; 0 without diffuse ones.

    They are those of the design's rays, or of ``seed``.
    """
    columns = 2 * media.wall_events
    if media.walls != "diffuse":
        return np.zeros((len(rays), columns))
    if seed is not None:
        return np.random.default_rng([seed, _WALLS]).random((len(rays), columns))
    last = 2 * media.scattering
    if rays.facets is None or rays.facets.shape[1] < last:
        raise ValueError("rays come without the numbers of the walls that they meet")
    return rays.facets[:, last - columns : last]
