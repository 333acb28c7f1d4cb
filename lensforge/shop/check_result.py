"""The result of the manufacturing check: faces, wall, clearance of the ball at the base, tools, and findings."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated, ClassVar, Literal

import numpy as np
from jaxtyping import Float
from pydantic import ConfigDict, model_validator

from lensforge.public import public
from lensforge.results import Array, Fact, NotNegative, Number, Point, Positive, Record, Sense, Share, Text
from lensforge.results.arguments import require_choice
from lensforge.results.criteria import Criteria
from lensforge.results.fact import StoredAs
from lensforge.results.notebook_html import screenful
from lensforge.results.plots import Axes, plot_face
from lensforge.results.stage_result import SimulatedResult
from lensforge.spec.part_section import Process


class _FaceClearance(Record):
    """Clearance at one face; ``flush_fraction``: share of the face that the ball reaches with the base as it is."""

    needs: ClassVar[tuple[str, ...]]  # fields (mm) of what must give way: 0 where clear, None where nothing is reached

    flush_fraction: Share

    @property
    def needed_mm(self) -> float | None:
        """The largest of what must give way to the ball; None where the ball reaches nothing."""
        lengths = [getattr(self, name) for name in self.needs]
        return None if None in lengths else max(lengths)


class StepClearance(_FaceClearance):
    """At a face of the envelope: the step that the base needs to clear the ball, and its wall's setback.

    ``flange_clearance_mm``: how much lower the top of the flange must be, 0 where there is no flange.
    """

    needs = ("smallest_step_mm", "step_clearance_mm", "flange_clearance_mm")

    smallest_step_mm: NotNegative | None
    step_clearance_mm: NotNegative | None
    flange_clearance_mm: NotNegative | None


class BoreClearance(_FaceClearance):
    """At a face of the cavity: radius that the bore needs beyond the cavity's, and diameter of the pocket."""

    needs = ("bore_clearance_mm", "pocket_diameter_mm")

    bore_clearance_mm: NotNegative | None
    pocket_diameter_mm: NotNegative | None


class CustomBaseClearance(_FaceClearance):
    """Largest depth of a custom base in the ball."""

    needs = ("retreat_mm",)

    retreat_mm: NotNegative | None


AnyClearance = StepClearance | BoreClearance | CustomBaseClearance


class BallClearance(Record):
    """Clearance of the shop's ball at the base below each face; ``note``: why there is nothing to clear."""

    faces: dict[Text, AnyClearance]
    note: Text | None = None

    def beyond_shop(self, largest_mm: float | None, shop_mm: float, face: str) -> str:
        """Words behind a face's largest ball, where it is larger than the shop's and there is a base to meet.

        ``largest_mm``: None where any ball reaches the face.
        """
        larger = largest_mm is None or largest_mm > shop_mm
        return f" (base: {shop_mm:g} mm ball)" if face in self.faces and larger else ""


FaceMap = Annotated[Float[np.ndarray, "c c"], Array("c", "c", gaps=True)]
FacePoints = Annotated[Float[np.ndarray, "c c 3"], Array("c", "c", 3, gaps=True)]
OfMill = Literal["cutter", "relief", "tilt", "tool", "gap"]
OfLathe = Literal["nose", "slope", "turning", "corner"]
FindingName = OfMill | OfLathe | Literal["layer", "wall", "draft", "undercut", "plate"]
BODY = "body"  # the place of a finding on none of the faces
BASE, FLANGE, PLATE = "base", "flange", "plate"  # what stands around the optical faces of a moulded part
FLAT_MM = 1e6  # a radius beyond it is that of a plane
# Question, sense and unit of each finding.
FINDINGS: dict[str, tuple[str, Sense, str]] = {
    "cutter": ("Ball reaches the face", "<=", "mm"),
    "nose": ("Nose fits the face", "<=", "mm"),
    "slope": ("Flanks clear the face", "<=", "deg"),
    "turning": ("Tool reaches the face", ">=", "of the face"),
    "corner": ("Fillets small enough", "<=", "of the face"),
    "layer": ("Layers fine enough", "<=", "µm"),
    "relief": ("Base clears the ball", "<=", "mm"),
    "tilt": ("Tool tilt within limit", "<=", "deg"),
    "wall": ("Wall thick enough", ">=", "mm"),
    "draft": ("Draft large enough", ">=", "deg"),
    "undercut": ("Mould releases the face", "<=", "of the face"),
    "tool": ("Tool reaches the face", ">=", "of the face"),
    "gap": ("Ball fits between lenses", "<=", "mm"),
    "plate": ("Plate walls thick enough", ">=", "mm"),
}


def as_finding(fact: Fact) -> Fact:
    """The fact as a statement on what the shop can do with this lens, whose note says why.

    Its key is a :data:`FindingName`, its place a face or :data:`BODY`. Without a value the ball reaches nothing;
    without a limit there is none, as for a face that any ball reaches.
    """
    if fact.key not in FINDINGS:
        raise ValueError(f"name: must be one of {', '.join(FINDINGS)}")
    question, _, _ = FINDINGS[fact.key]
    return replace(fact, label=question).judged()


_NAMES = {name: name for name in ("value", "sense", "limit", "unit", "tolerance")}
_STORED = StoredAs(
    _NAMES | {"name": "key", "surface": "place", "reason": "note", "remedy": "remedy", "holds": "holds"}, as_finding
)
Findings = tuple[Annotated[Fact, _STORED], ...]


class Sphere(Record):
    """The sphere of least squares over the area, its centre on the axis, and the face's departure along its normal."""

    radius_mm: Positive
    centre_mm: Point
    pv_mm: NotNegative
    rms_mm: NotNegative

    @property
    def radius_or_plane(self) -> float | str:
        """The radius (mm), or the word for that of a plane."""
        return self.radius_mm if self.radius_mm < FLAT_MM else "plane"


class Curvature(Record):
    """Principal curvatures seen from the air, concave negative; the radius is None where no point is concave."""

    kappa_min_per_mm: Number
    kappa_max_per_mm: Number
    smallest_concave_radius_mm: Positive | None


class Cutter(Record):
    """The ball of ``radius_mm`` on a face, or the nose of a turning tool.

    ``largest_radius_mm``: None where one of any radius reaches the whole face. ``residual_mm``: material left
    uncut; None where the cutter reaches nothing. ``tip``, ``tool``: words for it.
    """

    tip: ClassVar[str] = "ball"
    tool: ClassVar[str] = "mill"

    radius_mm: Positive
    reachable_fraction: Share
    largest_radius_mm: Positive | None
    residual_mm: NotNegative | None


class TurningTool(Cutter):
    """A turning tool on a face of revolution, its axis at ``tilt_deg`` to the lens's, where it reaches most.

    ``tilt_deg``: below 0 where the shank leans towards the axis. ``largest_radius_mm``: of a nose in concave parts
    of the meridian. ``slope_deg``: the largest angle of a normal of the face to the tool's axis, at the best tilt.
    ``corner_fraction``: the share that the nose misses where the face meets another in a concave corner.
    ``bare_fraction``: the share that it reaches where neither base nor flange is in its way.
    """

    tip = "nose"
    tool = "turning tool"

    slope_deg: NotNegative
    tilt_deg: Number
    corner_fraction: Share
    bare_fraction: Share


class Draft(Record):
    """Minimum draft (degrees)."""

    min: Number


class FaceResult(Record):
    """One optical face as it is cut.

    Maps over its chart, [X, Y], NaN outside: points (mm), departure from the best-fit sphere (mm), principal curvatures
    (1/mm), and uncut height (mm), 0 where the cutter reaches. ``cutter``: None of a face that is not cut, or cannot be
    turned. ``layer_step_um``: the largest height of a step between the layers of a print, where these are known.
    """

    best_fit_sphere: Sphere
    curvature: Curvature
    cutter: Cutter | TurningTool | None
    layer_step_um: NotNegative | None
    draft_deg: Draft
    undercut_fraction: Share
    largest_tilt_deg: NotNegative
    area_mm2: Positive
    xyz: FacePoints
    sag_mm: FaceMap
    kappa_min: FaceMap
    kappa_max: FaceMap
    residual_mm: FaceMap


class Wall(Record):
    """One place of the wall, the thinnest or the thickest: its points on the cavity, and on the envelope."""

    thickness_mm: Number
    cavity_point_mm: Point
    envelope_point_mm: Point


class Walls(Record):
    """The shortest line between cavity and envelope, and the longest part of a ray from the origin between them."""

    thinnest: Wall
    thickest: Wall


class ToolReach(Record):
    """Shares of a face that a tool reaches: its ball alone, along the axis, and tilted as far as the spec allows."""

    ball_reachable_fraction: Share
    reachable_fraction_untilted: Share
    reachable_fraction: Share


class ToolResult(Record):
    """One tool of the spec on every face."""

    name: Text
    radius_mm: Positive
    shank_radius_mm: Positive
    length_mm: Positive
    holder_half_angle_deg: NotNegative
    faces: dict[Text, ToolReach]


class Edge(Record):
    """The crease of two ``faces``: the least angle (degrees) between them, and where.

    Of the wedge that is an edge: the lens at its rim, and the core of the mould at its cavity.
    """

    faces: tuple[Text, Text]
    angle_deg: Number
    point_mm: Point

    @property
    def criterion(self) -> str:
        """Name of the criterion on its angle."""
        return "edge of " + " and ".join(self.faces)


class MouldedFace(Record):
    """An optical face by the two halves of a mould that opens along the axis.

    Shares of its area that each half releases, and that neither does; heights (mm) between which that lies.
    ``draft_deg``: the minimum over what is released, from the half that does; None where nothing is.
    """

    upper_fraction: Share
    lower_fraction: Share
    undercut_fraction: Share
    undercut_heights_mm: tuple[Number, Number] | None = None
    draft_deg: NotNegative | None


class PartingLine(Record):
    """The line in which the halves meet, around the body: its largest distance from the axis, and its heights.

    ``places``: names of the faces on which it lies, or "base" or "flange". Of a plate it is the edge of its top, which
    has no one distance.
    """

    places: tuple[Text, ...]
    radius_mm: Positive | None
    low_mm: Number
    high_mm: Number


class InscribedBall(Record):
    """The largest ball within the part."""

    diameter_mm: NotNegative
    centre_mm: Point


class UprightCylinder(Record):
    """A cylinder about the axis without draft, between two heights."""

    radius_mm: Positive
    low_mm: Number
    high_mm: Number


class Mould(Record):
    """The part as it is moulded: its faces by the halves of the mould, their parting, and its thickest place.

    ``upright``: what the flange leaves of the cylinder at which it begins, below its underside and above its top.

    ``gate``: the piece at whose side it can be filled, away from optical faces; None where it has none. ``cooling_s``:
    estimate for a slab as thick as the ball; None for a material that cures, or whose heat is not known.
    """

    faces: dict[Text, MouldedFace]
    parting: PartingLine
    thickest: InscribedBall
    upright: tuple[UprightCylinder, ...] = ()
    gate: Literal["flange", "base", "plate"] | None
    cooling_s: NotNegative | None


@public
class Check(SimulatedResult):
    """Manufacturing check. Beside its fields it has one for each face, by its name.

    ``process``: by which the part is made. ``scale``: of the faces that are cut against the lens's, 1 + shrinkage for a
    mould insert; faces and ``tools`` are of these. ``min_wall_mm``: thinnest wall of the lens. ``walls``: thinnest and
    thickest wall of the lens, with their places. ``relief``: clearance of the shop's ball at the base. ``tools``: how
    much of each face each tool reaches. ``edges``: the sharpest place of each edge. ``mould``: halves, parting line,
    gate and cooling of a part that is moulded. ``criteria``: those of the design. ``verdicts``: findings for the shop,
    each with what to change. ``chart_axis``: places of the nodes of all maps along either axis.
    """

    __pydantic_extra__: dict[str, FaceResult]
    model_config = ConfigDict(extra="allow")
    stage: ClassVar[str] = "check"
    omit_if_empty: ClassVar[tuple[str, ...]] = ("edges", "mould", "conditions")

    process: Process
    scale: Positive
    min_wall_mm: Number
    walls: Walls
    relief: BallClearance
    tools: tuple[ToolResult, ...]
    edges: tuple[Edge, ...] = ()
    mould: Mould | None = None
    criteria: Criteria
    verdicts: Findings
    seconds: NotNegative
    chart_axis: Annotated[Float[np.ndarray, " c"], Array("c")]

    def follows(self) -> Iterator[tuple[str, float, float]]:
        """The thinnest wall by its place."""
        yield "min_wall_mm", self.min_wall_mm, self.walls.thinnest.thickness_mm

    @property
    def faces(self) -> dict[str, FaceResult]:
        """Faces by name, from the source on."""
        return self.__pydantic_extra__

    @model_validator(mode="after")
    def _of_these_faces(self) -> "Check":
        named = {name for tool in self.tools for name in tool.faces} | set(self.relief.faces)
        unknown = (named | {finding.place for finding in self.verdicts} - {BODY}) - set(self.faces)
        if unknown or not self.faces:
            own = ", ".join(self.faces) or "none"
            raise ValueError(f"faces: {own}; tools and findings are on {', '.join(sorted(unknown)) or 'none'}")
        for name, face in self.faces.items():
            if len(face.sag_mm) != len(self.chart_axis):
                raise ValueError(
                    f"{name}.sag_mm: shape {face.sag_mm.shape}, must be of the {len(self.chart_axis)} nodes"
                )
        return self

    def __str__(self) -> str:
        return screenful([f"{'yes' if each.holds else 'no '} {each.key}: {each.note}" for each in self.verdicts])

    def plot(
        self,
        axes: "Axes | None" = None,
        *,
        surface: str | None = None,
        quantity: Literal["sag_mm", "kappa_min", "kappa_max", "residual_mm"] = "sag_mm",
    ) -> "Axes":
        """``quantity`` of one face over its chart, by default the last face.

        Raises :class:`InputError` for an unknown face or quantity.
        """
        labels = {
            "sag_mm": "departure from the best-fit sphere (mm)",
            "kappa_min": "smaller principal curvature (1/mm)",
            "kappa_max": "larger principal curvature (1/mm)",
            "residual_mm": "uncut height (mm)",
        }
        require_choice("quantity", quantity, labels)
        surface = require_choice("surface", surface or next(reversed(self.faces), None), self.faces)
        values, half_width = getattr(self.faces[surface], quantity), float(self.chart_axis[-1])
        return plot_face(values, half_width, f"{surface}: {labels[quantity]}", axes)
