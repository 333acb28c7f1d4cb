"""Rays through both surfaces and out of the lens, one event after the other: in torch, for any surface.

The surfaces give crossings and normals; refraction, fates and flux are written here, once for the exact surfaces
(``exact``) and for tables on any device (``device_table``). A crossing is made differentiable by one undamped Newton
step, the implicit formula, Eq. (9).
"""

from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Bool, Float, Int8
from torch import Tensor

from lensforge.kernels.fate import Fate
from lensforge.light.coated_glass import RayCoatings, behind_glass_in_torch
from lensforge.optics.dielectric import (
    Transmittances,
    coated_transmittances,
    fresnel_transmittances,
    refract,
    transmitted_cosine_squared,
    transmitted_fields,
    unpolarised_fields,
)
from lensforge.optics.media import Media
from lensforge.scene.as_made import AsMade, through_frame
from lensforge.scene.exit_rays import ExitRays
from lensforge.sources.ray_bundle import RayBundle


class Crossing(NamedTuple):
    """First crossings: path lengths (mm), whether there is one, whether the search gave up.

    A ray with neither has left through the plane z = 0.
    """

    lengths: Float[Tensor, " n"]
    found: Bool[Tensor, " n"]
    lost: Bool[Tensor, " n"]


@runtime_checkable
class TracedSurface(Protocol):
    """A star-shaped surface ``|p| = rho(p/|p|)``; ``gap`` and ``normal`` are differentiable in points and shape."""

    def first_crossing(self, origins: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"]) -> Crossing:
        """First crossings of rays from inside, at z >= 0; without a gradient."""
        ...

    def gap(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, " n"]:
        """``F = rho - |p|`` (mm), Eq. (5): positive inside, the origin included."""
        ...

    def normal(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
        """Gradient of ``|p| - rho(p/|p|)``: away from the origin, not normalised."""
        ...


@dataclass(frozen=True)
class TensorRays:
    """A :class:`RayBundle` as tensors of one precision on one device.

    ``entry_ratios`` and ``exit_ratios``: index before over index behind either face, for each ray; ``absorptions``
    (1/mm) of the body likewise, None where it is clear. ``coatings``: of the faces, NumPy arrays as yet. ``media``: for
    the cover glass. ``made``: where the lens is not as designed; rays are then in the frame of its inner face.
    """

    origins: Float[Tensor, "n 3"]
    directions: Float[Tensor, "n 3"]
    flux: Float[Tensor, " n"]
    entry_ratios: Float[Tensor, " n"]
    exit_ratios: Float[Tensor, " n"]
    absorptions: Float[Tensor, " n"] | None
    coatings: RayCoatings
    media: Media
    made: AsMade | None = None

    @staticmethod
    def of(
        rays: RayBundle, media: Media, dtype: torch.dtype, device: torch.device, made: AsMade | None = None
    ) -> "TensorRays":
        """The same numbers; ``media`` holds for rays without their own."""
        origins, directions, flux = (
            torch.as_tensor(array).to(device, dtype) for array in (rays.origins, rays.directions, rays.flux)
        )
        if made is not None:
            frames, factor, _ = made.placed
            origins, directions = through_frame(frames[0], origins, directions, factor)
        into, out_of = (torch.as_tensor(each).to(flux) for each in (rays.entry_ratios(media), rays.exit_ratios(media)))
        clear = rays.absorption_per_mm is None and media.absorption_per_mm == 0.0
        absorptions = None if clear else torch.as_tensor(rays.absorptions(media)).to(flux)
        if made is not None and absorptions is not None:
            absorptions = absorptions * made.scale  # paths are those in the lens as designed
        return TensorRays(
            origins, directions, flux, into, out_of, absorptions, RayCoatings.of(rays, media), media, made
        )


def trace_sequence(inner: TracedSurface, outer: TracedSurface, rays: TensorRays, fresnel: bool = True) -> ExitRays:
    """Trace ``rays`` out of the lens; differentiable in what the surfaces are differentiable in.

    Without ``fresnel`` both surfaces let all light through that they do not reflect totally, coated or not. Exit rays
    are those behind the cover glass, where there is one.
    """
    fates, alive, origins, directions = _entered(inner, rays)
    flux, sin2_exit = rays.flux.clone(), torch.zeros_like(rays.flux)
    absorbed = None if rays.absorptions is None else torch.zeros_like(rays.flux)
    fields = unpolarised_fields(rays.directions)
    coatings = rays.coatings
    faces = (inner, rays.entry_ratios, coatings.inner, False), (outer, rays.exit_ratios, coatings.outer, True)
    for surface, ratios, coating, is_outer in faces:
        if is_outer and rays.made is not None:
            frame = rays.made.placed[0][1]
            began, directions = through_frame(frame, origins, directions)
            fields = fields @ torch.as_tensor(frame[:, :3].T.copy()).to(fields)
            origins, enters = _above_plane(outer, began, directions)
            fates[alive[~enters]] = int(Fate.BASE)
            alive, began, origins, directions = (each[enters] for each in (alive, began, origins, directions))
        else:
            began = origins
        crossing = surface.first_crossing(origins.detach(), directions.detach())
        through_plane = _through_plane(directions, is_outer)
        fates[alive] = _without_crossing(crossing, origins, directions, through_plane, is_outer)
        alive, began, origins, directions = (each[crossing.found] for each in (alive, began, origins, directions))
        points, normals = _differentiable_hit(surface, origins, directions, crossing.lengths[crossing.found])
        above = points[:, 2].detach() >= 0.0
        fates[alive[~above]] = through_plane[crossing.found][~above]
        alive, points, directions, normals = (each[above] for each in (alive, points, directions, normals))
        normals = _roughened(normals, rays, alive, is_outer)
        if is_outer and rays.absorptions is not None:
            lengths = torch.linalg.norm(points - began[above], dim=1)
            arrived = flux[alive] * torch.exp(-rays.absorptions[alive] * lengths)
            absorbed = torch.zeros_like(flux).index_put((alive,), flux[alive] - arrived)
            flux = flux.index_put((alive,), arrived)
        ratio, cosine = ratios[alive], torch.sum(directions * normals, dim=1)
        behind_squared = transmitted_cosine_squared(cosine, ratio)
        if is_outer:
            sin2_exit = sin2_exit.index_put((alive,), 1.0 - behind_squared)
        passes = (behind_squared.detach() > 0.0) & (cosine.detach() > 0.0)
        fates[alive[~passes]] = int(Fate.TOTAL_REFLECTION)
        alive, cosine, ratio = alive[passes], cosine[passes], ratio[passes]
        origins, before, normals = points[passes], directions[passes], normals[passes]
        directions = refract(before, normals, ratio)
        if fresnel:
            found = _transmittances(cosine, ratio, coating, coatings.rows, alive)
            passed = transmitted_fields(fields[alive], before, directions, normals, ratio, found)
            share = 0.5 * torch.sum(passed**2, dim=(1, 2))
            most = torch.maximum(*found[:2]).detach() / share.detach()  # by rounding in single precision more passes
            share = share * most.clamp(max=1.0)
            flux = flux.index_put((alive,), flux[alive] * share)
            fields = fields.index_put((alive,), passed / torch.sqrt(share)[:, None, None])
    if rays.made is not None:
        frames, _, factor = rays.made.placed
        origins, directions = through_frame(frames[2], origins, directions, factor)
        fields = fields @ torch.as_tensor(frames[2][:, :3].T.copy()).to(fields)
    points, directions = (torch.zeros_like(rays.origins).index_put((alive,), each) for each in (origins, directions))
    along_z = 0.5 * flux * torch.sum(fields[:, :, 2] ** 2, dim=1)
    exits = ExitRays(points, directions, flux, sin2_exit, fates, absorbed, axial=along_z if fresnel else None)
    return behind_glass_in_torch(exits, rays.media, fresnel, coatings)


def _above_plane(
    outer: TracedSurface, points: Float[Tensor, "n 3"], directions: Float[Tensor, "n 3"]
) -> tuple[Float[Tensor, "n 3"], Bool[Tensor, " n"]]:
    """Points of rays that rise from below the plane in which a lowered or tilted outer face ends, taken to that plane.

    And those that come to lie inside the face: the others have left through the base.
    """
    height, rise = points[:, 2], directions[:, 2]
    below, rising = height < 0.0, rise > 0.0
    start = torch.where(below & rising, -height / torch.where(rising, rise, 1.0), 0.0)
    raised = points + start[:, None] * directions
    with torch.no_grad():
        inside = outer.gap(raised) > 0.0
    raised = torch.stack([raised[:, 0], raised[:, 1], torch.where(below, 0.0, height)], dim=1)
    return raised, ~below | (rising & inside)


def _roughened(normals: Float[Tensor, "n 3"], rays: TensorRays, alive: Tensor, is_outer: bool) -> Float[Tensor, "n 3"]:
    """Unit normals where the rays ``alive`` meet a face, tilted by its roughness."""
    rough = None if rays.made is None else rays.made.rough(len(rays.flux))
    if rough is None:
        return normals
    noise, slope = (rough[0][:, 3:], rough[2]) if is_outer else (rough[0][:, :3], rough[1])
    tilted = normals + slope * torch.tensor(noise[alive.cpu().numpy()]).to(normals)
    unit: Tensor = tilted / torch.linalg.norm(tilted, dim=1, keepdim=True)
    return unit


def _transmittances(
    cosine: Float[Tensor, " n"],
    ratio: Float[Tensor, " n"],
    coating: Float[np.ndarray, "k m 2"] | None,
    rows: Float[np.ndarray, " j"],
    alive: Tensor,
) -> Transmittances:
    """Transmitted shares of the rays ``alive`` at a face, coated or not; ``rows``: of all rays."""
    if coating is None:
        return fresnel_transmittances(cosine, ratio)
    table, own = (torch.as_tensor(each).to(cosine) for each in (coating, rows))
    return coated_transmittances(cosine, ratio, table, own if len(own) == 1 else own[alive])


def _entered(inner: TracedSurface, rays: TensorRays) -> tuple[Int8[Tensor, " n"], Tensor, Tensor, Tensor]:
    """Fates; the rays in the cavity, with their points and directions: those from below z = 0 start at its opening."""
    rise, height = rays.directions[:, 2], rays.origins[:, 2]
    rising = ~(rise <= 0.0)  # in this form also where rise is NaN: such a ray is outside
    enters = rising | (height > 0.0)
    start = torch.clamp(-height / torch.where(rising, rise, 1.0), min=0.0)
    points = rays.origins + start[:, None] * rays.directions
    points[:, 2] = torch.clamp(height, min=0.0)
    with torch.no_grad():
        inside = inner.gap(points) > 0.0
    fates = torch.where(inside, int(Fate.LEFT_LENS), int(Fate.OUTSIDE_CAVITY)).to(torch.int8)
    fates[~enters] = int(Fate.BACKWARD)
    alive = torch.nonzero(enters & inside)[:, 0]
    return fates, alive, points[alive], rays.directions[alive]


def _through_plane(directions: Float[Tensor, "n 3"], is_outer: bool) -> Int8[Tensor, " n"]:
    """Fates of rays that meet the plane z = 0 before a surface: in the cavity out of its opening, in the body the base.

    In the cavity a ray that rises is below the plane only at the rim, by rounding: there the body begins.
    """
    out = int(Fate.BASE if is_outer else Fate.BACKWARD)
    return torch.where(directions[:, 2].detach() <= 0.0, out, int(Fate.BASE)).to(torch.int8)


def _without_crossing(
    crossing: Crossing,
    origins: Float[Tensor, "n 3"],
    directions: Float[Tensor, "n 3"],
    through_plane: Int8[Tensor, " n"],
    is_outer: bool,
) -> Int8[Tensor, " n"]:
    """Fates of rays that do not cross a surface; ``LEFT_LENS`` for those that do."""
    below = (origins[:, 2] + crossing.lengths * directions[:, 2]).detach() < 0.0
    given_up = torch.full_like(crossing.lengths, int(Fate.NOT_CONVERGED), dtype=torch.int8)
    if is_outer:  # a ray that is not inside at its start has met the inner surface outside the outer one
        given_up[crossing.lengths == 0.0] = int(Fate.SURFACES_INTERSECT)
    unmet = torch.where(crossing.lost & ~below, given_up, through_plane)
    return torch.where(crossing.found, int(Fate.LEFT_LENS), unmet).to(torch.int8)


def _differentiable_hit(
    surface: TracedSurface, origins: Tensor, directions: Tensor, lengths: Tensor
) -> tuple[Float[Tensor, "n 3"], Float[Tensor, "n 3"]]:
    """The hit and its unit normal, with the derivative of the implicit function: one undamped Newton step."""
    with torch.no_grad():
        points = origins + lengths[:, None] * directions
        slope = -torch.sum(surface.normal(points) * directions, dim=1)
        slope = torch.where(slope < 0.0, slope, -torch.inf)  # a tangent has no step and no derivative
    points = origins + lengths[:, None] * directions
    exact = lengths - surface.gap(points) / slope
    points = origins + exact[:, None] * directions
    normals = surface.normal(points)
    return points, normals / torch.linalg.norm(normals, dim=1, keepdim=True)
