"""Measures of the manufacturing check: faces and their cutters, walls, edges, tools, and the halves of a mould."""

from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from jaxtyping import Float

from lensforge.cad.part_limits import ANGLE_TOLERANCE_DEG
from lensforge.results import Array, NotNegative, Number, Point, Positive, Record, Share, Text
from lensforge.results.figure import Criterion, Figure

# Parts around the optical faces of a moulded part.
BASE = "base"
FLANGE = "flange"
PLATE = "plate"
FLAT_MM = 1e6  # a radius beyond it is that of a plane


class _FaceClearance(Record):
    """Clearance at one face; ``flush_fraction``: share of the face that the ball reaches with the base unchanged."""

    needs: ClassVar[tuple[str, ...]]  # fields (mm) of what must give way: 0 where clear, None where nothing is reached

    flush_fraction: Share

    @property
    def needed_mm(self) -> float | None:
        """Largest length by which anything must be cut back for the ball; None if the ball reaches nothing."""
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
    """Clearance of the shop's ball at the base below each face; ``note``: why no clearance is needed."""

    faces: dict[Text, AnyClearance]
    note: Text | None = None

    def beyond_shop(self, largest_mm: float | None, shop_mm: float, face: str) -> str:
        """Phrase appended to a face's largest ball if it exceeds the shop's and the face has a base below it.

        ``largest_mm``: None if any ball reaches the face.
        """
        larger = largest_mm is None or largest_mm > shop_mm
        return f" (base: {shop_mm:g} mm ball)" if face in self.faces and larger else ""


FaceMap = Annotated[Float[np.ndarray, "c c"], Array("c", "c", gaps=True)]
FacePoints = Annotated[Float[np.ndarray, "c c 3"], Array("c", "c", 3, gaps=True)]


class Sphere(Record):
    """The sphere of least squares over the area, its centre on the axis, and the face's departure along its normal.

    Of a linear lens it is a cylinder along y.
    """

    radius_mm: Positive
    centre_mm: Point
    pv_mm: NotNegative
    rms_mm: NotNegative

    @property
    def radius_or_plane_mm(self) -> float | str:
        """Radius (mm), or the term for a plane."""
        return self.radius_mm if self.radius_mm < FLAT_MM else "plane"


class Curvature(Record):
    """Principal curvatures seen from the air, concave negative; the radius is None if no point is concave."""

    kappa_min_per_mm: Number
    kappa_max_per_mm: Number
    smallest_concave_radius_mm: Positive | None


FLAT_FOR_TIPS_MM = 1e3  # a radius beyond it is that of a plane for every tip


class Cutter(Record):
    """The ball of ``radius_mm`` on a face, or the nose of a turning tool.

    ``largest_radius_mm``: None if one of any radius reaches the whole face. ``residual_mm``: material left uncut; None
    if the cutter reaches nothing. ``tip``, ``tool``: its names. ``finding``: name of the finding on its radius.
    ``largest_label``: label of the largest radius.
    """

    tip: ClassVar[str] = "ball"
    tool: ClassVar[str] = "mill"
    finding: ClassVar[str] = "cutter"
    largest_label: ClassVar[str] = "largest ball that reaches the whole face"

    radius_mm: Positive
    reachable_fraction: Annotated[
        Share,
        Figure(
            "{Tip} reaches",
            "of the face, radius {radius_mm}",
            key="reached",
            unit="%",
        ),
    ]
    largest_radius_mm: Positive | None
    residual_mm: NotNegative | None

    @property
    def Tip(self) -> str:  # noqa: N802 - begins a label
        """The tip at the beginning of a label."""
        return self.tip.capitalize()

    @property
    def usable_radius_mm(self) -> float | str:
        """The largest radius (mm), or the term for an unlimited one."""
        largest_mm = self.largest_radius_mm
        return "any" if largest_mm is None or largest_mm >= FLAT_FOR_TIPS_MM else largest_mm

    @property
    def room_phrase(self) -> str:
        """Phrase for what limits the radius."""
        nothing = f"no concave region limits the {self.tip}"
        return nothing if isinstance(self.usable_radius_mm, str) else self.largest_label


class TurningTool(Cutter):
    """A turning tool on a face of revolution, its axis at ``tilt_deg`` to the lens's, where it reaches most.

    ``tilt_deg``: below 0 where the shank leans towards the axis. ``largest_radius_mm``: of a nose in concave parts of
    the meridian. ``slope_deg``: the largest angle of a normal of the face to the tool's axis, at the best tilt.
    ``corner_fraction``: the share that the nose misses where the face meets another in a concave corner.
    ``bare_fraction``: the share that it would reach without base and flange.
    """

    tip = "nose"
    tool = "turning tool"
    finding = "nose"
    largest_label = "radius that fits the concave parts of the meridian"

    slope_deg: Annotated[NotNegative, Figure("Max. slope", "to tool axis", key="slope", judged_by="slope")]
    tilt_deg: Annotated[
        Number, Figure("Tilt of the tool", "of the turning tool, below 0 towards the axis", key="lathe_tilt")
    ]
    corner_fraction: Annotated[
        Share, Figure("Fillets", "of the face, left by the nose in corners", key="corner", unit="%")
    ]
    bare_fraction: Share


class Draft(Record):
    """Minimum draft (degrees)."""

    min: Number


def _room_on_face(check: Any, face: Any, name: str) -> str:
    cutter = face.cutter
    return f"{cutter.room_phrase}{check.relief.beyond_shop(cutter.largest_radius_mm, cutter.radius_mm, name)}"


class FaceResult(Record):
    """One optical face as it is cut.

    Maps over its chart, [X, Y], NaN outside: points (mm), departure from the best-fit sphere (mm), principal curvatures
    (1/mm), and uncut height (mm), 0 where the cutter reaches. ``cutter``: None for a face that is not cut, or cannot be
    turned. ``largest_tilt_deg``: least tilt by which an axis reaches all of it; ``free_tilt_deg``: the tilt that
    machine and mouth leave, None if no mill cuts the lens. ``layer_step_um``: the largest height of a step between the
    layers of a print, where these are known.
    """

    cutter: Annotated[
        Cutter | TurningTool | None,
        Figure(
            "Largest {cutter.tip}, {name} face",
            _room_on_face,
            key="{cutter.tip}",
            of="usable_radius_mm",
            digits=3,
            limit=lambda check, face, name: face.cutter.radius_mm,
            sense=">=",
            limit_note="the shop's",
            judged_by="{cutter.finding}",
        ),
    ]
    curvature: Annotated[
        Curvature,
        Figure(
            "Min. concave radius",
            lambda check, face, name: f"in any direction{check.of_insert}",
            key="concave",
            of="smallest_concave_radius_mm",
            missing="none",
        ),
    ]
    layer_step_um: Annotated[NotNegative | None, Figure("Layer steps", "between the layers of the print", key="layers")]
    largest_tilt_deg: Annotated[
        NotNegative,
        Figure(
            "Max. tool tilt",
            "of the axis, where the ball cuts up to its equator",
            key="tilt",
            judged_by="tilt",
            when=lambda check, face, name: type(face.cutter) is Cutter,
        ),
    ]
    free_tilt_deg: NotNegative | None
    draft_deg: Annotated[
        Draft,
        Figure(
            "Draft, {name} face",
            key="draft",
            of="min",
            limit=lambda check, face, name: check.spec.asked_draft_deg(name),
            sense=">=",
            judged_by="draft",
        ),
    ]
    best_fit_sphere: Annotated[
        Sphere,
        Figure(
            "Best-fit sphere",
            lambda check, face, name: f"radius{check.of_drawn}{check.of_insert}",
            key="sphere",
            of="radius_or_plane_mm",
            digits=5,
        ),
        Figure(
            "Departure, PV",
            lambda check, face, name: f"from the best-fit sphere{check.of_insert}",
            key="departure",
            of="pv_mm",
            unit="µm",
        ),
        Figure(
            "Departure, rms",
            lambda check, face, name: f"from it{check.of_insert}",
            key="departure_rms",
            of="rms_mm",
            unit="µm",
        ),
    ]
    area_mm2: Annotated[Positive, Figure("Area", lambda check, face, name: f"of the {check.cut_body}", key="area")]
    undercut_fraction: Share
    xyz: FacePoints
    sag_mm: FaceMap
    kappa_min: FaceMap
    kappa_max: FaceMap
    residual_mm: FaceMap


class FaceFaults(Record):
    """Places at which a ``face`` cannot be made as designed.

    ``places_mm``: worst place of each finding, on the lens, by the finding's name. ``kinds``: what is in the way, by
    the numbers of :class:`~lensforge.shop.face_faults.Fault`, over the chart of the face, NaN outside.
    """

    face: Text
    places_mm: dict[Text, Point]
    kinds: FaceMap


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
    angle_deg: Annotated[
        Number,
        Figure(
            lambda check, edge: edge.pair.capitalize(),
            lambda check, edge: f"minimum along their edge, in {check.body_at(edge)}",
            key=lambda check, edge: f"edge_{check.face_of(edge)}",
        ),
        Criterion(
            ">=",
            lambda check, edge: check.spec.constraints.min_edge_angle_deg,
            "least angle of the edge",
            "lower constraints.min_edge_angle_deg, or give the last level more steps",
            name="edge of {pair}",
            tolerance=ANGLE_TOLERANCE_DEG,
            unit="deg",
        ),
    ]
    point_mm: Point

    @property
    def pair(self) -> str:
        """Names of the two faces."""
        return " and ".join(self.faces)


class MouldedFace(Record):
    """An optical face by the two halves of a mould that opens along the axis.

    Shares of its area that each half releases, and that neither does; heights (mm) between which that lies.
    ``draft_deg``: the minimum over what is released, from the half that does; None if nothing is.
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

    ``gate``: the piece at whose side it can be filled, away from optical faces; None if it has none. ``cooling_s``:
    estimate for a slab as thick as the ball; None for a material that cures, or whose heat is not known.
    """

    faces: dict[Text, MouldedFace]
    parting: PartingLine
    thickest: InscribedBall
    upright: tuple[UprightCylinder, ...] = ()
    gate: Literal["flange", "base", "plate"] | None
    cooling_s: NotNegative | None
