"""Bicubic tables of ``rho`` in plain torch, on any device, and first crossings of many rays at once with them.

Coefficients and bounds are those of the kernels, and the search takes the safe steps, bounds and limits of
``kernels.first_hit``, step by step for all rays without a result yet; see there for why no root is stepped over. Rays
lie along the last axis of every tensor inside, so that neighbouring rays are neighbours in memory. No gradient.
"""

from dataclasses import dataclass
from typing import NamedTuple

import torch
from jaxtyping import Float, Int, Int8
from torch import Tensor

from lensforge.kernels.bicubic import SurfaceBounds, uniform_cubic
from lensforge.kernels.first_hit import BELOW, FOUND, LEAP_SHARE, LOST, MAX_CLOSING, MAX_STEPS, ROUNDING, TOLERANCE
from lensforge.light.sequential_trace import Crossing
from lensforge.light.table_trace import Scene, checked_bounds
from lensforge.surfaces.bicubic_table import TableGrid


@dataclass(frozen=True)
class DeviceTable:
    """``coefficients`` (mm), and the bounds for the search; ``tiles`` are those of ``bounds``, on the device."""

    coefficients: Float[Tensor, "side side"]
    grid: TableGrid
    bounds: SurfaceBounds
    tiles: Float[Tensor, "3 t t"]

    @staticmethod
    def of(
        table: Float[Tensor, "side side"], grid: TableGrid, bounds: SurfaceBounds, device: torch.device
    ) -> "DeviceTable":
        """Copy of ``table`` on ``device``, through which gradients pass."""
        tiles = torch.from_numpy(bounds.tiles).permute(2, 0, 1).contiguous().to(device)
        return DeviceTable(table.to(device, torch.float64), grid, bounds, tiles)

    def value_and_slope(
        self, X: Float[Tensor, " n"], Y: Float[Tensor, " n"]
    ) -> tuple[Float[Tensor, " n"], Float[Tensor, " n"], Float[Tensor, " n"]]:
        """``rho``, d rho/dX, d rho/dY at points of the chart; differentiable in them and in the coefficients."""
        per_step = 1.0 / self.grid.step
        u, v = ((at - self.grid.origin) * per_step for at in (X, Y))
        i, j = self._cell(u), self._cell(v)
        four = torch.arange(-1, 3, device=i.device)
        rows, columns = (i + four[:, None])[:, None], (j + four[:, None])[None, :]
        # by one index: its backward pass adds in a fixed order, on a GPU too
        block = self.coefficients.reshape(-1)[rows * self.grid.side + columns]
        (wx, dx), (wy, dy) = (map(torch.stack, uniform_cubic(f)[:2]) for f in (u - i, v - j))
        along, across = (block * wy).sum(dim=1), (block * dy).sum(dim=1)
        return (wx * along).sum(dim=0), (dx * along).sum(dim=0) * per_step, (wx * across).sum(dim=0) * per_step

    def _cell(self, position: Float[Tensor, " n"]) -> Int[Tensor, " n"]:
        """The second of the four coefficients that act at ``position`` (in steps), kept inside the table."""
        return position.detach().to(torch.int64).clamp(1, self.grid.side - 3)

    def bounds_near(self, X: Float[Tensor, " n"], Y: Float[Tensor, " n"]) -> Float[Tensor, "3 n"]:
        """Least rho, largest gradient and Hessian near a direction; indices stay within the table even for NaN."""
        i, j = (
            ((at - self.grid.origin) * self.bounds.per_unit).to(torch.int64).clamp(0, self.tiles.shape[1] - 1)
            for at in (X, Y)
        )
        return self.tiles[:, i, j]

    def gap(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        """``F = rho - |p|`` (mm), Eq. (5): positive inside."""
        r = torch.linalg.norm(points, dim=1)
        shift = (r + points[:, 2]).clamp(min=torch.finfo(points.dtype).tiny)
        gap: Tensor = self.value_and_slope(points[:, 0] / shift, points[:, 1] / shift)[0] - r
        return gap

    def normal(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
        """Gradient of ``|p| - rho(p/|p|)``: away from the origin, not normalised."""
        x, y, z = points.unbind(dim=1)
        r = torch.linalg.norm(points, dim=1)
        per_shift = 1.0 / (r + z)
        _, rho_x, rho_y = self.value_and_slope(x * per_shift, y * per_shift)
        radial = (rho_x * x + rho_y * y) * per_shift * per_shift
        along = (1.0 + radial) / r
        return torch.stack((x * along - rho_x * per_shift, y * along - rho_y * per_shift, z * along + radial), dim=1)


def tables_on(
    device: torch.device, inner: Float[Tensor, "side side"], outer: Float[Tensor, "side side"], scene: Scene
) -> tuple[DeviceTable, DeviceTable]:
    """Both tables and their bounds on ``device``. Raises :class:`InputError` for a radius that is not positive."""
    bounds = checked_bounds((inner.detach().numpy(), outer.detach().numpy()), scene)
    first, second = (
        DeviceTable.of(table, scene.grid, bound, device) for table, bound in zip((inner, outer), bounds, strict=True)
    )
    return first, second


# States of a search besides the kernel's three.
_GOING = 3
_BRACKETED = 4  # the next root is the only one ahead, and bracketed


class _Place(NamedTuple):
    """Position of rays: chart, 1/(r + z), distance r, cosine between ray and radius (and times r), direction."""

    X: Float[Tensor, " n"]
    Y: Float[Tensor, " n"]
    per_shift: Float[Tensor, " n"]
    r: Float[Tensor, " n"]
    cos_radial: Float[Tensor, " n"]
    outward: Float[Tensor, " n"]
    dx: Float[Tensor, " n"]
    dy: Float[Tensor, " n"]
    dz: Float[Tensor, " n"]

    @staticmethod
    def of(points: Float[Tensor, "3 n"], directions: Float[Tensor, "3 n"]) -> "_Place":
        r, outward = torch.sqrt((points * points).sum(dim=0)), (points * directions).sum(dim=0)
        per_shift = 1.0 / (r + points[2])
        return _Place(points[0] * per_shift, points[1] * per_shift, per_shift, r, outward / r, outward, *directions)

    def gap_and_slope(self, table: DeviceTable) -> tuple[Float[Tensor, " n"], Float[Tensor, " n"]]:
        """F and F'."""
        rho, rho_x, rho_y = table.value_and_slope(self.X, self.Y)
        ahead = self.cos_radial + self.dz
        turn = rho_x * (self.dx - self.X * ahead) + rho_y * (self.dy - self.Y * ahead)
        return rho - self.r, turn * self.per_shift - self.cos_radial


class _Ahead(NamedTuple):
    """Bounds on the surface near a ray, see ``SurfaceBounds``, and their reach.

    After a path s the ray has turned by ``atan(s sine / (r + s cos_radial))``: ``s turning <= room`` stays in reach.
    """

    low: Float[Tensor, " n"]
    max_slope: Float[Tensor, " n"]
    max_hessian: Float[Tensor, " n"]
    sine: Float[Tensor, " n"]
    turning: Float[Tensor, " n"]
    room: Float[Tensor, " n"]

    @staticmethod
    def of(table: DeviceTable, place: _Place) -> "_Ahead":
        low, max_slope, max_hessian = table.bounds_near(place.X, place.Y).unbind()
        sine = torch.sqrt((1.0 - place.cos_radial * place.cos_radial).clamp(min=0.0))
        reach = table.bounds.tan_reach
        return _Ahead(low, max_slope, max_hessian, sine, sine - reach * place.cos_radial, place.r * reach)

    def within(self, path: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
        """``path``, or as far of it as the bounds reach."""
        return torch.where(path * self.turning <= self.room, path, self.room / self.turning)

    def bend(self, place: _Place, least: float) -> tuple[Float[Tensor, " n"], Float[Tensor, " n"]]:
        """Bound C of ``|F''|`` and the path up to which it holds within the reach: as ``first_hit.bound_ahead``."""
        per_r = 1.0 / place.r
        twist = torch.where(self.sine < place.cos_radial, 2.0 * self.sine * place.cos_radial, 1.0)
        outwards = (self.sine * self.sine * (1.0 + self.max_hessian * per_r) + self.max_slope * twist * per_r) * per_r
        nearest = place.r * self.sine
        to_ball = torch.sqrt((place.outward**2 - (place.r - least) * (place.r + least)).clamp(min=0.0))
        path = torch.where(nearest < least, -place.outward - to_ball + 1e-12 * place.r, torch.inf)
        nearest = nearest.clamp(min=least)
        inwards = (1.0 + (self.max_hessian + self.max_slope) / nearest) / nearest
        rises = place.cos_radial >= 0.0
        return torch.where(rises, outwards, inwards), torch.where(rises, torch.inf, path)


def first_crossing(table: DeviceTable, origins: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"]) -> Crossing:
    """First crossings of rays from points with ``|p| <= rho`` and z >= 0."""
    with torch.no_grad():
        starts, along = origins.T.contiguous(), directions.T.contiguous()
        lengths = torch.zeros_like(starts[0])
        states = torch.full_like(lengths, _GOING, dtype=torch.int8)
        going = torch.arange(len(lengths), device=lengths.device)
        for _ in range(MAX_STEPS):
            if len(going) == 0:
                break
            lengths[going], states[going] = _stride(table, starts[:, going], along[:, going], lengths[going])
            going = going[states[going] == _GOING]
        states[going] = LOST
        last = torch.nonzero(states == _BRACKETED)[:, 0]
        lengths[last], states[last] = _close_in(table, starts[:, last], along[:, last], lengths[last])
        return Crossing(lengths, states == FOUND, states == LOST)


def _stride(
    table: DeviceTable, starts: Float[Tensor, "3 n"], along: Float[Tensor, "3 n"], t: Float[Tensor, " n"]
) -> tuple[Float[Tensor, " n"], Int8[Tensor, " n"]]:
    """One safe step of each ray: its path and its state."""
    points, least = starts + t * along, table.bounds.least
    place = _Place.of(points, along)
    ahead = _Ahead.of(table, place)
    below = (points[2] < 0.0) & (along[2] <= 0.0)
    in_ball = place.r < least  # F > 0 in the whole ball: go to its far side, whatever the reach
    deep = place.r < LEAP_SHARE * ahead.low
    radius = torch.where(in_ball, least, ahead.low)
    leap = torch.sqrt(place.outward**2 + (radius - place.r) * (radius + place.r)) - place.outward
    leap = torch.where(in_ball, leap * (1.0 + 1e-15) + 1e-15 * least, ahead.within(leap))
    path, state = torch.where(below, t, t + leap), torch.where(below, BELOW, _GOING).to(torch.int8)
    look = torch.nonzero(~(below | in_ball | deep))[:, 0]
    there, near = _Place(*(each[look] for each in place)), _Ahead(*(each[look] for each in ahead))
    path[look], state[look] = _look(table, there, near, t[look])
    return path, state


def _look(
    table: DeviceTable, place: _Place, ahead: _Ahead, t: Float[Tensor, " n"]
) -> tuple[Float[Tensor, " n"], Int8[Tensor, " n"]]:
    """Result of ``_stride`` where F is evaluated: at a root, before the only one, or a step of the parabola."""
    gap, slope = place.gap_and_slope(table)
    bend, path = ahead.bend(place, table.bounds.least)
    farthest = -2.0 * gap / slope
    only = (slope < 0.0) & (2.0 * bend * gap <= slope * slope)
    only &= (farthest * ahead.turning <= ahead.room) & (farthest <= path)
    root = torch.sqrt(slope * slope + 2.0 * bend * gap)
    move = torch.where(slope < 0.0, 2.0 * gap / (root - slope), (slope + root) / bend)
    move = ahead.within(torch.minimum(move, path))

    at_root = ROUNDING * place.r >= gap  # to rounding, or started on or beyond it
    reached = torch.where((-1e-12 * place.r < gap) & (t > 0.0), FOUND, LOST)
    state = torch.where(only, _BRACKETED, torch.where(move <= 1e-13 * place.r, FOUND, _GOING))
    state = torch.where(at_root, reached, state).to(torch.int8)
    return torch.where(at_root | only, t, t + move), state


def _close_in(
    table: DeviceTable, starts: Float[Tensor, "3 n"], along: Float[Tensor, "3 n"], t: Float[Tensor, " n"]
) -> tuple[Float[Tensor, " n"], Int8[Tensor, " n"]]:
    """The only root ahead of ``t``, by Newton, and the states.

    It converges: ``2 C F <= F'^2`` with a bound C of ``|F''|`` is the condition of Kantorovich. The search ends at the
    plane z = 0.
    """
    roots, states = t.clone(), torch.full_like(t, LOST, dtype=torch.int8)
    plane = torch.where(along[2] < 0.0, -starts[2] / along[2], torch.inf)
    going = torch.arange(len(t), device=t.device)
    for _ in range(MAX_CLOSING):
        if len(going) == 0:
            break
        path = roots[going]
        place = _Place.of(starts[:, going] + path * along[:, going], along[:, going])
        F, slope = place.gap_and_slope(table)
        newton = -F / slope
        converged = (newton.abs() <= TOLERANCE * place.r) | (F.abs() <= ROUNDING * place.r)
        below = ~converged & (F > 0.0) & (path >= plane[going])
        ahead = torch.minimum(path + newton, plane[going])
        roots[going] = torch.where(converged, path + newton, torch.where(below, path, ahead))
        states[going] = torch.where(converged, FOUND, torch.where(below, BELOW, LOST)).to(torch.int8)
        going = going[~(converged | below)]
    return roots, states
