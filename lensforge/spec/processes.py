"""Processes by which a lens is made: how each cuts a face, what it asks of faces and sides, and its words.

A search keeps what a process asks, the check judges by the same, and drawing, page and advice take their words from
here. A further process is a class here, with its name in :data:`Process`.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple, Protocol

Process = Literal["milled", "turned", "moulded", "extruded", "printed", "none"]
Cutting = Literal["milled", "turned"]

GOOD_DRAFT_DEG = 2.0  # of an optical face, for a mould that releases it without marks
_SIDE_DRAFT_DEG = 1.0  # of base and flange, as of plate.draft_deg
MOST_DRAFT_DEG = 25.0  # of the draft_deg of a face
MOST_TILT_DEG = 120.0  # of the axis of a tool
LEVEL_DEG = 90.0  # tilt of an axis whose ball reaches every undercut
_ON_OPTICS = "marks of gate, ejector or parting line"


class ProcessTerms(NamedTuple):
    """Words of a process: what has edges at a cavity, what edges and optical faces must be without, what is left."""

    inner: str
    burr: str
    traces: str
    left: str


@dataclass(frozen=True)
class FaceLimits:
    """Limits that tools set to a face; None where they ask nothing.

    ``concave_radius_mm``: least concave radius, of the meridian where a lathe turns it. ``draft_deg``: least draft,
    negative where an undercut is allowed.
    """

    concave_radius_mm: float | None = None
    draft_deg: float | None = None

    def and_stated(self, stated: "FaceLimits") -> "FaceLimits":
        """These limits with those that a user has ``stated``: the larger radius, and the draft as it is stated.

        A draft is what a moulder is content with; what a mill asks for is never above any that can be stated.
        """
        radii = [radius for radius in (self.concave_radius_mm, stated.concave_radius_mm) if radius is not None]
        draft_deg = self.draft_deg if stated.draft_deg is None else stated.draft_deg
        return FaceLimits(max(radii, default=None), draft_deg)


class Tools(Protocol):
    """The tools of a shop, as ``[manufacture]`` states them."""

    @property
    def cutter_radius_mm(self) -> float: ...  # noqa: D102

    @property
    def nose_radius_mm(self) -> float: ...  # noqa: D102


class MakingProcess:
    """A process. ``cuts``: the body that tools cut, the lens itself or the inserts of its mould; None for no tools.

    ``is_drawn``: True where the part is drawn through a die. ``is_judged``: False for a study of light, of which
    nothing is made. ``comes_from_below``: True where a face that widens upwards is reached from there.
    ``side_draft_deg``: of base and flange. ``face_draft_deg``: least draft of an optical face where none is stated;
    None if it needs none. ``fields``: those of ``[manufacture]`` that go with it alone.
    """

    name: ClassVar[Process]
    cuts: ClassVar[Literal["lens", "inserts"] | None] = None
    is_drawn: ClassVar[bool] = False
    is_judged: ClassVar[bool] = True
    comes_from_below: ClassVar[bool] = False
    side_draft_deg: ClassVar[float] = 0.0
    face_draft_deg: ClassVar[float | None] = None
    fields: ClassVar[tuple[str, ...]] = ()
    terms: ClassVar[ProcessTerms]

    def __init_subclass__(cls) -> None:
        PROCESSES[cls.name] = cls()

    def cutting(self, revolved: bool) -> Cutting | None:
        """Cut of a face, of the lens or of an insert; None if no tool makes one. ``revolved``: about the axis."""
        return None

    def asks(self, tools: Tools, revolved: bool, undercut_deg: float) -> FaceLimits:
        """Limits that the ``tools`` set to a face that they make.

        ``undercut_deg``: farthest by which room around the face and the axes of a mill let it be undercut.
        """
        return FaceLimits()


PROCESSES: dict[Process, MakingProcess] = {}


class _Milled(MakingProcess):
    """Milling of the lens itself by balls: no place is hollower than the ball, none undercut farther than the axis
    tilts, as a ball cuts up to its equator.
    """

    name = "milled"
    cuts = "lens"
    terms = ProcessTerms("the cavity", "burr", "marks", "what the mill leaves")

    def cutting(self, revolved: bool) -> Cutting | None:
        return "milled"

    def asks(self, tools: Tools, revolved: bool, undercut_deg: float) -> FaceLimits:
        return FaceLimits(tools.cutter_radius_mm, 0.0 - undercut_deg if undercut_deg < LEVEL_DEG else None)


class _Turned(MakingProcess):
    """Turning of the lens itself on a lathe: no meridian tighter than the nose of the tool."""

    name = "turned"
    cuts = "lens"
    comes_from_below = True
    terms = ProcessTerms("the cavity", "burr", "marks", "what the turning tool leaves")

    def cutting(self, revolved: bool) -> Cutting | None:
        return "turned"

    def asks(self, tools: Tools, revolved: bool, undercut_deg: float) -> FaceLimits:
        return FaceLimits(tools.nose_radius_mm) if revolved else FaceLimits()


class _Moulded(MakingProcess):
    """Moulding between inserts, which are turned where a face is of revolution, else milled; every face has a draft."""

    name = "moulded"
    cuts = "inserts"
    comes_from_below = True
    side_draft_deg = _SIDE_DRAFT_DEG
    face_draft_deg = GOOD_DRAFT_DEG
    fields = ("shrinkage",)
    terms = ProcessTerms("the mould’s core", "flash", _ON_OPTICS, "what the tools leave of the inserts")

    def cutting(self, revolved: bool) -> Cutting | None:
        return "turned" if revolved else "milled"

    def asks(self, tools: Tools, revolved: bool, undercut_deg: float) -> FaceLimits:
        return FaceLimits(tools.nose_radius_mm if revolved else tools.cutter_radius_mm, self.face_draft_deg)


class _Extruded(MakingProcess):
    """Extrusion of a linear lens through a die, whose opening has corners as round as its wire."""

    name = "extruded"
    is_drawn = True
    fields = ("most_wall_ratio",)
    terms = ProcessTerms("the cavity", "burr of the saw", "lines of the die", "")


class _Printed(MakingProcess):
    """Printing in layers, which ask nothing of a face but steps within the form tolerance."""

    name = "printed"
    fields = ("layer_um",)
    terms = ProcessTerms("the cavity", "rests of supports", "layers or marks of supports", "")


class _NotMade(MakingProcess):
    """A study of light: nothing is made, and nothing is judged."""

    name = "none"
    is_judged = False
    terms = ProcessTerms("the cavity", "burr", "marks", "")
