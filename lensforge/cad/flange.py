"""The flange of a lens for total internal reflection: a ring around the cylinder between its wall and its exit.

Its top lies by the setback below the lowest place of the exit's rim, its underside at least as far above the highest
place of the wall. What is left of the cylinder above and below it is no optical face: the light ends there.
"""

from dataclasses import dataclass
from math import radians, tan
from typing import Any

import numpy as np
from jaxtyping import Float

from lensforge.cad.boundary import Boundary, StarShaped, lens_boundaries
from lensforge.cad.outline import FULL_TURN
from lensforge.errors import InputError
from lensforge.scene.lens import Lens
from lensforge.spec.face_section import FlangeSection

_AZIMUTHS = 3600

Curve = Float[np.ndarray, "n 2"]


def flange_heights_mm(envelope: Boundary[Any]) -> tuple[float, float]:
    """Highest place of the wall and lowest place of the exit (heights) at the cylinder where the flange begins."""
    turn = np.linspace(0.0, FULL_TURN, _AZIMUTHS, endpoint=False)
    (domain,) = (face.domain for face in envelope.faces if face.is_flange)
    assert domain.inside is not None and domain.outside is not None
    return float(domain.outside.points(turn)[:, 2].max()), float(domain.inside.points(turn)[:, 2].min())


@dataclass(frozen=True)
class FlangeRing:
    """The ring (mm): its inner radius, outer radii at top and underside, and the heights of these."""

    inner_mm: float
    outer_mm: float
    foot_mm: float
    low_mm: float
    high_mm: float

    @property
    def thickness_mm(self) -> float:
        """Height of its side."""
        return self.high_mm - self.low_mm

    @property
    def corners(self) -> Curve:
        """Distance from the axis and height of the corners of its section, from the top at the lens on."""
        inner = self.inner_mm
        low = self.low_mm
        high = self.high_mm
        return np.array([(inner, high), (self.outer_mm, high), (self.foot_mm, low), (inner, low)])

    def around(self, profile: Curve) -> Float[np.ndarray, "m 2"]:
        """The section of a lens, (position across, z) from rim to rim, with the ring on both sides of it."""
        across, z = profile.T
        hidden = (np.abs(np.abs(across) - self.inner_mm) < 1e-6) & (z > self.low_mm) & (z < self.high_mm)
        left, right = (np.flatnonzero(np.sign(across) == side) for side in (-1.0, 1.0))
        ends = left[z[left] <= self.low_mm][-1], right[z[right] <= self.low_mm][0]
        parts = np.split(np.arange(len(z)), [ends[0] + 1, ends[1]])
        visible = [profile[rows[~hidden[rows]]] for rows in parts]
        return np.concatenate([visible[0], self.corners[::-1] * (-1.0, 1.0), visible[1], self.corners, visible[2]])


def ring_of(lens: Lens, envelope: StarShaped | None = None) -> FlangeRing | None:
    """The ring of ``lens``, at the ``envelope`` of its fitted or exact faces; None without a flange.

    Raises :class:`InputError` if wall and exit leave too low a cylinder for it.
    """
    section = lens.spec.lens.rim_flange
    if section is None:
        return None
    boundary = lens_boundaries(lens)[1] if envelope is None else envelope
    assert isinstance(boundary, Boundary)
    low, high = flange_heights_mm(boundary)
    (cylinder,) = (face.surface for face in lens.body.faces if face.is_flange)
    radius = float(cylinder.radius(np.array([[1.0, 0.0, 0.0]]))[0])
    return _ring(section, radius, low, high, lens.spec.manufacture.draft_deg(section.draft_deg))


def _ring(section: FlangeSection, radius_mm: float, low_mm: float, high_mm: float, draft_deg: float) -> FlangeRing:
    top = high_mm - section.setback_mm
    if not top - section.thickness_mm > low_mm:
        raise InputError(
            f"lens.flange.thickness_mm = {section.thickness_mm:g}: "
            f"wall and exit leave {high_mm - low_mm:.4g} mm for it "
            f"and its setbacks, {section.room_mm:g} are needed; design again with more steps, or lower it"
        )
    outer = section.diameter_mm / 2.0
    foot = outer - section.thickness_mm * tan(radians(draft_deg))
    if not foot > radius_mm:
        raise InputError(
            f"lens.flange.draft_deg = {draft_deg:g}: leaves nothing of its underside; take less, or raise diameter_mm"
        )
    return FlangeRing(radius_mm, outer, foot, top - section.thickness_mm, top)
