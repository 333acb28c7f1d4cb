"""Rays through both surfaces and out of the lens, one event after the other: for any surface, in NumPy or in torch.

The surfaces give crossings and normals; refraction, fates and flux are written here, once for the exact surfaces
(``exact_trace``) and for tables on any device (``device_trace``). A crossing is made differentiable by one undamped
Newton step, the implicit formula, Eq. (9).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Inexact, Int, Int8

from lensforge.kernels.fate import Fate
from lensforge.light.coated_glass import RayCoatings, behind_glass_by_arrays, face_transmittances
from lensforge.optics.arrays import (
    Array,
    codes,
    constant,
    lengths,
    like,
    module_of,
    replaced,
    rows_of,
    without_gradient,
)
from lensforge.optics.dielectric import (
    fields_behind,
    passing_amplitudes,
    refract,
    transmitted_cosine_squared,
    unpolarised_fields,
)
from lensforge.optics.media import DOUBLE, Media
from lensforge.scene.as_made import AsMade, through_frame
from lensforge.scene.exit_rays import ExitRays
from lensforge.sources.ray_bundle import RayBundle


class Crossing(NamedTuple):
    """First crossings: path lengths (mm), whether there is one, whether the search gave up.

    A ray with neither has left through the plane z = 0.
    """

    lengths: Float[Array, " n"]
    found: Bool[Array, " n"]
    lost: Bool[Array, " n"]


@runtime_checkable
class TracedSurface(Protocol):
    """A star-shaped surface ``|p| = rho(p/|p|)``; ``gap`` and ``normal`` are differentiable in points and shape."""

    def first_crossing(self, origins: Float[Array, "n 3"], directions: Float[Array, "n 3"]) -> Crossing:
        """First crossings of rays from inside, at z >= 0; without a gradient."""
        ...

    def gap(self, points: Float[Array, "n 3"]) -> Float[Array, " n"]:
        """``F = rho - |p|`` (mm), Eq. (5): positive inside, the origin included."""
        ...

    def normal(self, points: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
        """Gradient of ``|p| - rho(p/|p|)``: away from the origin, not normalised."""
        ...


@dataclass(frozen=True)
class EnteringRays:
    """A :class:`RayBundle` as arrays of one module, one precision and one device.

    ``entry_ratios`` and ``exit_ratios``: index before over index behind either face, for each ray; ``absorptions``
    (1/mm) of the body likewise, None where it is clear. ``coatings``: of the faces, NumPy arrays as yet. ``media``: for
    the cover glass. ``made``: where the lens is not as designed; rays are then in the frame of its inner face.
    """

    origins: Float[Array, "n 3"]
    directions: Float[Array, "n 3"]
    flux: Float[Array, " n"]
    entry_ratios: Float[Array, " n"]
    exit_ratios: Float[Array, " n"]
    absorptions: Float[Array, " n"] | None
    coatings: RayCoatings
    media: Media
    made: AsMade | None = None

    @staticmethod
    def of(
        rays: RayBundle, media: Media, made: AsMade | None = None, to: Callable[[Array], Array] = np.asarray
    ) -> "EnteringRays":
        """The numbers of ``rays``, each array ``to`` another module."""
        origins, directions, flux = (to(array) for array in (rays.origins, rays.directions, rays.flux))
        if made is not None:
            frames, factor, _ = made.placed
            origins, directions = through_frame(frames[0], origins, directions, factor)
        waves, count = rays.wavelengths_nm, len(rays)
        indices, absorbing = media.body.indices(waves, count), media.body.absorption(waves)
        into, out_of = to(media.cavity_index / indices), to(indices / media.outside_index)
        absorptions = to(media.body.absorptions(waves, count)) if len(absorbing) else None
        if made is not None and absorptions is not None:
            absorptions = absorptions * made.scale  # paths are those in the lens as designed
        return EnteringRays(
            origins, directions, flux, into, out_of, absorptions, RayCoatings.of(rays, media), media, made
        )


def trace_sequence(inner: TracedSurface, outer: TracedSurface, rays: EnteringRays, fresnel: bool = True) -> ExitRays:
    """Trace ``rays`` out of the lens; differentiable in what the surfaces are differentiable in.

    Without ``fresnel`` both surfaces let all light through that they do not reflect totally, coated or not. Exit rays
    are those behind the cover glass, where there is one.
    """
    fates, alive, points = entered(rays, lambda points: inner.gap(points) > 0.0)
    origins, directions = points[alive], rays.directions[alive]
    xp = module_of(rays.flux)
    flux, sin2_exit = rays.flux, xp.zeros_like(rays.flux)
    absorbed = None if rays.absorptions is None else xp.zeros_like(rays.flux)
    fields = unpolarised_fields(rays.directions)
    coatings = rays.coatings
    faces = (
        (inner, rays.entry_ratios, coatings.faces.get(DOUBLE[0]), False),
        (outer, rays.exit_ratios, coatings.faces.get(DOUBLE[1]), True),
    )
    for surface, ratios, coating, leaving in faces:
        if leaving and rays.made is not None:
            frame = rays.made.placed[0][1]
            began, directions = through_frame(frame, origins, directions)
            fields = fields @ like(fields, frame[:, :3].T.copy())
            origins, enters = _above_plane(outer, began, directions)
            fates[alive[~enters]] = int(Fate.BASE)
            alive, began, origins, directions = (each[enters] for each in (alive, began, origins, directions))
        else:
            began = origins
        crossing = surface.first_crossing(constant(origins), constant(directions))
        through_plane = fates_at_plane(directions, leaving)
        fates[alive] = _without_crossing(crossing, origins, directions, through_plane, leaving)
        alive, began, origins, directions = (each[crossing.found] for each in (alive, began, origins, directions))
        points, normals = differentiable_hit(surface, origins, directions, crossing.lengths[crossing.found])
        above = constant(points)[:, 2] >= 0.0
        fates[alive[~above]] = through_plane[crossing.found][~above]
        alive, points, directions, normals = (each[above] for each in (alive, points, directions, normals))
        normals = _roughened(normals, rays, alive, leaving)
        if leaving and rays.absorptions is not None:
            arrived = flux[alive] * xp.exp(-rays.absorptions[alive] * lengths(points - began[above]))
            absorbed = replaced(xp.zeros_like(flux), alive, flux[alive] - arrived)
            flux = replaced(flux, alive, arrived)
        ratio, cosine = ratios[alive], (directions * normals).sum(1)
        behind_squared = transmitted_cosine_squared(cosine, ratio)
        if leaving:
            sin2_exit = replaced(sin2_exit, alive, 1.0 - behind_squared)
        passes = constant((behind_squared > 0.0) & (cosine > 0.0))
        fates[alive[~passes]] = int(Fate.TOTAL_REFLECTION)
        alive, cosine, ratio = alive[passes], cosine[passes], ratio[passes]
        origins, before, normals = points[passes], directions[passes], normals[passes]
        directions = refract(before, normals, ratio)
        if fresnel:
            transmittances = face_transmittances(cosine, ratio, coating, coatings.rows, alive)
            passed = fields_behind(
                fields[alive], before, directions, normals, passing_amplitudes(transmittances, ratio)
            )
            share = 0.5 * (passed**2).sum((1, 2))
            most = constant(xp.maximum(*transmittances[:2]) / share)  # by rounding in single precision more passes
            share = share * xp.where(most < 1.0, most, 1.0)
            flux = replaced(flux, alive, flux[alive] * share)
            fields = replaced(fields, alive, passed / xp.sqrt(share)[:, None, None])
    points, directions = (replaced(xp.zeros_like(rays.origins), alive, each) for each in (origins, directions))
    exits = ExitRays(points, directions, flux, sin2_exit, fates, absorbed)
    return as_seen(exits, alive, rays, fields, flux if fresnel else None)


def as_seen(
    exits: ExitRays, left: Array, rays: EnteringRays, fields: Inexact[Array, "n 2 3"], flux: Float[Array, " n"] | None
) -> ExitRays:
    """``exits`` of a body, which are in the frame of its last face, in the frame of the receivers and behind the glass.

    Before further bodies they stay as they leave the lens, with their fields.

    ``left``: rows of those that left the body; the others keep no point and no direction. ``flux``: (W) of fields
    of length 1; None where no face loses light.
    """
    points, directions = exits.points[left], exits.directions[left]
    if rays.made is not None:
        frames, _, factor = rays.made.placed
        points, directions = through_frame(frames[-1], points, directions, factor)
        fields = fields @ like(fields, frames[-1][:, :3].T.copy())
    xp = module_of(points)
    points, directions = (replaced(xp.zeros_like(exits.points), left, each) for each in (points, directions))
    axial = None if flux is None else 0.5 * flux * (abs(fields[:, :, 2]) ** 2).sum(1)
    placed = replace(exits, points=points, directions=directions, axial=axial)
    if rays.media.bodies:  # in NumPy alone
        parts = np.stack([fields.real, fields.imag], axis=2).reshape(-1, 12)
        return replace(placed, fields=np.where(exits.left_lens[:, None], parts, 0.0))
    return behind_glass_by_arrays(placed, rays.media, flux is not None, rays.coatings)


def _above_plane(
    outer: TracedSurface, points: Float[Array, "n 3"], directions: Float[Array, "n 3"]
) -> tuple[Float[Array, "n 3"], Bool[Array, " n"]]:
    """Points of rays that rise from below the plane in which a lowered or tilted outer face ends, taken to that plane.

    And those that come to lie inside the face: the others have left through the base.
    """
    height, rise = points[:, 2], directions[:, 2]
    below, rising = height < 0.0, rise > 0.0
    xp = module_of(points)
    start = xp.where(below & rising, -height / xp.where(rising, rise, 1.0), 0.0)
    raised = points + start[:, None] * directions
    with without_gradient(raised):
        inside = outer.gap(raised) > 0.0
    raised = xp.stack([raised[:, 0], raised[:, 1], xp.where(below, 0.0, height)], 1)
    return raised, ~below | (rising & inside)


def _roughened(normals: Float[Array, "n 3"], rays: EnteringRays, alive: Array, leaving: bool) -> Float[Array, "n 3"]:
    """Unit normals where the rays ``alive`` meet a face, tilted by its roughness."""
    rough = None if rays.made is None else rays.made.rough(len(rays.flux))
    if rough is None:
        return normals
    noise, slope = (rough[0][:, 3:], rough[1][1]) if leaving else (rough[0][:, :3], rough[1][0])
    tilted = normals + slope * like(normals, noise.copy())[alive]
    return tilted / lengths(tilted)[:, None]


def entered(
    rays: EnteringRays, inside: Callable[[Float[Array, "n 3"]], Bool[Array, " n"]]
) -> tuple[Int8[Array, " n"], Int[Array, " k"], Float[Array, "n 3"]]:
    """Fates; the rows of the rays in the cavity; the points of all: rays from below z = 0 start at its opening.

    ``inside``: True for points in the cavity.
    """
    rise, height = rays.directions[:, 2], rays.origins[:, 2]
    rising = ~(rise <= 0.0)  # in this form also where rise is NaN: such a ray is outside
    enters = rising | (height > 0.0)
    xp = module_of(rise)
    start = xp.where(height < 0.0, -height / xp.where(rising, rise, 1.0), 0.0)
    points = rays.origins + start[:, None] * rays.directions
    points[:, 2] = xp.where(height < 0.0, 0.0, height)
    with without_gradient(points):
        within = inside(points)
    started = _fates(within, Fate.LEFT_LENS, Fate.OUTSIDE_CAVITY)
    return codes(xp.where(enters, started, int(Fate.BACKWARD))), rows_of(enters & within), points


def fates_at_plane(directions: Float[Array, "n 3"], leaving: bool) -> Int8[Array, " n"]:
    """Fates of rays that meet the plane z = 0 before a surface: in the cavity out of its opening, in the body the base.

    In the cavity a ray that rises is below the plane only at the rim, by rounding: there the body begins.
    """
    out = int(Fate.BASE if leaving else Fate.BACKWARD)
    return _fates(constant(directions)[:, 2] <= 0.0, out, Fate.BASE)


def _fates(where: Array, here: int, elsewhere: int) -> Int8[Array, " n"]:
    """One fate where ``where`` is true, another elsewhere."""
    return codes(module_of(where).where(where, int(here), int(elsewhere)))


def _without_crossing(
    crossing: Crossing,
    origins: Float[Array, "n 3"],
    directions: Float[Array, "n 3"],
    through_plane: Int8[Array, " n"],
    leaving: bool,
) -> Int8[Array, " n"]:
    """Fates of rays that do not cross a surface; ``LEFT_LENS`` for those that do."""
    xp = module_of(crossing.lengths)
    below = constant(origins[:, 2] + crossing.lengths * directions[:, 2]) < 0.0
    # a ray that is not inside the outer surface at its start has met the inner one outside it
    beyond = (crossing.lengths == 0.0) & leaving
    given_up = _fates(beyond, Fate.SURFACES_INTERSECT, Fate.NOT_CONVERGED)
    unmet = xp.where(crossing.lost & ~below, given_up, through_plane)
    return codes(xp.where(crossing.found, int(Fate.LEFT_LENS), unmet))


def differentiable_hit(
    surface: TracedSurface,
    origins: Float[Array, "n 3"],
    directions: Float[Array, "n 3"],
    paths: Float[Array, " n"],
    from_behind: bool = False,
) -> tuple[Float[Array, "n 3"], Float[Array, "n 3"]]:
    """The hit and its unit normal, with the derivative of the implicit function: one undamped Newton step.

    The normal points along the ray, which leaves what the surface surrounds or, ``from_behind``, comes into it.
    """
    with without_gradient(origins):
        points = origins + paths[:, None] * directions
        slope = -(surface.normal(points) * directions).sum(1)
        meets = slope > 0.0 if from_behind else slope < 0.0
        slope = module_of(slope).where(meets, slope, -np.inf)  # a tangent has no step and no derivative
    points = origins + paths[:, None] * directions
    exact = paths - surface.gap(points) / slope
    points = origins + exact[:, None] * directions
    normals = -surface.normal(points) if from_behind else surface.normal(points)
    return points, normals / lengths(normals)[:, None]
