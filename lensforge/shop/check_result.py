"""The result of the manufacturing check: faces, wall, clearance of the ball at the base, tools, and findings."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Annotated, ClassVar, Literal

import numpy as np
from jaxtyping import Float
from pydantic import ConfigDict, Field, model_validator

from lensforge.cad.plate_layout import PlateWall
from lensforge.optics.face_roles import CAVITY
from lensforge.public import public
from lensforge.results import Array, Fact, Given, NotNegative, Number, Point, Positive, Text
from lensforge.results.arguments import require_choice
from lensforge.results.criteria import Criteria
from lensforge.results.figure import Criterion, Figure, criteria_in
from lensforge.results.notebook_html import screenful
from lensforge.results.numerals import quantity
from lensforge.results.plots import Axes, plot_face
from lensforge.results.record import InCriterion
from lensforge.results.stage_result import SimulatedResult
from lensforge.scene.lens import Lens
from lensforge.shop.check_measures import BallClearance, Edge, FaceFaults, FaceResult, Mould, ToolResult, Walls
from lensforge.shop.extrusion_findings import extrusion_findings
from lensforge.shop.findings import BODY, Findings, check_findings, plate_findings
from lensforge.shop.turning_findings import layer_findings, turning_findings
from lensforge.spec import Spec
from lensforge.spec.processes import Process


def _change_of_wall(check: "Check", extreme: Literal["thinnest", "thickest"]) -> str:
    """The change that mends the wall: the outermost face for a thicker one, the innermost for a thinner one, and the
    place.
    """
    lens = check.spec.lens
    wall = getattr(check.walls, extreme)
    moved = lens.outward if extreme == "thinnest" else lens.names[0]
    again = "or give the last level more steps"
    return f"raise lens.{moved}.offset_mm {again}; the wall is {extreme} at ({_place(wall.cavity_point_mm)}) mm"


def _place(point_mm: Point) -> str:
    return ", ".join(quantity(round(value, 6) + 0.0, digits=4) for value in point_mm)  # no "-0"


@public
class Check(SimulatedResult):
    """Manufacturing check. Beside its fields it has one for each face, by its name.

    ``lens``: that is checked. ``process``: by which the part is made. ``scale``: of the faces that are cut against the
    lens's, 1 + shrinkage for a mould insert; faces and ``tools`` are of these. ``min_wall_mm``: thinnest wall of the
    lens. ``walls``: thinnest and thickest wall of the lens, with their places. ``relief``: clearance of the shop's ball
    at the base. ``tools``: how much of each face each tool reaches. ``edges``: the sharpest place of each edge.
    ``mould``: halves, parting line, gate and cooling of a part that is moulded. ``faults``: where faces cannot be made
    as designed; only of those that have such places. ``plate_gap_mm``: between the two
    nearest lenses of a plate that are cut. ``plate_wall_mm``: thinnest wall of the plate at holes and pins;
    ``plate_wall_between``: the two things between which it is. ``criteria``: those of the design. ``verdicts``:
    findings for the shop, each with what to change. ``chart_axis``: places of the nodes of all maps along either axis.
    """

    __pydantic_extra__: dict[str, FaceResult]
    model_config = ConfigDict(extra="allow")
    stage: ClassVar[str] = "check"
    omit_if_empty: ClassVar[tuple[str, ...]] = ("edges", "mould", "faults", "conditions")
    judged_in: ClassVar[tuple[str, ...]] = ("criteria", "verdicts")

    lens: Annotated[Lens, Given()]
    process: Process
    scale: Positive
    min_wall_mm: Annotated[
        Number,
        Figure("Thinnest wall", "along the normal", key="thinnest"),
        Criterion(
            ">=",
            lambda check: check.spec.constraints.min_thickness_mm,
            "thinnest wall, along the normal",
            lambda check: _change_of_wall(check, "thinnest"),
            name="thinnest wall",
            tolerance=lambda check: check.spec.constraints.tolerance_mm,
        ),
    ]
    walls: Annotated[
        Walls,
        Figure("Thickest wall", "radial, from the LED", key="thickest", of="thickest.thickness_mm"),
        Criterion(
            "<=",
            lambda check: check.spec.constraints.max_wall_mm,
            "thickest wall, radial from the LED",
            lambda check: _change_of_wall(check, "thickest"),
            name="largest radial wall",
            of="thickest.thickness_mm",
            tolerance=lambda check: check.spec.constraints.tolerance_mm,
        ),
    ]
    relief: BallClearance
    tools: tuple[ToolResult, ...]
    edges: tuple[Edge, ...] = ()
    mould: Mould | None = None
    faults: tuple[FaceFaults, ...] = ()
    plate_gap_mm: Annotated[Number | None, InCriterion("gap", "limit")] = None
    plate_wall_mm: Annotated[Number | None, InCriterion("plate")] = None
    plate_wall_between: Annotated[Text, Field(exclude=True)] = ""
    criteria: Criteria = ()
    verdicts: Findings = ()
    seconds: NotNegative
    chart_axis: Annotated[Float[np.ndarray, " c"], Array("c")]

    def judge(self) -> Iterator[Fact]:
        """Judge the walls, and the sharpest place of each edge."""
        yield from criteria_in(self)
        for edge in self.edges:
            yield from criteria_in(self, edge)

    def judgements(self) -> Mapping[str, Iterable[Fact]]:
        """Judge walls and edges by limits of the design; ask of each face, wall and tool if the shop can make it."""
        return {"criteria": self.judge(), "verdicts": map(self._with_place, self._findings())}

    def _findings(self) -> Iterator[Fact]:
        spec = self.spec
        if not spec.manufacture.making.is_judged:
            return
        yield from check_findings(spec, self.faces, self.min_wall_mm, self.relief, self.tools, self.mould)
        yield from turning_findings(spec, self.faces)
        yield from extrusion_findings(spec, self.faces, self.walls)
        yield from layer_findings(spec, self.faces)
        wall_mm = self.plate_wall_mm
        yield from plate_findings(
            spec, self.plate_gap_mm, None if wall_mm is None else PlateWall(wall_mm, self.plate_wall_between)
        )

    def _with_place(self, finding: Fact) -> Fact:
        """A failed finding with its worst place, if that is known."""
        places = (faults.places_mm.get(finding.key) for faults in self.faults if faults.face == finding.place)
        place = next(places, None)
        if finding.holds or place is None:
            return finding
        return replace(finding, note=f"{finding.note}; worst at ({_place(place)}) mm")

    @property
    def spec(self) -> Spec:
        """Spec of the lens, made by the process by which the part is judged."""
        return self.lens.spec if self.conditions is None else self.lens.spec.made_by(self.process)

    @property
    def cut_body(self) -> str:
        """Name of the body that is cut."""
        return "mould insert" if self.spec.manufacture.cuts == "inserts" else "lens"

    @property
    def of_insert(self) -> str:
        """Phrase appended to a figure of a face of the insert rather than the lens; empty otherwise."""
        return "" if self.cut_body == "lens" else f", of the {self.cut_body}"

    @property
    def of_drawn(self) -> str:
        """Phrase for the shape that is fitted to a face of a linear lens; empty for any other."""
        return "" if self.spec.lens.drawn_mm is None else ", of a cylinder along y"

    def body_at(self, edge: Edge) -> str:
        """The body whose edge it is, as a phrase: at the cavity of a moulded lens the tool."""
        first = self.spec.lens.role(edge.faces[0])
        return self.spec.manufacture.making.terms.inner if first.before == CAVITY and not first.is_open else "the lens"

    def face_of(self, edge: Edge) -> str:
        """The face by which an edge is known: its first; for an opening the other one."""
        first, second = edge.faces
        return second if self.spec.lens.role(first).is_open else first

    def follows(self) -> Iterator[tuple[str, float, float]]:
        """The thinnest wall with its place."""
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
            names = ", ".join(self.faces) or "none"
            raise ValueError(f"faces: {names}; tools and findings are on {', '.join(sorted(unknown)) or 'none'}")
        for name, face in self.faces.items():
            if len(face.sag_mm) != len(self.chart_axis):
                raise ValueError(
                    f"{name}.sag_mm: shape {face.sag_mm.shape}, must be of the {len(self.chart_axis)} nodes"
                )
        return self

    def __str__(self) -> str:
        return screenful(
            [f"{'yes' if verdict.holds else 'no '} {verdict.key}: {verdict.note}" for verdict in self.verdicts]
        )

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
        values = getattr(self.faces[surface], quantity)
        half_width = float(self.chart_axis[-1])
        return plot_face(values, half_width, f"{surface}: {labels[quantity]}", axes)
