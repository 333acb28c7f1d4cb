"""Results of casts through the files of a part: ray by ray against the design, and the size of the body in each."""

from typing import Annotated

import numpy as np
from jaxtyping import Float

from lensforge.results import Array, BodySize, Count, NotNegative, Record, Share, Text


class PartFlux(Record):
    """The flux budget of the part; shares of the emitted flux."""

    detected: Share
    outside: Share
    missed: Share
    total_reflection: Share
    event_limit: Share = 0.0
    absorbed: Share = 0.0
    cover_glass: Share = 0.0
    bodies: Share = 0.0
    housing: Share = 0.0
    second_wall: Share = 0.0
    reflected: Share


class SizedFile(Record):
    """Size of the body in one file; tolerances for flat facets: a height (mm), volume and area, 0 for a STEP."""

    size: BodySize
    chord_mm: NotNegative = 0.0
    facets_mm3: NotNegative = 0.0
    facets_mm2: NotNegative = 0.0


class Sizes(Record):
    """Size of the part in its files, and as exported, whose box lies within ``chord_mm`` of the solid's."""

    exported: BodySize
    chord_mm: NotNegative
    mesh: SizedFile
    step: SizedFile | None


Gaps = Annotated[Float[np.ndarray, " q"], Array("q")]


class LandingDeviation(Record):
    """Distances (mm) between the part's landings and the design's."""

    rms: NotNegative
    max: NotNegative
    p99: NotNegative

    @property
    def rms_mm(self) -> float:
        """Root mean square (mm)."""
        return self.rms


class FatePair(Record):
    """Rays with different fates in design and part: both fates, number of rays, and share of the emitted flux."""

    design: Text
    part: Text
    rays: Count
    flux: Share


class Agreement(LandingDeviation):
    """Landings and light of part and design: distances (mm) over the rays that both land on the receiver.

    ``flux``: sum of the differences of flux over the sum of flux. ``fates``: number of rays that one lands on the
    receiver and the other loses; ``fates_flux``: their share of the emitted flux; ``pairs``: the same by the fates in
    both, the largest share first. Where no ray lands in both, the distances are the receiver's diagonal and ``flux``
    is 1.
    """

    compared: Count
    flux: NotNegative
    fates: Count
    fates_flux: Share
    pairs: tuple[FatePair, ...] = ()


class PlainCast(Record):
    """First hits (``casts``) by trimesh's own ray cast against those of the grid."""

    rays: Count
    casts: Count
    disagreements: Count


class BrepCast(Record):
    """Rays through the STEP file itself."""

    rays: Count
    seconds: NotNegative
    against_design: Agreement
    against_mesh: Agreement


class MitsubaCast(Record):
    """Rays through the mesh by Mitsuba, release ``version``."""

    version: Text
    rays: Count
    seconds: NotNegative
    nmse_vs_design: NotNegative
    noise_floor_nmse: NotNegative
    nmse_same_rays: NotNegative
    against_design: Agreement
