"""Faces as data: a body of named faces between the cavity, its material and what surrounds it.

Every face is a radius over the hemisphere about the origin. Where several faces bound the same medium on the side of
the origin, the nearest of them bounds it in each direction: the medium is the intersection of star-shaped bodies, and
two faces meet in a crease. The cavity of a lens for total internal reflection is bounded by its cap and its side, the
body by its reflecting wall and its exit. An opening lies between the cavity and what surrounds the body, which ends
there, too: the cavity of a reflector is bounded by its cup and its mouth, the body by its back and its mouth.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from lensforge.errors import InputError
from lensforge.kernels.face_records import FaceMedia
from lensforge.optics.face_roles import BODY, CAVITY, DOUBLE, MEDIA, MOST_EVENTS, OPENING, SHELL, FaceRole, FaceSides
from lensforge.optics.media import Media, Mirror
from lensforge.scene.section_arcs import FaceArc, arcs_of
from lensforge.spec.lens_section import LensShape
from lensforge.surfaces.drawn_profile import DrawnFace, in_section
from lensforge.surfaces.srbf import fibonacci_hemisphere
from lensforge.surfaces.surface import Surface, grid, to_sphere

_DIRECTIONS = 20_000
_ANGLES = 3601  # of the section of a linear lens
_NODES = 96  # of the chart's grid on which faces are compared


@dataclass(frozen=True)
class Face(FaceSides):
    """One face of a body: its shape, and the media ``before`` it, on the origin's side, and ``behind`` it."""

    name: str
    surface: Surface
    before: str
    behind: str
    is_flange: bool = False


@dataclass(frozen=True)
class Chain:
    """Faces of which a ray meets the nearest that bounds the medium in which it is, at most ``events`` times.

    ``names`` of the faces, and the media ``before`` and ``behind`` each. What a face reflects beside light that passes
    is not followed. Raises :class:`InputError` for less than one event and more than 64.
    """

    names: tuple[str, ...]
    before: tuple[str, ...]
    behind: tuple[str, ...]
    events: int

    @staticmethod
    def of_lens(lens: LensShape) -> "Chain | None":
        """The chain of the faces of a lens in their order; None for two that light meets one after the other."""
        if lens.body_names == DOUBLE:
            return None
        before, behind = zip(*((role.before, role.behind) for role in lens.body_roles), strict=True)
        return Chain(lens.body_names, before, behind, lens.most_events)

    def __post_init__(self) -> None:
        if not 1 <= self.events <= MOST_EVENTS:
            raise InputError(f"events = {self.events}: must be 1 to {MOST_EVENTS}, at each of which a ray meets a face")

    @property
    def is_open(self) -> bool:
        """True where light leaves the cavity through an opening."""
        return OPENING in zip(self.before, self.behind, strict=True)

    def packed(self, media: Media) -> FaceMedia:
        """Media before and behind the faces by number, and what mirrors reflect, as the kernels take them."""
        before, behind = (
            np.array([MEDIA.index(side) for side in sides], dtype=np.int8) for sides in (self.before, self.behind)
        )
        coatings = [media.coating(name) for name in self.names]
        mirrors = np.array([coating.reflectance if isinstance(coating, Mirror) else -1.0 for coating in coatings])
        return FaceMedia(before, behind, mirrors)


@dataclass(frozen=True)
class Body:
    """The faces of a body, in the order in which light from the source meets the media that they bound."""

    faces: tuple[Face, ...]

    @staticmethod
    def of(surfaces: Mapping[str, Surface], roles: Sequence[FaceRole] = SHELL) -> "Body":
        """The body of a lens of any kind: its faces by name, each in its role."""
        sides = {role.name: (role.before, role.behind, role.is_flange) for role in roles}
        return Body(tuple(Face(name, surface, *sides[name]) for name, surface in surfaces.items()))

    def face(self, name: str) -> Face:
        """The face of that name."""
        return next(face for face in self.faces if face.name == name)

    def bounding(self, medium: str) -> tuple[Face, ...]:
        """The faces that bound ``medium`` on the side away from the origin, openings last."""
        closed = (face for face in self.faces if face.before == medium and not face.is_open)
        return (*closed, *(face for face in self.faces if face.is_open))

    @cached_property
    def cavity(self) -> tuple[Face, ...]:
        """The faces that bound the cavity."""
        return self.bounding(CAVITY)

    @cached_property
    def envelope(self) -> tuple[Face, ...]:
        """The faces by which light leaves the body, or is reflected in it."""
        return self.bounding(BODY)

    @property
    def in_order(self) -> tuple[Face, ...]:
        """The faces of the cavity, those of the envelope, and openings."""
        return (*(face for face in self.cavity if not face.is_open), *self.envelope)

    @cached_property
    def largest_mm(self) -> float:
        """Largest distance of its envelope from the origin above z = 0, over 20,000 directions."""
        return float(radii(self.envelope, fibonacci_hemisphere(_DIRECTIONS)).min(axis=0).max())

    def chain(self, events: int) -> Chain:
        """The faces as rays meet them that may meet any of them."""
        return Chain(
            tuple(face.name for face in self.faces),
            tuple(face.before for face in self.faces),
            tuple(face.behind for face in self.faces),
            events,
        )

    @property
    def is_drawn(self) -> bool:
        """True where all faces are profiles drawn along y."""
        return all(isinstance(face.surface, DrawnFace) for face in self.faces)

    def arcs(self, medium: str) -> tuple[FaceArc, ...]:
        """The faces of a linear lens that bound ``medium``, along its section from -x to +x."""
        faces = ((face.name, face.surface) for face in self.bounding(medium))
        return arcs_of([(name, surface) for name, surface in faces if isinstance(surface, DrawnFace)])

    def require_sound(self) -> None:
        """Raise :class:`InputError` for media that no face bounds, faces that cross, and faces in several pieces."""
        for medium in (CAVITY, BODY):
            if all(face.is_open for face in self.bounding(medium)):
                names = ", ".join(face.name for face in self.faces)
                raise InputError(f"faces {names}: none bounds the {medium}; the body is not closed, add one")
        if self.is_drawn:
            self._require_sound_section()
            return
        directions, inside = _hemisphere()
        inner, outer = (radii(faces, directions).min(axis=0) for faces in (self.cavity, self.envelope))
        closed = np.array([not face.is_open for face in self.cavity])[nearest(self.cavity, directions)]
        wall = np.where(inside & closed, outer - inner, np.inf)
        worst = np.unravel_index(int(np.argmin(wall)), wall.shape)
        if not wall[worst] > 0.0:
            raise self._crossed(float(wall[worst]), directions[worst])
        for faces in (self.cavity, self.envelope):
            _require_whole(faces, nearest(faces, directions), inside)

    def _require_sound_section(self) -> None:
        """Raise :class:`InputError` where faces that are drawn along y cross, or do not lie about a middle one."""
        angles = np.linspace(-0.5 * np.pi, 0.5 * np.pi, _ANGLES)
        directions = in_section(angles)
        inner, outer = (radii(faces, directions).min(axis=0) for faces in (self.cavity, self.envelope))
        worst = int(np.argmin(outer - inner))
        if not outer[worst] > inner[worst]:
            raise self._crossed(float((outer - inner)[worst]), directions[worst])
        for medium in (CAVITY, BODY):
            names = [arc.name for arc in self.arcs(medium)]
            if names != names[::-1] or len(set(names)) != (len(names) + 1) // 2:
                raise InputError(
                    f"faces {', '.join(dict.fromkeys(names))}: from -x to +x the {medium} is bounded by "
                    f"{', '.join(names)}: must be one in the middle, and each other on both sides of it; move one of "
                    "them, or leave it out"
                )

    def _crossed(self, wall_mm: float, direction: Float[np.ndarray, "3"]) -> InputError:
        x, y, z = direction
        return InputError(
            f"wall = {wall_mm:.4g} mm in the direction ({x:.3f}, {y:.3f}, {z:.3f}): the faces "
            f"{', '.join(face.name for face in self.envelope)} must lie outside of "
            f"{', '.join(face.name for face in self.cavity)}"
        )


def radii(faces: tuple[Face, ...], directions: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "f *n"]:
    """Radius (mm) of each face in unit ``directions``."""
    flat = directions.reshape(-1, 3)
    return np.stack([face.surface.radius(flat) for face in faces]).reshape(len(faces), *directions.shape[:-1])


def nearest(faces: tuple[Face, ...], directions: Float[np.ndarray, "*n 3"]) -> Int[np.ndarray, "*n"]:
    """Number of the face that bounds the medium in each direction."""
    if len(faces) == 1:
        return np.zeros(directions.shape[:-1], dtype=np.intp)
    return np.argmin(radii(faces, directions), axis=0)


def _hemisphere() -> tuple[Float[np.ndarray, "n n 3"], np.ndarray]:
    """Directions of a square grid of the chart, and which of them lie on the hemisphere."""
    chart = grid(_NODES)
    return to_sphere(chart), np.sum(chart**2, axis=-1) <= 1.0


def _require_whole(faces: tuple[Face, ...], numbers: Int[np.ndarray, "n n"], inside: np.ndarray) -> None:
    """Raise :class:`InputError` where a face is nowhere the nearest, or bounds its medium in several pieces."""
    from scipy.ndimage import label

    for number, face in enumerate(faces):
        pieces = label((numbers == number) & inside)[1]
        if pieces != 1 and not face.is_flange:  # that is a band narrower than the grid's step
            neighbours = ", ".join(neighbour.name for neighbour in faces if neighbour is not face)
            fault = "nowhere the nearest" if pieces == 0 else f"cut into {pieces} pieces"
            raise InputError(
                f"{face.name}: {fault} seen from the origin, by {neighbours}: "
                "must be one piece without a hole; move one "
                "of these faces, or leave it out"
            )
