"""Faces of a body by the media before and behind them, and by their purpose, whatever their shape."""

from collections.abc import Sequence
from dataclasses import dataclass

CAVITY, BODY, OUTSIDE = MEDIA = "cavity", "body", "outside"  # from the source on
DOUBLE = "inner", "outer"  # the faces of a body of two, from the source on
MOST_EVENTS = 64  # at which a ray may meet a face
OPENING = CAVITY, OUTSIDE  # sides of a face without material: the plane in which cavity and body end together


class FaceSides:
    """A face by the media ``before`` it, on the origin's side, and ``behind`` it; ``is_flange``: a flange begins there,
    and light that meets it is absorbed.
    """

    before: str
    behind: str
    is_flange: bool

    @property
    def is_open(self) -> bool:
        """True for an opening, which has no material."""
        return (self.before, self.behind) == OPENING

    @property
    def is_optical(self) -> bool:
        """True for a face that transmits or reflects light: there is material, and no flange begins."""
        return not (self.is_open or self.is_flange)

    @property
    def around(self) -> str:
        """Medium on the side opposite the body."""
        return CAVITY if self.before == CAVITY else OUTSIDE


@dataclass(frozen=True)
class FaceRole(FaceSides):
    """A face of a kind of lens, whatever its shape.

    ``reflects``: its purpose is to reflect, totally or by a mirror, and it lets no light in. ``widens``: upwards, so
    that its half of the mould leaves the other way than that of other faces on its side. ``on_axis``: the length that a
    spec gives it is its height on the axis; else its distance from the LED, or at z = 0 from the axis. ``is_placed``:
    it has a place of its own against the first face; all others are cut as one with that. ``follows``: name of the face
    whose shape it has, a wall behind it.
    """

    name: str
    before: str
    behind: str
    reflects: bool = False
    widens: bool = False
    on_axis: bool = False
    is_placed: bool = False
    follows: str | None = None
    is_flange: bool = False


def bounding(roles: Sequence[FaceRole], medium: str) -> tuple[FaceRole, ...]:
    """The faces that bound ``medium`` on the side away from the origin, openings last."""
    return (
        *(role for role in roles if role.before == medium and not role.is_open),
        *(role for role in roles if role.is_open),
    )


SHELL = FaceRole("inner", CAVITY, BODY), FaceRole("outer", BODY, OUTSIDE, is_placed=True)
RIM_FLANGE = FaceRole("flange", BODY, OUTSIDE, is_flange=True)  # the cylinder at which a flange begins
DRAWN_END = FaceRole("end", BODY, OUTSIDE, is_flange=True)  # of a body that is drawn along y
