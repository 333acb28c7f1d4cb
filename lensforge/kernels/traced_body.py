"""Records of arrays that the kernels of tracing take: rays that come to a body, the body, what rays do in it.

Each field that may be None is known to the compiler: of a bare, polished body no kernel has code for films and noise.
For each of these a kernel is compiled once more, for up to ten seconds. What costs little time where it is not needed
is therefore there without rays, as fields are, or changes nothing, as frames in place.
"""

from typing import NamedTuple, TypeVar

import numpy as np
from jaxtyping import Float, Int, Int8, UInt64

from lensforge.kernels.bicubic import FaceBounds, TableSpacing
from lensforge.kernels.compiled import inline
from lensforge.kernels.face_records import FaceMedia, FacePlacement, RingShifts
from lensforge.kernels.parallel import part_of

# Media, from the source on.
CAVITY = 0
BODY = 1
OUTSIDE = 2
# Added to four times the number of the face that a ray met.
REFLECTED = 2
FROM_BEHIND = 1


_Record = TypeVar("_Record", bound=NamedTuple)

NO_FIELDS: Float[np.ndarray, "0 12"] = np.zeros((0, 12))


def some_of(record: _Record, part: slice) -> _Record:
    """Rows ``part`` of every field of a record; a field that is None stays None."""
    return record._make(None if values is None else values[part] for values in record)


class RaysIn(NamedTuple):
    """Rays incident on a body, in the frame of their source.

    ``emitted``: flux (W). ``indices``: the body's refractive index for each ray, or one for all; ``absorptions`` its
    absorption (1/mm) likewise, or nothing where the body is clear. ``film_rows``: place of each ray among the rows of
    the tables of films, or one for all. ``noise`` (n, 2 f): slopes of the facet that each ray meets at each face, along
    two lines and over the slope of the face, the first time; None if all faces are polished. ``fields`` (n, 12): of
    polarised light those with which each ray begins (``kernels.fields``: real and imaginary parts of both), in the
    frame of the faces; of no ray as from a source. ``shifts``: of light at faces that scatter by rings; None without
    any. ``keys``: of the numbers that each ray draws at a rough face which it meets again.
    """

    origins: Float[np.ndarray, "n 3"]
    directions: Float[np.ndarray, "n 3"]
    emitted: Float[np.ndarray, " n"]
    indices: Float[np.ndarray, " k"]
    absorptions: Float[np.ndarray, " j"]
    film_rows: Float[np.ndarray, " i"]
    noise: Float[np.ndarray, "n m"] | None = None
    fields: Float[np.ndarray, "m 12"] = NO_FIELDS
    shifts: RingShifts | None = None
    keys: UInt64[np.ndarray, " n"] | None = None

    def part(self, part: slice) -> "RaysIn":
        """Some of the rays."""
        indices, absorptions, films = (
            part_of(table, part) for table in (self.indices, self.absorptions, self.film_rows)
        )
        noise, keys = (None if by_ray is None else by_ray[part] for by_ray in (self.noise, self.keys))
        shifts = None if self.shifts is None else self.shifts.part(part)
        origins, directions, emitted, fields = (
            by_ray[part] for by_ray in (self.origins, self.directions, self.emitted, self.fields)
        )
        return RaysIn(origins, directions, emitted, indices, absorptions, films, noise, fields, shifts, keys)


class FaceFilms(NamedTuple):
    """Reflectance of the faces, and the length of the table of each, 0 for a bare one; see ``optics.coatings``."""

    tables: Float[np.ndarray, "f *rows m 2"]
    sizes: Int[np.ndarray, " f"]


class TracedBody(NamedTuple):
    """A body between the tables of its faces, and what surrounds it.

    Without ``fresnel`` faces let all light through that they do not reflect totally, and none has a film. ``sides``
    None: of a double lens in unpolarised light, two faces that are met in their order, whose polarisation has a closed
    form. Else polarised light is followed by its fields. Its faces are met in their order, once each, and light that
    is reflected is lost; or, where the ``bounds`` have balls, in any order, as ``kernels.nearest_face`` finds them.
    ``slopes``: of each face, by which the noise of the rays is multiplied, and ``seen``: the table of
    ``kernels.seen_slopes``; None if all faces are polished. ``placement``: None of a double lens in unpolarised light
    alone, whose faces are in place.
    """

    tables: Float[np.ndarray, "f side side"]
    bounds: FaceBounds
    grid: TableSpacing
    fresnel: bool
    cavity_index: float
    outside_index: float
    sides: FaceMedia | None = None
    films: FaceFilms | None = None
    placement: FacePlacement | None = None
    slopes: Float[np.ndarray, " f"] | None = None
    seen: Float[np.ndarray, "side side"] | None = None


class Ways(NamedTuple):
    """Path length (mm) of each ray to each of its events, and the face met there.

    ``met``: four times the number of the face; 2 more where the ray was reflected, 1 more where it came from behind the
    face; below 0 where there was none. None for a double-freeform lens in unpolarised light.
    """

    lengths: Float[np.ndarray, "n e"]
    met: Int8[np.ndarray, "n e"] | None = None

    def part(self, part: slice) -> "Ways":
        """Ways of some rays."""
        return some_of(self, part)


class RaysOut(NamedTuple):
    """Rays behind a body: what ``kernels.trace`` fills, see ``scene.exit_rays``.

    ``points``, ``directions`` and ``absorbed`` come as zeros, and stay so where a ray does not leave or is not
    absorbed; ``absorbed`` is empty if nothing absorbs. ``axial``: flux times the squared part of the field along z,
    for a cover glass; of no ray if nobody asks, or, of a double lens in unpolarised light, None. ``fields``: filled as
    those of :class:`RaysIn`, in the frame of the receivers; of no ray if nobody asks.
    """

    points: Float[np.ndarray, "n 3"]
    directions: Float[np.ndarray, "n 3"]
    flux: Float[np.ndarray, " n"]
    absorbed: Float[np.ndarray, " m"]
    sin2_exit: Float[np.ndarray, " n"]
    fates: Int8[np.ndarray, " n"]
    axial: Float[np.ndarray, " n"] | None = None
    fields: Float[np.ndarray, "k 12"] = NO_FIELDS

    def part(self, part: slice) -> "RaysOut":
        """Some of the rays."""
        return some_of(self, part)


class ByRaysOut(NamedTuple):
    """Sensitivities to the points of rays behind a body, their directions, flux, exit sine, flux along z and fields.

    ``by_fields``: of no ray where no body comes behind.
    """

    by_points: Float[np.ndarray, "n 3"]
    by_directions: Float[np.ndarray, "n 3"]
    by_flux: Float[np.ndarray, " n"]
    by_sin2: Float[np.ndarray, " n"]
    by_axial: Float[np.ndarray, " n"] | None = None
    by_fields: Float[np.ndarray, "m 12"] = NO_FIELDS

    def part(self, part: slice) -> "ByRaysOut":
        """Sensitivities to some of the rays."""
        return some_of(self, part)


@inline
def own_or_shared(values, k):
    """The value of ray k, or the one for all."""
    return values[min(k, len(values) - 1)]


@inline
def times_met(met, k, event, face):
    """Earlier hits of a face by ray k before an event; 0 if faces are met once each, in order."""
    if met is None:
        return 0
    times = 0
    for before in range(event):
        times += 1 if met[k, before] // 4 == face else 0
    return times


@inline
def index_in(medium, k, rays, body):
    """Refractive index of a medium for ray k."""
    if medium == CAVITY:
        return body.cavity_index
    return body.outside_index if medium == OUTSIDE else own_or_shared(rays.indices, k)
