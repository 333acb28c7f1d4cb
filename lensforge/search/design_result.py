"""The result of the design stage: the lens, the history of its search, its constraints, and progress of a search.

Constraints are the paper's three, Eqs. (10) to (14), and for manufacture and assembly those that the spec sets, each by
name, with its tolerance and the criterion on its margin. No tracer is loaded: a record of a search is held against them
wherever it is read.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from math import isnan, nan
from operator import attrgetter
from statistics import stdev
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, get_args

import numpy as np
from jaxtyping import Float
from pydantic import Field

from lensforge.optics.face_roles import BODY, CAVITY, FaceRole, bounding
from lensforge.public import public
from lensforge.results import (
    Count,
    Fact,
    Given,
    Group,
    Metric,
    NotNegative,
    Number,
    Point,
    Positive,
    Record,
    StageResult,
    Text,
)
from lensforge.results.arguments import require_choice
from lensforge.results.criteria import Criteria, at_least
from lensforge.results.figure import Figure, facts_in, figure
from lensforge.results.numerals import quantity
from lensforge.results.plots import plot_curves
from lensforge.scene.lens import Lens
from lensforge.sources.source_summary import SourceSummary
from lensforge.spec import AnyAccuracy, Spec
from lensforge.spec.lens_section import LensShape
from lensforge.surfaces.srbf import MOST_LEVELS

if TYPE_CHECKING:
    from matplotlib.axes import Axes


Quantity = Literal["nmse", "loss", "efficiency"]


class Margins(Record):
    """Margins by which a lens keeps its constraints, Eqs. (10) to (14), at the worst point; negative where it does not.

    ``cavity_clearance_mm``: height of the inner surface above the cavity's paraboloid. ``wall_margin_mm``: wall
    thickness above the minimum. ``radius_margin_mm``: from the outer surface to the largest radius. Where the spec
    limits them, of each face by its name: curvature left before a concave region is as tight as the ball, and draft
    above the minimum; by the first face of each medium: the angle of its edges above the least.
    ``largest_wall_margin_mm``: wall thickness below the largest; ``height_margin_mm``: from the outer surface up to the
    largest height; ``keep_out_clearance_mm``: from the keep-out, grown by its margin, outwards to the inner surface
    along the ray from the origin. ``flange_margin_mm``: height of the cylinder at the rim beyond what its flange needs.
    ``opening_margin_mm``: of a mirror over its opening, along rays about the axis, which is to meet the opening.
    """

    cavity_clearance_mm: Number
    wall_margin_mm: Number
    radius_margin_mm: Number
    curvature_margin_per_mm: Annotated[dict[str, Number], Field(default_factory=dict)]
    draft_margin_deg: Annotated[dict[str, Number], Field(default_factory=dict)]
    edge_margin_deg: Annotated[dict[str, Number], Field(default_factory=dict)]
    largest_wall_margin_mm: Number | None = None
    height_margin_mm: Number | None = None
    keep_out_clearance_mm: Number | None = None
    flange_margin_mm: Number | None = None
    opening_margin_mm: Number | None = None

    @staticmethod
    def of(measured: Mapping["Limit", float]) -> "Margins":
        """The margins of the limits that were ``measured``."""
        margins: dict[str, Any] = {}
        for limit, margin in measured.items():
            if limit.of_one_face:
                margins.setdefault(limit.kind, {})[limit.names[0]] = margin
            else:
                margins[limit.kind] = margin
        return Margins.model_validate(margins)

    def at(self, limit: "Limit") -> float:
        """The margin of ``limit``; NaN where it was not measured."""
        margin = getattr(self, limit.kind)
        margin = margin.get(limit.names[0]) if limit.of_one_face else margin
        return nan if margin is None else float(margin)


class Level(Record):
    """History of one level of the search: a value for each step; ``constraints`` by the keys of the limits."""

    level: Count
    functions: Count
    loss: tuple[Number, ...]
    nmse: tuple[NotNegative, ...]
    efficiency: tuple[Number, ...]
    constraints: dict[str, tuple[Number, ...]]


class Start(Record):
    """One of several searches, by its seed: the light of its lens on the first receiver.

    ``merit``: mean of the NMSE over all receivers; without noise, so that it may be below 0. ``missed``: number of
    constraints and limits that the lens misses. ``size_mm``: of the smallest lens, where that is sought.
    """

    seed: Count
    nmse: Metric
    efficiency: Metric
    merit: Number
    missed: Count
    seconds: NotNegative
    size_mm: Positive | None = None

    @property
    def rank(self) -> tuple[int, float, float]:
        """Order of the starts, the best first."""
        return self.missed, self.size_mm or 0.0, self.merit

    @property
    def phrase(self) -> str:
        """The figures in a line."""
        missed = f", {self.missed} constraints or limits missed" if self.missed else ""
        size = "" if self.size_mm is None else f", size {quantity(self.size_mm, 'mm')}"
        return f"NMSE {self.nmse}, efficiency {self.efficiency}{size}{missed}"


class TriedSize(Record):
    """A size within which a search for the smallest lens has looked for one: ``within_mm``, the bound of its lens.

    ``size_mm``: of the lens. ``margin``: of its limit on the light that is nearest to its bound, relative to that, with
    its ``standard_error``; negative where the bound is missed. ``holds``: all limits are kept, also of the lens's
    shape. ``why``: the reason why there is no such lens; it then has none of these figures.
    """

    within_mm: Positive
    holds: bool
    size_mm: Positive | None = None
    margin: Number | None = None
    standard_error: NotNegative | None = None
    why: Text = ""


def _searches_within(design: Any) -> str:
    """The size that is sought, by how many searches, and the next smaller one within which no lens holds all limits."""
    least_mm = design.least_mm
    below = [
        size.within_mm for size in design.sizes if not size.holds and (least_mm is None or size.within_mm < least_mm)
    ]
    missed = f"; no lens within {quantity(max(below), 'mm')} holds all limits" if below else ""
    count = len(design.sizes)
    searches = f"{count} searches" if count > 1 else "one search"
    return f"{design.lens.spec.optimise.size}, by {searches}{missed}"


_COST_OF_LIGHT = 0.005
_COST_OF_PATTERN = 0.1
COSTS = "tool costs"  # what a run says while it measures them


class ToolCost(Record):
    """Cost of a ``limit`` that tools set to a lens, named in words, against a spec that has another value ``instead``.

    ``efficiency``: share of the light that it costs. ``nmse``, ``nmse_without``: the pattern error with it, and
    without; None for a target without one.
    """

    limit: Text
    instead: Text
    efficiency: Number
    nmse: Number | None = None
    nmse_without: Number | None = None

    @property
    def matters(self) -> bool:
        """True where it costs more than half a point of the light, or a tenth of the pattern error."""
        if self.nmse is None or self.nmse_without is None:
            return self.efficiency > _COST_OF_LIGHT
        return self.efficiency > _COST_OF_LIGHT or self.nmse_without < (1.0 - _COST_OF_PATTERN) * self.nmse

    @property
    def fact(self) -> Fact:
        """The cost as a fact; its note says by what it was measured."""
        errors = "" if self.nmse is None else f"NMSE {self.nmse:.3g} with it, {self.nmse_without:.3g} without; "
        note = f"of the light; {errors}against {self.instead}, by a short search"
        key = f"cost_of_{self.limit.split()[0]}"
        return Fact.share(key, f"Cost of the {self.limit}", self.efficiency, note, digits=2)


@public
class Design(StageResult):
    """A finished search.

    ``lens``: the lens that was found. ``steps``: gradient steps of all levels. ``rays_per_step``: rays of the last of
    them. ``seconds``: of the search, set-up included. ``max_radius_mm``, ``height_mm``: of the outer surface.
    ``constraints``: margin to each limit, negative where it is missed. ``source``: the source as it was read.
    ``source_outline_mm``: a polygon around the emitting area. ``history``: figures of every step, by level. ``ended``:
    why a search that chooses its levels went no further, and where it did not gain: it then has the better lens of
    before. ``kept_start``: it ended with the lens from which it began. ``starts``: all searches of which this was the
    best, where there were several. ``tool_costs``: of the limits that tools set, where a face is at one of them; a
    whole run measures them. ``sizes``: all that were tried for the smallest lens, in the order of the searches.
    """

    stage: ClassVar[str] = "design"
    omit_if_empty: ClassVar[tuple[str, ...]] = ("tool_costs", "sizes")
    made_from: ClassVar[tuple[str, ...]] = ("lens", "spec")

    lens: Annotated[Lens, Given()]
    steps: Count
    rays_per_step: Count
    seconds: NotNegative
    max_radius_mm: Annotated[
        Positive,
        Figure(
            "Outer radius",
            lambda design: _widest(design.lens.spec),
            key="radius",
            limit=lambda design: design.lens.spec.constraints.max_radius_mm,
            judged_by="radius margin",
        ),
    ]
    height_mm: Annotated[
        Positive,
        Figure(
            "Height above the LED",
            "without the base",
            limit=lambda design: design.lens.spec.constraints.max_height_mm,
            judged_by="height margin",
        ),
    ]
    constraints: Annotated[
        Margins,
        Figure(
            "Cavity clearance",
            lambda design: _dome(design.lens.spec),
            key="cavity",
            of="cavity_clearance_mm",
            judged_by="cavity clearance",
        ),
    ]
    source: SourceSummary
    source_outline_mm: tuple[Point, ...]
    history: Annotated[tuple[Level, ...], Field(max_length=MOST_LEVELS)]
    ended: Text | None = None
    kept_start: bool = False
    starts: tuple[Start, ...] = ()
    tool_costs: tuple[ToolCost, ...] = ()
    sizes: tuple[TriedSize, ...] = ()
    criteria: Criteria = ()

    def judge(self) -> Criteria:
        """Make the criteria on the margins of its lens."""
        return constraint_criteria(self.lens.spec, self.constraints)

    def follows(self) -> Iterator[tuple[str, float, float]]:
        """Steps by the history."""
        yield "steps", self.steps, sum(len(level.loss) for level in self.history)

    @property
    @figure(
        Figure(
            "Least size",
            _searches_within,
            key="least_size",
            missing="no size holds all limits",
            when=lambda design: bool(design.sizes),
        )
    )
    def least_mm(self) -> float | None:
        """Size of the smallest lens that holds all limits; None if none does, or if it was not sought."""
        return min((tried.size_mm for tried in self.sizes if tried.holds and tried.size_mm), default=None)

    @property
    def spread(self) -> float | None:
        """Standard deviation of the merit over the starts; None for a single one."""
        return stdev(start.merit for start in self.starts) if len(self.starts) > 1 else None

    def plot(self, axes: "Axes | None" = None, *, quantity: Quantity = "nmse") -> "Axes":
        """``quantity`` at every step of the search, one line for each level.

        Raises :class:`InputError` for an unknown one.
        """
        require_choice("quantity", quantity, get_args(Quantity))
        curves = {}
        start = 1
        for level in self.history:
            values = getattr(level, quantity)
            label = f"{level.functions} functions"
            curves[f"{label} again" if label in curves else label] = (range(start, start + len(values)), values)
            start += len(values)
        return plot_curves(curves, ("step", quantity), axes, (False, quantity == "nmse"))


@public
@dataclass(frozen=True)
class Progress:
    """State of a search after a gradient step.

    Fields:
        level (int): Number of the level, from 0.
        step (int): Number of the step in it.
        steps_done (int): Of all levels.
        steps_total (int): Of all levels; of automatic ones until the end of this stage.
        nmse (float): By the rays of this step.
        efficiency (float): By the rays of this step.
        functions (int): Number per face that move in this level.
        level_done (bool): This was its last step, and the level is kept; ``lens()`` is then the best of it.
        seconds (float, s): Of the search so far, set-up included.
        accuracy ('draft' or 'standard' or 'reference' or Preset): That of the search.
        lens (Callable): A function that builds the lens of the current parameters.
        images (tuple of array [_, _]): Flux (W) on the pixels of each receiver by the rays of this step, [row y,
            column x]; of several LEDs the first's.
        tables (Callable or None): A function that makes the tables of the faces of ``lens()``, as the search traces
            them, and their grid.
        within (str): Size within which this search looks, such as "height 9 mm", where it is one of several for the
            smallest lens.
    """

    level: int
    step: int
    steps_done: int
    steps_total: int
    nmse: float
    efficiency: float
    functions: int
    level_done: bool
    seconds: float
    accuracy: AnyAccuracy
    lens: Callable[[], Lens]
    images: tuple[Float[np.ndarray, "_ _"], ...] = ()
    tables: Callable[[], Any] | None = None
    within: str = ""


# Called after every gradient step. A search stops where its observer returns False; where that returns ENOUGH, it ends
# with the lens that it has, as if its steps were over.
Observer = Callable[[Progress], object]
ENOUGH = "enough"


DIRECTIONS = 60_000  # over the hemisphere, at which the lengths of a finished lens are measured
# What counts as feasible in the finished lens, relative to the cutter's curvature, and in degrees.
_CURVATURE_TOLERANCE = 1e-3
_ANGLE_TOLERANCE_DEG = 0.01
_SPARES = 3.0  # tolerances of a curvature or a draft by which a search ends inside the limit


@dataclass(frozen=True)
class Limit:
    """A margin of ``faces`` that must be at least 0, but for ``tolerance``; ``kind``: its field of :class:`Margins`.

    ``given``: the value of the spec (mm or degrees), of a keep-out its margin. ``spare``: margin with which a search
    ends, as the manufacturing check looks at other points, of the faces as they are in the file. ``is_stated``: False
    for what the process asks of a face, which a record of before it was kept does not have.
    """

    kind: str
    faces: tuple[FaceRole, ...]
    unit: str
    tolerance: float
    remedy: str
    given: float
    spare: float
    is_stated: bool

    def missed_by(self, margin: float) -> float:
        """Tolerances by which a search that ends with ``margin`` misses the limit; at most 1 where it is kept."""
        return (self.spare - margin) / self.tolerance

    @property
    def names(self) -> tuple[str, ...]:
        """Names of its faces."""
        return tuple(face.name for face in self.faces)

    @property
    def of_one_face(self) -> bool:
        """True for a limit that any face may have for itself, and for that of the edges of a medium's faces."""
        return self.kind in _OF_ONE_FACE

    @property
    def key(self) -> str:
        """Its name in the history of a search; it ends with the unit."""
        return f"{self.names[0]}_{self.kind}" if self.of_one_face else self.kind

    @property
    def name(self) -> str:
        """Name of its criterion."""
        return self.key.removesuffix("_per_mm").removesuffix("_mm").removesuffix("_deg").replace("_", " ")


FLANGE_ROOM = "flange_margin_mm"
OPENING_ROOM = "opening_margin_mm"
CURVATURE, DRAFT, EDGE = _OF_ONE_FACE = ("curvature_margin_per_mm", "draft_margin_deg", "edge_margin_deg")
# Media whose faces a limit concerns.
ON_CAVITY = (CAVITY,)
ON_ENVELOPE = (BODY,)
ON_BOTH = (CAVITY, BODY)
_SHARP = "lower {field} or take more steps"
# The kind of a margin, the media whose faces it concerns, the field that sets its limit, and what to do where it is
# missed, with the first face of each medium.
_LIMITS = (
    (
        "cavity_clearance_mm",
        ON_CAVITY,
        "constraints.cavity_height_mm",
        "raise lens.{0}.offset_mm or lower constraints.cavity_*",
    ),
    ("wall_margin_mm", ON_BOTH, "constraints.min_thickness_mm", "raise lens.{1}.offset_mm or lower {field}"),
    ("radius_margin_mm", ON_ENVELOPE, "constraints.max_radius_mm", "raise {field} or lower lens.{0}.offset_mm"),
    (CURVATURE, (), "concave_radius_mm", "lower lens.{0}.{field}, or the tool's radius, or raise lens.{0}.offset_mm"),
    (DRAFT, (), "draft_deg", "lower lens.{0}.{field} or take more steps"),
    *((EDGE, media, "constraints.min_edge_angle_deg", _SHARP) for media in (ON_CAVITY, ON_ENVELOPE)),
    (FLANGE_ROOM, ON_ENVELOPE, "lens.flange_room_mm", "lower lens.flange.thickness_mm or take more steps"),
    (OPENING_ROOM, ON_CAVITY, "lens.opening_mm", "take more steps, or lower lens.mouth.offset_mm"),
    ("largest_wall_margin_mm", ON_BOTH, "constraints.max_wall_mm", "raise {field} or lens.{0}.offset_mm"),
    ("height_margin_mm", ON_ENVELOPE, "constraints.max_height_mm", "raise {field} or lower lens.{0}.offset_mm"),
    ("keep_out_clearance_mm", ON_CAVITY, "constraints.keep_out", "raise lens.{0}.offset_mm or lower {field}_margin_mm"),
)


def limits_of(spec: Spec) -> tuple[Limit, ...]:
    """The limits of ``spec``: the paper's three, and the optional ones that it has."""
    limits = []
    constraints = spec.constraints
    for kind, faces, field, remedy in _limits_of_faces(spec.lens):
        of_face = kind in (CURVATURE, DRAFT)
        source = spec.face_limits(faces[0].name) if of_face else spec
        if (given := attrgetter(field)(source)) is None:
            continue
        unit = "mm"
        tolerance = constraints.tolerance_mm
        if kind == CURVATURE:
            unit = "1/mm"
            tolerance = _CURVATURE_TOLERANCE / given
        elif kind in (DRAFT, EDGE):
            unit = "deg"
            tolerance = _ANGLE_TOLERANCE_DEG
        value = constraints.keep_out_margin_mm if field.endswith("keep_out") else given
        spare = _SPARES * tolerance if of_face and spec.lens.fixed[faces[0].name] is None else 0.0
        is_stated = not of_face or getattr(spec.lens.faces[faces[0].name], field) is not None
        limits.append(Limit(kind, faces, unit, tolerance, remedy, value, spare, is_stated))
    return tuple(limits)


def _limits_of_faces(lens: LensShape) -> Iterator[tuple[str, tuple[FaceRole, ...], str, str]]:
    """Kind, faces, field and remedy of each limit that a lens of these faces may have.

    A limit of one face names it first, and then those that bound the same medium: it holds where that face does.
    """
    for kind, media, field, remedy in _LIMITS:
        if media:
            faces = tuple(dict.fromkeys(sum((bounding(lens.body_roles, medium) for medium in media), ())))
            yield kind, faces, field, remedy.format(*_first_faces(lens, media), field=field)
            continue
        for role in lens.roles:
            neighbours = (neighbour for neighbour in bounding(lens.body_roles, role.before) if neighbour != role)
            yield kind, (role, *neighbours), field, remedy.format(role.name, field=field)


def _first_faces(lens: LensShape, media: tuple[str, ...]) -> list[str]:
    """Name of the first face of each medium, by which a limit is kept; of one that follows another that one.

    How large a body is whose first face follows another, the next says: the mouth of a reflector.
    """
    bounds = [bounding(lens.body_roles, medium) for medium in media]
    if len(media) == 1:
        return [next(role.name for role in bounds[0] if role.follows is None)]
    return [faces[0].follows or faces[0].name for faces in bounds]


def constraint_criteria(spec: Spec, measured: Margins) -> Criteria:
    """One criterion for each limit of ``spec``: at least 0 but for its tolerance; NaN where it was not measured."""
    return tuple(
        at_least(limit.name, measured.at(limit), 0.0, limit.unit, limit.remedy, limit.tolerance)
        for limit in limits_of(spec)
        if limit.is_stated or not isnan(measured.at(limit))
    )


def design_facts(design: Design) -> list[Group]:
    """Groups of the lens, of the search, and of its starts where there were several."""
    groups = [
        Group("lens", "Lens", tuple(facts_in(design, design.criteria))),
        Group("search", "Search", tuple(_search(design))),
    ]
    if design.tool_costs:
        groups.append(Group("costs", "Costs of the tools", tuple(cost.fact for cost in design.tool_costs)))
    return groups if design.spread is None else [*groups, Group("starts", "Starts", tuple(_starts(design)))]


def _widest(spec: Spec) -> str:
    """The distance that is the radius of a lens, in words."""
    if not spec.lens.radius_about_axis:
        return "max. distance from the LED, without the base"
    without = "without the base" if spec.lens.flange_room_mm is None else "without base and flange"
    return f"max. distance from the axis, {without}"


def _dome(spec: Spec) -> str:
    limits = spec.constraints
    high = quantity(limits.cavity_height_mm, "mm")
    wide = quantity(2.0 * limits.cavity_radius_mm, "mm")
    return f"to a dome over the LED, {high} high, {wide} wide"


def _search(design: Design) -> Iterator[Fact]:
    if design.kept_start:
        yield Fact("kept_start", "Search", "no gain", note=design.ended or "")
    yield Fact("steps", "Steps", design.steps, note=design.ended or "")
    yield Fact("levels", "Levels", len(design.history))
    yield Fact(
        "functions", "Functions", design.history[-1].functions if design.history else None, note="of each surface"
    )


def _starts(design: Design) -> Iterator[Fact]:
    best, following, *_ = sorted(design.starts, key=lambda start: start.rank)
    scatter = Fact("spread", "Standard deviation of the merit", design.spread, digits=2)
    yield Fact("kept", "Kept", f"seed {best.seed} of {len(design.starts)}", note=f"{scatter.label} {scatter.text}")
    yield Fact("next", "Next", f"seed {following.seed}", note=following.phrase)
