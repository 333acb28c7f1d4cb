"""The form of a body in one file against the design: the largest distance of its points from the faces, and its place.

Of a mesh the corners of each facet lie on one face, to rounding, and its middle as near as flat facets are. The face is
that from which the corners are least off together. A mesh may be open, or lack a face, as a body of faces may.
"""

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from jaxtyping import Float, Int

from lensforge.proof.designed_body import Designed, DesignedBody, StandingWalls
from lensforge.results import Count, NotNegative, Point, Record, Text
from lensforge.results.figure import Criterion, Figure, criteria_in, figure

_Points = Float[np.ndarray, "n 3"]
_Values = Float[np.ndarray, " n"]
_Numbers = Int[np.ndarray, " n"]

# A bump of a control point that is moved by 1 um is 0.3 um high, less by the cosine of its slope. Optical faces
# are within their tolerance of the design, walls that follow a spline, as where a flange begins, within 0.02 um more.
FORM_UM = 0.02
_WALLS_MM = 5e-5
_STATED = 1.05  # of the stated chord error, which is known to 1 %, and at the middle of a facet measured otherwise
_UM_PER_MM = 1e3


_AGAIN = "export again, it is not the part that was designed"


class FileForm(Record):
    """Form of the body in the file ``name``: its point farthest off the design (um), next to ``face``, and where.

    ``limit_um``: what rounding explains. The middle of a flat facet counts only beyond the chord error allowed to it.
    ``open_edges``: those that do not join two pieces of surface; ``lacking``: faces of the design that the file does
    not have.
    """

    name: Text
    off_um: Annotated[
        NotNegative,
        Figure("{name}", "largest, next to {face}", key="form {name}", unit="nm", digits=2),
        Criterion(
            "<=", "limit_um", "largest form error", f"at {{place}}, next to {{face}}; {_AGAIN}", name="form", unit="um"
        ),
    ]
    face: Text
    at_mm: Point
    limit_um: NotNegative
    open_edges: Count
    lacking: tuple[Text, ...] = ()

    @property
    @figure(Criterion("<=", 0.0, "open edges and missing faces", f"{{gap_words}}; {_AGAIN}"))
    def gaps(self) -> int:
        """Number of open edges and missing faces."""
        return self.open_edges + len(self.lacking)

    @property
    def gap_words(self) -> str:
        """Sentence on the missing parts."""
        return f"it has nothing of {', '.join(self.lacking[:3])}" if self.lacking else "it is not closed"

    @property
    def place(self) -> str:
        """The place of the point, as a phrase."""
        x, y, z = self.at_mm
        return f"({x:.4g}, {y:.4g}, {z:.4g}) mm"

    @property
    def is_right(self) -> bool:
        """True if the form agrees with the design."""
        return all(criterion.holds for criterion in criteria_in(self))


@dataclass
class Farthest:
    """The point farthest off so far (mm), and its face; ``met``: names of all faces found."""

    off_mm: float = 0.0
    face: str = ""
    at_mm: Point = (0.0, 0.0, 0.0)
    met: set[str] = field(default_factory=set)

    def meet(self, face: Designed, numbers: _Numbers) -> None:
        """Note that these faces, by number, of ``face`` were found."""
        self.met.update(face.names[number] for number in np.unique(numbers))

    def see(self, face: Designed, off_mm: _Values, points: _Points, numbers: _Numbers) -> None:
        """Note ``points`` that should lie on the design's ``face``, or on the numbered ones of it."""
        if isinstance(face, StandingWalls):
            off_mm = np.maximum(off_mm - _WALLS_MM, 0.0)
        worst = int(off_mm.argmax())
        if not self.face or off_mm[worst] > self.off_mm:
            x, y, z = points[worst].tolist()
            self.off_mm = float(off_mm[worst])
            self.face = face.names[numbers[worst]]
            self.at_mm = (x, y, z)

    def look(self, face: Designed, points: _Points) -> None:
        """Measure ``points`` that should lie on ``face``, and note them."""
        if len(points):
            off, numbers = face.off_mm(points)
            self.see(face, off, points, numbers)

    def form(self, name: str, body: DesignedBody, limit_um: float, open_edges: int) -> FileForm:
        """The form of the file ``name`` from the points noted."""
        return FileForm(
            name=name,
            off_um=_UM_PER_MM * self.off_mm,
            face=self.face,
            at_mm=self.at_mm,
            limit_um=limit_um,
            open_edges=open_edges,
            lacking=tuple(sorted(body.wanted - self.met)),
        )


def open_edges(triangles: Int[np.ndarray, "t 3"], count: int) -> int:
    """Edges that do not join exactly two triangles of the same sense; ``count``: of the vertices."""
    starts, ends = (vertices.astype(np.int64).ravel() for vertices in (triangles, np.roll(triangles, -1, axis=1)))
    forth = np.sort(starts * count + ends)
    back = np.sort(ends * count + starts)
    if (forth == back).all() and (forth[1:] != forth[:-1]).all():
        return 0  # of one in ten of the time
    senses, times = np.unique(forth, return_counts=True)
    return int(np.sum(times > 1) + np.sum(~np.isin(senses, back)))


def rounding_um(points: _Points) -> float:
    """Largest rounding (um) of points in single precision, as meshes have them."""
    return float(_UM_PER_MM * np.sqrt(3.0) * np.spacing(np.float32(np.abs(points).max())))


@dataclass(frozen=True)
class Chords:
    """Largest chord errors (mm) of flat facets: on optical faces, and on round walls.

    ``rims_mm``: of facet corners on the rims, where the mesh of a custom base cuts across them.
    """

    faces_mm: float
    walls_mm: float
    rims_mm: float = 0.0

    def of(self, face: Designed) -> float:
        """Largest chord error (mm) on a face."""
        return _STATED * (self.walls_mm if isinstance(face, StandingWalls) else self.faces_mm)


@dataclass(frozen=True)
class DesignedFile:
    """A file of the part, the body that it should hold, and the chord errors that its facets may have.

    ``trimmed``: False for faces without edges, which extend beyond those of the design. ``tolerance_um``: of the form
    of its optical faces.
    """

    name: str
    content: bytes
    body: DesignedBody
    chords: Chords
    tolerance_um: float = 0.0
    trimmed: bool = True

    @property
    def limit_um(self) -> float:
        """Largest permitted distance (um) of its points from the design."""
        return FORM_UM + self.tolerance_um

    @property
    def is_step(self) -> bool:
        """True for a STEP file, by its name."""
        return self.name.endswith(".step")

    def is_judged_as(self, other: "DesignedFile") -> bool:
        """True if both should hold one body, with the same permitted distances."""
        return self.body is other.body and (self.chords, self.limit_um) == (other.chords, other.limit_um)
