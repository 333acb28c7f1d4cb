"""Receivers in a pose, which map exit rays to hits without knowing the lens.

A receiver is a pixel grid on the chart of some surface, or of all directions; charts keep areas, so that pixels are
alike.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import singledispatch
from math import inf
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np
from jaxtyping import Bool, Float, Int

from lensforge.kernels.parallel import in_pieces
from lensforge.optics.arrays import Array, as_numpy, like, module_of, replaced, rows_of
from lensforge.optics.pose import Pose
from lensforge.scene.exit_rays import ExitRays, Sensitivities
from lensforge.scene.housing import Housing, Shadow
from lensforge.scene.housing_walk import SceneLeg, last_of, legs_of
from lensforge.scene.pixel_grid import PixelGrid, Window
from lensforge.scene.wall_reflection import AtWalls
from lensforge.spec.lamps_section import ALONE, Lamps
from lensforge.spec.receiver_fields import ReceiverSection

_WORTH_SHARING = 2**16  # rays: half a millisecond of work


class LandedAgain(NamedTuple):
    """Light that lands on a receiver by way of that itself: ``rows`` of the rays, ``hits``, and ``flux`` (W)."""

    rows: Int[np.ndarray, " k"]
    hits: Float[np.ndarray, "k 2"]
    flux: Float[np.ndarray, " k"]


class ByWalls(NamedTuple):
    """Numbers of the exit rays that land by way of a wall, these rays at it, and behind it; NumPy arrays."""

    rows: Int[np.ndarray, " k"]
    at: AtWalls
    rays: ExitRays


@dataclass(frozen=True)
class Landings:
    """Exit rays on a receiver, in their order.

    ``hits``: coordinates on the receiver's chart; ``flux``: W; both 0 where a ray did not land. ``landed``: rays that
    reach the surface in which the receiver lies. ``missed_receiver``: rays that left the lens and never do.
    ``shadow``: of the bodies before it, in NumPy; None without any. A ray that they reflect lands from there.
    ``paths_mm``: lengths of the ways there, in NumPy, where the receiver's kernel tells them. ``legs``: of the rays
    from body to body; empty where none goes on from any. ``again``: what lands once more; None for none.
    ``by_walls``: light of a search that lands by way of a wall; None if there is none.
    """

    hits: Float[Array, "n 2"]
    flux: Float[Array, " n"]
    landed: Bool[Array, " n"]
    missed_receiver: Bool[Array, " n"]
    shadow: Shadow | None = None
    paths_mm: Float[np.ndarray, " n"] | None = None
    legs: tuple[SceneLeg, ...] = ()
    again: LandedAgain | None = None
    by_walls: ByWalls | None = None

    @property
    def arrived(self) -> Bool[Array, " n"]:
        """Rays that arrived with flux."""
        return self.flux > 0.0

    def take(self, rows: Int[Array, " k"] | slice) -> "Landings":
        """Landings of some of the rays, without their ``legs`` and ``by_walls``."""
        hits, flux, landed, missed = (
            column[rows] for column in (self.hits, self.flux, self.landed, self.missed_receiver)
        )
        return Landings(hits, flux, landed, missed, None if self.shadow is None else self.shadow.take(rows))


Kernel = Callable[..., Any]


@dataclass(frozen=True)
class PosedReceiver(ABC):
    """A receiver whose chart is given by a pose and, for curved ones, a radius (mm).

    Subclasses say in arrays where rays land, and may name a pair of kernels that do the same, many times as quickly.
    ``lamps``: those whose light it sees. Rays land from one at the origin; its pictures hold the mean flux of a lamp on
    each pixel. ``housing``: bodies before it; None without any.
    """

    pose: Pose
    grid: PixelGrid
    window: Window = field(default_factory=Window)
    lamps: Lamps = ALONE
    housing: Housing | None = None

    kernels: ClassVar[tuple[Kernel, Kernel] | None] = None  # hits and whether they are reached; the adjoint
    radius_mm: ClassVar[float] = inf
    is_far: ClassVar[bool] = False  # its places are directions
    is_flat: ClassVar[bool] = False
    has_quarter_turn: ClassVar[bool] = False  # of its surface about its z axis

    @property
    def pixel_measure(self) -> float:
        """Area of a pixel in m^2, so that flux (W) over it is irradiance (W/m^2); of lamps that for the flux of one."""
        width, height = self.grid.pixel
        return width * height * 1e-6 / len(self.lamps)

    def averaged_over_mm2(self, rays: ExitRays) -> float:
        """Area (mm²) over which a limit averages its pictures of ``rays``; 1 where it counts light by place."""
        return 1.0

    def land(self, rays: ExitRays) -> Landings:
        """Land ``rays``, NumPy arrays, by a compiled kernel where there is one."""
        return self._in_shadow(rays, self._land(rays))

    def land_by_arrays(self, rays: ExitRays) -> Landings:
        """:meth:`land` in NumPy or in torch, on any device and in any precision; there differentiable."""
        return self._in_shadow(rays, self._land_by_arrays(rays))

    def adjoint(
        self,
        rays: ExitRays,
        by_hits: Float[np.ndarray, "n 2"],
        by_flux: Float[np.ndarray, " n"],
        landings: Landings | None = None,
    ) -> tuple[Sensitivities, Float[np.ndarray, " n"]]:
        """Sensitivities to exit rays and to their flux, from those to their hits and to the flux that lands.

        ``landings``: of the rays, where they are known.
        """
        if self.housing is None:
            return self._adjoint(rays, by_hits, by_flux)
        landings = landings or self.land(rays)
        shadow = landings.shadow
        assert shadow is not None, "behind bodies"
        walls = landings.by_walls
        straight = by_hits if walls is None else replaced(by_hits, walls.rows, np.zeros((len(walls.rows), 2)))
        by, of_flux = self._adjoint(rays, straight, by_flux * shadow.weights)
        rows = np.flatnonzero((shadow.weights > 0.0) & (shadow.weights < 1.0))  # what is dark has no slope
        by_weight = (by_flux[rows] * landings.flux[rows] / shadow.weights[rows])[:, None]
        by.by_points[rows] += by_weight * shadow.by_points[rows]
        by.by_directions[rows] += by_weight * shadow.by_directions[rows]
        if walls is not None:
            rows = walls.rows
            behind, by_behind = self._adjoint(walls.rays, by_hits[rows], by_flux[rows])
            before = walls.at.adjoint(rays.points[rows], rays.directions[rows], behind)
            by.by_points[rows] += before.by_points
            by.by_directions[rows] += before.by_directions
            of_flux[rows] += shadow.onward[rows] * by_behind
            by_onward = (by_flux[rows] * landings.flux[rows] / shadow.onward[rows])[:, None]
            by.by_points[rows] += by_onward * shadow.by_points[rows]
            by.by_directions[rows] += by_onward * shadow.by_directions[rows]
        return by, of_flux

    @property
    def before_black(self) -> Self:
        """The receiver before bodies that are all black."""
        return self if self.housing is None else replace(self, housing=self.housing.black)

    def seen_by_lamp(self, lamp: Pose) -> Self:
        """The receiver, and the bodies before it, as one lamp at a pose sees them."""
        housing = self.housing and self.housing.seen_from(lamp)
        return replace(self, pose=self.pose.seen_from(lamp), lamps=ALONE, housing=housing)

    def searched(self, rim_deg: float, lens_mm: float) -> Self:
        """The receiver of a search, in which clear bodies are air, and shadows fade out over an angle.

        ``lens_mm``: radius of the ball about each lamp from which light comes.
        """
        opaque = self.housing and self.housing.opaque
        lamps = [lamp.place_mm for lamp in self.lamps.lamps]
        return replace(self, housing=opaque and opaque.lit_from(lamps, lens_mm).faded(rim_deg))

    def _in_shadow(self, rays: ExitRays, landings: Landings) -> Landings:
        """``landings`` without ``rays`` that meet a body before; in a search these land, too, without flux."""
        if self.housing is None:
            return landings
        shadow = self._shadow(self.housing, rays, landings)
        free = like(landings.landed, ~shadow.met)
        landings = Landings(
            landings.hits,
            landings.flux * shadow.weights_by(rays.points, rays.directions),
            landings.landed if self.housing.rim > 0.0 else landings.landed & free,
            landings.missed_receiver & free,
            shadow,
        )
        if not self.housing.reflects:
            return landings
        follow = self._with_slopes_by_walls if self.housing.rim > 0.0 else self._with_reflected
        return follow(self.housing, rays, landings, shadow)

    def _with_reflected(self, housing: Housing, rays: ExitRays, landings: Landings, shadow: Shadow) -> Landings:
        """``landings`` with those of ``rays`` that bodies reflect, NumPy arrays."""
        legs = legs_of(housing, rays, shadow, lambda leg: self._shadow(housing, leg, self._land(leg)))
        rows = legs[1].rows
        last = last_of(legs)
        behind = self._land(last.rays.take(rows))
        free = last.shadow.lost[rows] < 1.0
        return Landings(
            replaced(landings.hits, rows, behind.hits),
            replaced(landings.flux, rows, behind.flux * free),
            replaced(landings.landed, rows, behind.landed & free),
            replaced(landings.missed_receiver, rows, behind.missed_receiver & free),
            last.shadow,
            legs=legs,
        )

    def _with_slopes_by_walls(self, housing: Housing, rays: ExitRays, landings: Landings, shadow: Shadow) -> Landings:
        """``landings`` of a search with those of ``rays`` that land by way of one wall; in torch differentiable.

        Others that meet a body keep their places behind it, without flux.
        """
        points, directions, flux, fates = map(as_numpy, (rays.points, rays.directions, rays.flux, rays.fates))
        coming = ExitRays(points, directions, flux, flux, fates, draws=rays.draws)
        reflected = housing.reflected(coming, shadow)
        rows = reflected.rows
        at = housing.at_walls(shadow, reflected)
        if isinstance(rays.points, np.ndarray):
            going = reflected.rays
            behind = self._land(going)
        else:
            lines = at.lines(rays.points[rows], rays.directions[rows])
            flux = shadow.onward_by(rays.points, rays.directions) * rays.flux
            going = ExitRays(*lines, flux[rows], rays.sin2_exit[rows], rays.fates[rows])
            behind = self._land_by_arrays(going)
        again = housing.blocks(*self._ways(going, behind))
        missed = as_numpy(behind.missed_receiver) & ~again
        lands = np.flatnonzero(as_numpy(behind.landed) & ~again)
        behind = behind.take(lands)
        onto = rows[lands]
        nowhere = landings.missed_receiver
        return Landings(
            replaced(landings.hits, onto, behind.hits),
            replaced(landings.flux, onto, behind.flux),
            replaced(landings.landed, onto, behind.landed),
            replaced(nowhere, rows, like(nowhere, missed)),
            shadow._replace(again=replaced(shadow.again, rows, again)),
            by_walls=ByWalls(onto, at.take(lands), reflected.rays.take(lands)),
        )

    def _shadow(self, housing: Housing, rays: ExitRays, landings: Landings) -> Shadow:
        """Shadow of the ``housing`` on ``rays``, in NumPy; those that were lost in the lens have none."""
        return housing.shadow(*self._ways(rays, landings))

    def _ways(
        self, rays: ExitRays, landings: Landings
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
        """Points, directions and reach (mm) of ``rays``, in NumPy; the reach of those lost in the lens is -inf."""
        points, directions, left = (as_numpy(column) for column in (rays.points, rays.directions, rays.left_lens))
        return points, directions, np.where(left, self._reach_mm(points, directions, landings), -inf)

    def _reach_mm(
        self, points: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"], landings: Landings
    ) -> Float[np.ndarray, " n"]:
        """Path (mm) of each ray to the surface; infinite where it never gets there."""
        if landings.paths_mm is not None:
            return np.where(as_numpy(landings.landed), landings.paths_mm, inf)
        reach_mm = np.full(len(points), inf)
        if not self.is_far:
            landed = as_numpy(landings.landed)
            places = self.places(*as_numpy(landings.hits)[landed].T)
            reach_mm[landed] = ((places - points[landed]) * directions[landed]).sum(axis=1)
        return reach_mm

    def _land(self, rays: ExitRays) -> Landings:
        """:meth:`land` without bodies before it."""
        if self.kernels is None:
            return self._land_by_arrays(rays)
        landing = self.kernels[0]
        points = rays.points
        directions = rays.directions
        left = rays.left_lens
        hits = np.empty((len(left), 2))
        paths_mm = np.empty(len(left))
        reached = np.empty(len(left), dtype=bool)
        frame = self.pose.frame

        def work(part: slice) -> None:
            ends = hits[part], paths_mm[part], reached[part]
            landing(points[part], directions[part], frame, self.radius_mm, *ends)
            reached[part] &= left[part]  # rays that were lost have no direction
            hits[part][~reached[part]] = 0.0

        in_pieces(work, len(left), worth=_WORTH_SHARING)
        return Landings(hits, np.where(reached, rays.flux, 0.0), reached, left & ~reached, paths_mm=paths_mm)

    def sensitivities(self, rays: ExitRays, by_hits: Float[np.ndarray, "n 2"]) -> Sensitivities:
        """Sensitivities to exit rays from those to their hits, which are 0 for rays that missed the receiver."""
        if self.kernels is None:
            return self._sensitivities_by_arrays(rays, by_hits)
        adjoint = self.kernels[1]
        points = rays.points
        directions = rays.directions
        frame = self.pose.frame
        by = Sensitivities(np.empty_like(points), np.empty_like(points))

        def work(part: slice) -> None:
            rest = (by_hits[part], by.by_points[part], by.by_directions[part])
            adjoint(points[part], directions[part], frame, self.radius_mm, *rest)

        in_pieces(work, len(points), worth=_WORTH_SHARING)
        return by

    def _adjoint(
        self, rays: ExitRays, by_hits: Float[np.ndarray, "n 2"], by_flux: Float[np.ndarray, " n"]
    ) -> tuple[Sensitivities, Float[np.ndarray, " n"]]:
        """:meth:`adjoint` without bodies before it."""
        return self.sensitivities(rays, by_hits), by_flux

    def _land_by_arrays(self, rays: ExitRays) -> Landings:
        """:meth:`land_by_arrays` without bodies before it."""
        points = self.pose.to_local_points(rays.points)
        directions = self.pose.to_local_directions(rays.directions)
        landed = rays.left_lens & self._reached(points, directions)
        rows = rows_of(landed)
        none = module_of(points).zeros_like(points[:, :2])
        hits = replaced(none, rows, self._chart(points[rows], directions[rows]))
        return Landings(hits, rays.flux * landed, landed, rays.left_lens & ~landed)

    def _sensitivities_by_arrays(self, rays: ExitRays, by_hits: Float[np.ndarray, "n 2"]) -> Sensitivities:
        """:meth:`sensitivities` by torch, through :meth:`land_by_arrays`."""
        import torch

        points, directions = (torch.tensor(vectors, requires_grad=True) for vectors in (rays.points, rays.directions))
        flux = torch.tensor(rays.flux)
        fates = torch.tensor(rays.fates)
        with torch.enable_grad():  # a search asks for them from within its own step backwards
            hits = self._land_by_arrays(ExitRays(points, directions, flux, flux, fates)).hits
        by = torch.autograd.grad(hits, (points, directions), torch.tensor(by_hits), materialize_grads=True)
        return Sensitivities(*(gradient.numpy() for gradient in by))

    @abstractmethod
    def _reached(self, points: Float[Array, "n 3"], directions: Float[Array, "n 3"]) -> Bool[Array, " n"]:
        """True for rays, in the pose, that reach the surface."""

    @abstractmethod
    def _chart(self, points: Float[Array, "n 3"], directions: Float[Array, "n 3"]) -> Float[Array, "n 2"]:
        """Hits of rays, in the pose, all of which reach the surface."""

    def places(self, x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 3"]:
        """Points (mm) of the lens's space at places on the chart; of a far field unit directions."""
        return self.pose.points(self._local(x, y))

    @abstractmethod
    def _local(self, x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 3"]:
        """Points (mm) of chart coordinates, before the receiver is put into its place."""

    def corners(self) -> Float[np.ndarray, "k l 3"]:
        """Points (mm) of the corners of all pixels [row, column]; of a far field unit directions."""
        grid = self.grid
        x = grid.width * (np.arange(grid.columns + 1) / grid.columns - 0.5)
        y = grid.height * (np.arange(grid.rows + 1) / grid.rows - 0.5)
        return self.places(*np.meshgrid(x, y))

    def target_coordinates(
        self, x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]
    ) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n"]]:
        """Places on the chart as targets state them: mm, the chart's own."""
        return x, y

    def chart_coordinates(
        self, x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]
    ) -> tuple[Float[np.ndarray, "*n"], Float[np.ndarray, "*n"]]:
        """Places as targets state them on the chart: the same."""
        return x, y


@singledispatch
def posed_receiver(section: ReceiverSection, pose: Pose, grid: PixelGrid) -> PosedReceiver:
    """The receiver of a ``section`` in its pose; its window is all of it unless the section names one.

    A kind of receiver registers its function here.
    """
    raise NotImplementedError(f"no receiver of kind {section.kind}: register a function with posed_receiver")


def from_equal_area(x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 3"]:
    """Unit vectors at places on the equal-area chart; beyond its rim, at a radius of 2, the direction -z."""
    square = np.minimum(x * x + y * y, 4.0)
    shrunk = np.sqrt(np.maximum(1.0 - 0.25 * square, 0.0))
    return np.stack([shrunk * x, shrunk * y, 1.0 - 0.5 * square], axis=-1)


def equal_area(units: Float[Array, "n 3"]) -> Float[Array, "n 2"]:
    """Lambert's azimuthal equal-area chart of unit vectors: circles about z of radius 2 sin(angle / 2)."""
    return module_of(units).sqrt(2.0 / (1.0 + units[:, 2:])) * units[:, :2]
