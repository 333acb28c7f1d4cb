"""Faces that find where rays meet them, in torch, on any device: what the reference tracer asks of a face.

A face is ``|p| = rho(p/|p|)`` about its origin, and ``F = rho - |p|`` (mm), Eq. (5), is positive inside. An exact face
is met by a dense scan and Newton steps. A table has the coefficients and bounds of the kernels, and its search takes
the safe steps, bounds and limits of ``kernels.first_hit`` for all rays at once: see there for why no root is stepped
over. ``gap``, ``normal`` and ``hit`` are differentiable in points and shape; a search has no gradient.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Int8
from torch import Tensor

from lensforge.kernels.bicubic import SurfaceBounds, surface_bounds, uniform_cubic
from lensforge.kernels.first_hit import (
    BELOW,
    FOUND,
    LAST_BIT,
    LOST,
    MAX_CLOSING,
    MAX_STEPS,
    MISSED,
    NEAR,
    ROUNDING,
    STANDSTILL,
    TOLERANCE,
)
from lensforge.surfaces.bicubic_table import TableGrid
from lensforge.surfaces.srbf import fibonacci_hemisphere
from lensforge.surfaces.surface import Surface

CPU = torch.device("cpu")
_SIZE_DIRECTIONS = 1000  # over the hemisphere, at which the reach of a surface is sampled
_STEPS_AT_ONCE = 32  # of a scan
_BACKED_OFF = 1e-9  # of the way: a scan starts so far from the face that a ray has just met
_LEAST_ACROSS = 1e-12  # of a direction: along y no ray meets a face that is drawn so
_GOING = 3  # states of a search besides the kernel's
_BRACKETED = 5  # of the second the next root is the only one ahead

OfDirections = Callable[[Float[Tensor, "n 3"]], Float[Tensor, "n *k"]]


class Approach(NamedTuple):
    """Rays on their way to a face, from z >= 0.

    ``sense``: the sign by which F is positive, 1 for rays inside the face, -1 outside. ``on_face``: rays that start on
    it, which is no crossing. No crossing counts beyond ``limits_mm`` along each ray.
    """

    points: Float[Tensor, "n 3"]
    directions: Float[Tensor, "n 3"]
    sense: Float[Tensor, " n"]
    on_face: Bool[Tensor, " n"]
    limits_mm: Float[Tensor, " n"]

    def take(self, rows: Tensor) -> "Approach":
        """Select rays by row."""
        return Approach(*(values[rows] for values in self))

    def at(self, paths_mm: Float[Tensor, " n"]) -> Float[Tensor, "n 3"]:
        """Points of the rays."""
        return self.points + paths_mm[:, None] * self.directions

    @property
    def to_plane_mm(self) -> Float[Tensor, " n"]:
        """Path (mm) down to the plane z = 0, below which no face counts; infinite upwards."""
        fall = -self.directions[:, 2]
        return torch.where(fall > 0.0, self.points[:, 2] / torch.where(fall > 0.0, fall, 1.0), torch.inf)


class Crossing(NamedTuple):
    """Next crossings: path (mm), whether one was found, whether the search gave up; other rays pass the face."""

    paths_mm: Float[Tensor, " n"]
    found: Bool[Tensor, " n"]
    lost: Bool[Tensor, " n"]


class TracedFace(ABC):
    """A face as rays meet it."""

    @abstractmethod
    def gap(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        """F (mm): positive inside, the origin included."""

    @abstractmethod
    def normal(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
        """Gradient of ``|p| - rho(p/|p|)``: away from the origin, not normalised."""

    @abstractmethod
    def next_crossing(self, rays: Approach) -> Crossing:
        """First crossings of rays, coming from their side of the face."""

    def hit(
        self,
        points: Float[Tensor, "n 3"],
        directions: Float[Tensor, "n 3"],
        paths_mm: Float[Tensor, " n"],
        sense: Float[Tensor, " n"] | float,
    ) -> tuple[Float[Tensor, " n"], Float[Tensor, "n 3"]]:
        """Path (mm) to the face and the hit, with the derivative of the implicit function, Eq. (9).

        That is one undamped Newton step from ``paths_mm``. A tangent has no step and no derivative.
        """
        near = points + paths_mm[:, None] * directions
        with torch.no_grad():
            slope = -(self.normal(near) * directions).sum(dim=1)
            slope = torch.where(sense * slope < 0.0, slope, -torch.inf)
        exact = paths_mm - self.gap(near) / slope
        return exact, points + exact[:, None] * directions


@dataclass(frozen=True)
class ExactFace(TracedFace):
    """A face by its own ``radius`` (mm) and tangential ``gradient`` (mm/rad) in unit directions.

    No ray from inside is still within after ``reach_mm``. A scan of ``steps`` over the way of a ray brackets its
    crossing, ``bisections`` refine it, and Newton steps end it: slow by design, the radius is evaluated 300 times for
    each ray. ``guide``: a table near the face, by which crossings are found in place of the scan.
    """

    radius: OfDirections
    gradient: OfDirections
    reach_mm: float
    guide: TracedFace | None = None
    steps: int = 256
    bisections: int = 30
    newton_steps: int = 1

    @staticmethod
    def of(surface: Surface, guide: TracedFace | None = None) -> "ExactFace":
        """The face of a surface, which is constant."""
        largest = float(surface.radius(fibonacci_hemisphere(_SIZE_DIRECTIONS)).max())
        return ExactFace(_in_torch(surface.radius), _in_torch(surface.gradient), 2.2 * largest, guide)

    def gap(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        """F (mm); positive at the origin, which has no direction."""
        directions, distance = _polar(points)
        return self.radius(directions) - distance

    def normal(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
        """Gradient of ``|p| - rho(p/|p|)``: away from the origin, not normalised."""
        directions, distance = _polar(points)
        return directions - self.gradient(directions) / distance[:, None]

    @torch.no_grad()
    def next_crossing(self, rays: Approach) -> Crossing:
        """First crossings, by the scan or the guide, moved onto the face."""
        paths, found, lost = self._scanned(rays) if self.guide is None else self.guide.next_crossing(rays)
        met = rays.take(found)
        ends = paths[found]
        for _ in range(self.newton_steps):
            ends, _ = self.hit(met.points, met.directions, ends, met.sense)
        return Crossing(paths.index_put((found,), ends), found, lost)

    def _scanned(self, rays: Approach) -> Crossing:
        """First sign change of F; a ray that starts beyond the face is lost."""
        ends = torch.minimum(rays.limits_mm, rays.to_plane_mm).clamp(max=self.reach_mm)
        low = torch.where(rays.on_face, _BACKED_OFF * ends, 0.0)
        high = ends.clone()
        begun = rays.on_face | self._before(rays, 0.0 * ends)
        crosses = torch.zeros_like(begun)
        going = torch.nonzero(begun)[:, 0]
        shares = torch.arange(1, self.steps + 1, device=ends.device) / self.steps
        for block in shares.to(ends).split(_STEPS_AT_ONCE):
            edges = torch.cat([low[going, None], ends[going, None] * block], dim=1)
            some = rays.take(going.repeat_interleave(len(block)))
            before = self._before(some, edges[:, 1:].reshape(-1)).reshape(-1, len(block))
            count = before.cumprod(dim=1).sum(dim=1, keepdim=True)  # steps before the first change
            low[going] = edges.gather(1, count)[:, 0]
            high[going] = edges.gather(1, (count + 1).clamp(max=len(block)))[:, 0]
            crosses[going] = count[:, 0] < len(block)
            going = going[~crosses[going]]
        some = rays.take(crosses)
        first = low[crosses]
        last = high[crosses]
        for _ in range(self.bisections):
            middle = 0.5 * (first + last)
            before = self._before(some, middle)
            first = torch.where(before, middle, first)
            last = torch.where(before, last, middle)
        return Crossing(torch.zeros_like(low).index_put((crosses,), 0.5 * (first + last)), crosses, ~begun)

    def _before(self, rays: Approach, paths_mm: Float[Tensor, " n"]) -> Bool[Tensor, " n"]:
        """True for rays still on their side of the face."""
        return rays.sense * self.gap(rays.at(paths_mm)) >= 0.0


def _in_torch(function: Callable[[Float[np.ndarray, "n 3"]], Float[np.ndarray, "n *k"]]) -> OfDirections:
    return lambda directions: directions.new_tensor(function(directions.detach().cpu().numpy()))


def _polar(points: Float[Tensor, "n 3"]) -> tuple[Float[Tensor, "n 3"], Float[Tensor, " n"]]:
    """Unit directions of points, and their distances (mm); the origin's direction is the axis."""
    distance = torch.linalg.norm(points, dim=1)
    known = (distance > 0.0)[:, None]
    axis = points.new_tensor([0.0, 0.0, 1.0])
    return torch.where(known, points / torch.where(known, distance[:, None], 1.0), axis), distance


@dataclass(frozen=True)
class TableFace(TracedFace):
    """A bicubic table of ``rho``: ``coefficients`` (mm), and the bounds for the search.

    ``tiles`` are those of ``bounds``, on the device.
    """

    coefficients: Float[Tensor, "side side"]
    grid: TableGrid
    bounds: SurfaceBounds
    tiles: Float[Tensor, "t t 3"]

    @staticmethod
    def of(
        table: Float[Tensor, "side side"],
        grid: TableGrid,
        bounds: SurfaceBounds | None = None,
        device: torch.device = CPU,
    ) -> "TableFace":
        """Copy of ``table`` on ``device``, through which gradients pass; ``bounds`` by default are computed."""
        if bounds is None:
            bounds = surface_bounds(table.detach().numpy(), grid.origin, grid.step)
        return TableFace(table.to(device, torch.float64), grid, bounds, torch.from_numpy(bounds.tiles).to(device))

    def gap(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        """F (mm): positive inside, the origin included."""
        return self._gap_and_normal(points)[0]

    def normal(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
        """Gradient of ``|p| - rho(p/|p|)``: away from the origin, not normalised."""
        return self._gap_and_normal(points)[1]

    def _gap_and_normal(self, points: Float[Tensor, "n 3"]) -> tuple[Float[Tensor, " n"], Float[Tensor, "n 3"]]:
        x, y, z = points.unbind(dim=1)
        r = torch.linalg.norm(points, dim=1)
        per_shift = _per_shift(points)
        rho, rho_x, rho_y = self._value_and_slopes(x * per_shift, y * per_shift)
        radial = (rho_x * x + rho_y * y) * per_shift * per_shift
        along = (1.0 + radial) / r
        normal = torch.stack((x * along - rho_x * per_shift, y * along - rho_y * per_shift, z * along + radial), dim=1)
        return rho - r, normal

    def _value_and_slopes(
        self, X: Float[Tensor, " n"], Y: Float[Tensor, " n"]
    ) -> tuple[Float[Tensor, " n"], Float[Tensor, " n"], Float[Tensor, " n"]]:
        """``rho``, d rho/dX, d rho/dY at points of the chart; differentiable in them and in the coefficients."""
        per_step = 1.0 / self.grid.step
        u, v = ((at - self.grid.origin) * per_step for at in (X, Y))
        # the second of the four coefficients that act, kept inside the table
        i, j = (at.detach().to(torch.int64).clamp(1, self.grid.side - 3) for at in (u, v))
        four = torch.arange(-1, 3, device=i.device)
        rows = (i + four[:, None])[:, None]
        columns = (j + four[:, None])[None, :]
        # by one index: its backward pass adds in a fixed order, on a GPU too
        block = self.coefficients.reshape(-1)[rows * self.grid.side + columns]
        (wx, dx), (wy, dy) = (map(torch.stack, uniform_cubic(f)[:2]) for f in (u - i, v - j))
        along = (block * wy).sum(dim=1)
        across = (block * dy).sum(dim=1)
        return (wx * along).sum(dim=0), (dx * along).sum(dim=0) * per_step, (wx * across).sum(dim=0) * per_step

    @torch.no_grad()
    def next_crossing(self, rays: Approach) -> Crossing:
        """First crossings, proven."""
        paths = torch.zeros_like(rays.sense)
        states = torch.full_like(paths, _GOING, dtype=torch.int8)
        going = torch.arange(len(paths), device=paths.device)
        for _ in range(MAX_STEPS):
            if len(going) == 0:
                break
            paths[going], states[going] = self._stride(rays.take(going), paths[going])
            going = going[states[going] == _GOING]
        states[going] = LOST
        last = torch.nonzero(states == _BRACKETED)[:, 0]
        paths[last], states[last] = self._closed_in(rays.take(last), paths[last])
        return Crossing(paths, states == FOUND, states == LOST)

    def _stride(self, rays: Approach, t: Float[Tensor, " n"]) -> tuple[Float[Tensor, " n"], Int8[Tensor, " n"]]:
        """One safe step of each ray: its path and its state.

        F > 0 in the ball of the least radius: to its far side. From outside of the ball in which the whole face lies:
        to that ball. Elsewhere to a root, before the only one, or a step of the parabola.
        """
        points = rays.at(t)
        r = torch.linalg.norm(points, dim=1)
        outward = (points * rays.directions).sum(dim=1)
        inside = rays.sense > 0.0
        in_ball = inside & (r < self.bounds.least)
        far = ~inside & (r > self.bounds.most * (1.0 + NEAR))
        leaps = in_ball | far
        gap, slope = self._along(rays, t)
        only, move = self._safe_move(points, outward / r, outward, gap, slope)
        only &= ~leaps
        move = torch.where(leaps, self._leap(r, outward, inside), move)
        at_root = ~leaps & (ROUNDING * r >= gap) & ~((t == 0.0) & (slope > 0.0) & rays.on_face)
        stands = ~leaps & (move <= STANDSTILL * r)
        state = torch.where(only, _BRACKETED, torch.where(stands, FOUND, _GOING))
        gone = ~inside & (r >= self.bounds.most) & (outward >= 0.0)
        state = torch.where(gone | (t + move >= rays.limits_mm), MISSED, state)
        state = torch.where(at_root, torch.where((-NEAR * r < gap) & (t > 0.0), FOUND, LOST), state)
        below = (points[:, 2] < 0.0) & (rays.directions[:, 2] <= 0.0)
        stays = below | at_root | only
        return torch.where(stays, t, t + move), torch.where(below, BELOW, state).to(torch.int8)

    def _along(self, rays: Approach, t: Float[Tensor, " n"]) -> tuple[Float[Tensor, " n"], Float[Tensor, " n"]]:
        """F and F' along the rays, signed to be positive on the rays' side."""
        gap, normal = self._gap_and_normal(rays.at(t))
        return rays.sense * gap, -rays.sense * (normal * rays.directions).sum(dim=1)

    def _leap(
        self, r: Float[Tensor, " n"], outward: Float[Tensor, " n"], inside: Bool[Tensor, " n"]
    ) -> Float[Tensor, " n"]:
        """Path (mm) out of the ball of least radius, or to that of largest radius; infinite for a miss."""
        least = self.bounds.least
        most = self.bounds.most
        ball = torch.where(inside, torch.full_like(r, least), most)
        square = outward**2 - (r - ball) * (r + ball)
        root = torch.sqrt(square.clamp(min=0.0))
        comes = torch.where((outward < 0.0) & (square > 0.0), -outward - root, torch.inf)
        return torch.where(inside, (root - outward) * (1.0 + LAST_BIT) + LAST_BIT * least, comes)

    def _safe_move(
        self,
        points: Float[Tensor, "n 3"],
        cosine: Float[Tensor, " n"],
        outward: Float[Tensor, " n"],
        gap: Float[Tensor, " n"],
        slope: Float[Tensor, " n"],
    ) -> tuple[Bool[Tensor, " n"], Float[Tensor, " n"]]:
        """Flags of rays whose next root is the only one ahead, and paths (mm) with no root on them.

        ``cosine``: between ray and radius. A bound ``bend`` of ``|F''|``, as in ``first_hit.bound_ahead``, holds within
        the reach of the bounds nearby. After a path s the ray has turned by ``atan(s sine / (r + s cosine))``: it is
        within while ``s turning <= room``.
        """
        r = torch.linalg.norm(points, dim=1)
        per_shift = _per_shift(points)
        least = self.bounds.least
        i, j = (
            ((at * per_shift - self.grid.origin) * self.bounds.per_unit).to(torch.int64).clamp(0, len(self.tiles) - 1)
            for at in points[:, :2].unbind(dim=1)
        )
        _, most_slope, most_hessian = self.tiles[i, j].unbind(dim=1)
        sine = torch.sqrt((1.0 - cosine * cosine).clamp(min=0.0))
        turning = sine - self.bounds.tan_reach * cosine
        room = r * self.bounds.tan_reach
        twist = torch.where(sine < cosine, 2.0 * sine * cosine, 1.0)
        bend_out = (sine * sine * (1.0 + most_hessian / r) + most_slope * twist / r) / r
        nearest = (r * sine).clamp(min=least)
        bend_in = (1.0 + (most_hessian + most_slope) / nearest) / nearest
        to_ball = -outward - torch.sqrt((outward**2 - (r - least) * (r + least)).clamp(min=0.0)) + NEAR * r
        rises = cosine >= 0.0
        bend = torch.where(rises, bend_out, bend_in)
        path = torch.where(rises | (r * sine >= least), torch.inf, to_ball)
        farthest = -2.0 * gap / slope
        only = (slope < 0.0) & (2.0 * bend * gap <= slope * slope)
        only &= (farthest * turning <= room) & (farthest <= path)
        root = torch.sqrt((slope * slope + 2.0 * bend * gap).clamp(min=0.0))
        move = torch.minimum(torch.where(slope < 0.0, 2.0 * gap / (root - slope), (slope + root) / bend), path)
        return only, torch.where(move * turning <= room, move, room / turning)

    def _closed_in(self, rays: Approach, t: Float[Tensor, " n"]) -> tuple[Float[Tensor, " n"], Int8[Tensor, " n"]]:
        """The only root ahead of ``t``, by Newton, and the states.

        It converges: ``2 C F <= F'^2`` with a bound C of ``|F''|`` is the condition of Kantorovich. The search ends at
        the plane z = 0.
        """
        roots = t.clone()
        states = torch.full_like(t, LOST, dtype=torch.int8)
        going = torch.arange(len(t), device=t.device)
        for _ in range(MAX_CLOSING):
            if len(going) == 0:
                break
            some = rays.take(going)
            path = roots[going]
            gap, slope = self._along(some, path)
            r = torch.linalg.norm(some.at(path), dim=1)
            plane = some.to_plane_mm
            newton = -gap / slope
            converged = (newton.abs() <= TOLERANCE * r) | (gap.abs() <= ROUNDING * r)
            below = ~converged & (gap > 0.0) & (path >= plane)
            ahead = torch.minimum(path + newton, plane)
            roots[going] = torch.where(converged, path + newton, torch.where(below, path, ahead))
            states[going] = torch.where(converged, FOUND, torch.where(below, BELOW, LOST)).to(torch.int8)
            going = going[~(converged | below)]
        return roots, states


@dataclass(frozen=True)
class DrawnTracedFace(TracedFace):
    """A ``face`` that is a profile drawn along y: rays meet it where their shadows in the plane y = 0 do."""

    face: TracedFace

    def gap(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        """F (mm): positive inside."""
        return self.face.gap(_shadow(points))

    def normal(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
        """Gradient across y: away from the y axis, not normalised."""
        return _shadow(self.face.normal(_shadow(points)))

    @torch.no_grad()
    def next_crossing(self, rays: Approach) -> Crossing:
        """First crossings of the shadows, as paths of the rays."""
        across = _shadow(rays.directions)
        share = torch.linalg.norm(across, dim=1).clamp(min=_LEAST_ACROSS)
        shadows = rays._replace(
            points=_shadow(rays.points), directions=across / share[:, None], limits_mm=rays.limits_mm * share
        )
        crossing = self.face.next_crossing(shadows)
        return crossing._replace(paths_mm=crossing.paths_mm / share)


def _shadow(vectors: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
    return vectors * vectors.new_tensor([1.0, 0.0, 1.0])


def _per_shift(points: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
    """``1 / (r + z)``, which takes x and y to the chart."""
    shift: Tensor = (torch.linalg.norm(points, dim=1) + points[:, 2]).clamp(min=torch.finfo(points.dtype).tiny)
    return 1.0 / shift
