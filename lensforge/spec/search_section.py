"""The search: ``[constraints]`` on feasible lenses, ``[optimise]``, and ``[evaluate]`` for the finished lens."""

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, SerializerFunctionWrapHandler, model_serializer

from lensforge.public import public
from lensforge.spec.spec_section import (
    LEFT_OUT,
    DerivedMillimetres,
    DerivedMillimetresOrZero,
    FilePath,
    Millimetres,
    MillimetresOrZero,
    Section,
    check,
    rounded_up,
)
from lensforge.surfaces.srbf import MOST_LEVELS

MOST_STEPS = 1_000_000  # of a level; a search of 5000 takes minutes, and its history is kept
Steps = Annotated[int, Field(ge=1, le=MOST_STEPS)]
LARGEST = 10.0  # over the largest radius: a lens may miss that, but not by far; tables of it would not end
KEEP_OUT_MARGIN_MM = 0.1  # a placed package may be off by 0.05 mm, and so may a lens on its board
RIM_DEG = 0.6


@public
class ConstraintsSection(Section):
    """Feasible lenses, Eqs. (10) to (14). Optional limits, of each face too, are for manufacture and assembly."""

    cavity_height_mm: DerivedMillimetres = Field(
        default=LEFT_OUT,
        description="Height of the paraboloid that stays inside the cavity: room for the LED. A source whose size "
        "its section does not state, such as a ray file, needs it given.",
    )
    cavity_radius_mm: DerivedMillimetres = Field(
        default=LEFT_OUT,
        description="Radius of that paraboloid at z = 0. A source whose size its section does not state, such as "
        "a ray file, needs it given.",
    )
    min_thickness_mm: DerivedMillimetresOrZero = Field(
        default=LEFT_OUT, description="Minimum wall along the normal: the shortest distance between the two faces."
    )
    max_radius_mm: Millimetres = Field(
        description="Outer radius: two freeform faces stay within this distance of the origin, which bounds their "
        "height, too; a lens for total internal reflection or a reflector, within this distance of the axis."
    )
    max_wall_mm: Millimetres | None = Field(
        default=None, description="Largest wall, along rays from the origin, for sink marks and cycle time."
    )
    max_height_mm: Millimetres | None = Field(default=None, description="Largest height of the outer face above z = 0.")
    min_edge_angle_deg: Annotated[float, Field(ge=1.0, le=150.0)] | None = Field(
        default=None,
        description="Least angle of the edges in which faces of a lens for total internal reflection meet: at its "
        "rim that of the lens, at its cavity that of the mould's core.",
    )
    keep_out: FilePath | None = Field(
        default=None,
        description="STEP file of solids in the lens's coordinates (LED package, bond wires, board) that lens and "
        "base stay away from.",
    )
    keep_out_margin_mm: MillimetresOrZero = Field(default=KEEP_OUT_MARGIN_MM, description="Distance from these solids.")

    @property
    def tolerance_mm(self) -> float:
        """Excess over a limit that still counts as feasible: a micrometre for a lens of 14 mm."""
        return 7e-5 * self.max_radius_mm

    @property
    def margin_mm(self) -> float:
        """Distance that the search keeps from each limit: its last steps move by that much, and peaks lie between its
        points.
        """
        return 3e-4 * self.max_radius_mm

    @property
    def rim_radius_mm(self) -> float:
        """Radius at which a search for total internal reflection starts, and of the cylinder where a flange begins."""
        return self.max_radius_mm - 2.0 * self.margin_mm

    @property
    def tallest_mm(self) -> float:
        """Largest height above z = 0 of any lens: as far as any of its faces may reach, where no height is given."""
        reach_mm = LARGEST * self.max_radius_mm
        return reach_mm if self.max_height_mm is None else min(self.max_height_mm, reach_mm)

    @property
    def missing(self) -> tuple[str, ...]:
        """Names of the sizes that are neither given nor derived yet."""
        sizes = ("cavity_height_mm", "cavity_radius_mm", "min_thickness_mm")
        return tuple(name for name in sizes if getattr(self, name) is None)

    @check
    def _cavity_and_wall_fit(self) -> None:
        """Refuse what no lens keeps: the paraboloid is furthest from the origin at its apex or its rim."""
        if self.missing:
            return
        name = max("cavity_height_mm", "cavity_radius_mm", key=lambda field: float(getattr(self, field)))
        reach: float = getattr(self, name)
        needed = reach + self.min_thickness_mm + 3.0 * self.margin_mm  # one for each of the three limits
        if needed > self.max_radius_mm:
            least = (reach + self.min_thickness_mm) / (1.0 - 3.0 * self.margin_mm / self.max_radius_mm)
            raise ValueError(
                f"{name} = {reach:g} and min_thickness_mm = {self.min_thickness_mm:g} do not fit into max_radius_mm = "
                f"{self.max_radius_mm:g}: make it at least {rounded_up(least)}, or lower one of the two"
            )

    @check
    def _margin_is_of_a_keep_out(self) -> None:
        if self.keep_out is None and self.keep_out_margin_mm != KEEP_OUT_MARGIN_MM:
            raise ValueError(
                f"keep_out_margin_mm = {self.keep_out_margin_mm:g} goes with keep_out, a STEP file of what the lens "
                "stays away from; give both, or neither"
            )


_YIELD = 0.95  # default share of the parts that hold the limits
_LEAST_SHARE = 0.5
_MOST_SHARE = 0.999
_Robust = bool | Literal["yield"] | Annotated[float, Field(ge=_LEAST_SHARE, le=_MOST_SHARE)]


def _share_of_parts(value: object) -> object:
    if isinstance(value, bool) or value == "yield":
        return value
    if isinstance(value, int | float) and _LEAST_SHARE <= value <= _MOST_SHARE:
        return value
    raise ValueError(
        f'must be true, false, "yield", or a share of the parts from {_LEAST_SHARE:g} to {_MOST_SHARE:g}; some part '
        "always fails"
    )


@public
class OptimiseSection(Section):
    """Settings of the search; omitted ones come from the accuracy preset.

    ``steps_per_level`` and ``rays`` belong to levels that are given.
    """

    steps_per_level: Annotated[tuple[Steps, ...], Field(max_length=MOST_LEVELS)] | None = Field(
        default=None, description="Gradient steps of each level."
    )
    rays: Annotated[int, Field(ge=64, le=2**24)] | None = Field(default=None, description="Rays of a gradient step.")
    pixels: Annotated[int, Field(ge=4, le=1024)] = Field(
        default=64, description="Pixels along a side of the receiver in the search."
    )
    aim: Literal["pattern", "share", "size"] = Field(
        default="pattern",
        description='What counts: "pattern", light as the targets say; "share", as much light in them as '
        'possible, however it lies; "size", the smallest lens that holds all `[[limits]]`, of which a zone may bound '
        'the share. That lens is sought by several searches for the "share", within one size after another.',
    )
    size: Literal["height", "radius"] = Field(
        default="height",
        description='Of `aim = "size"`: what is the least. `constraints.max_height_mm` or `constraints.max_radius_mm` '
        "bounds the first search, and is lowered to the least; without a height the first search finds one.",
    )
    over_sources: Literal["mean", "worst"] = Field(
        default="mean",
        description='Of `states` or several `sources`: the "mean" of their errors by weight, or the "worst" error.',
    )
    seconds: Annotated[float, Field(ge=1.0, le=1e6)] | None = Field(
        default=None,
        description="Time that the search with automatic levels may take, with its set-up but without the kernels "
        'that are compiled once on a machine; of `aim = "size"` each search. By default it goes on for as long as it '
        "gains.",
    )
    robust: Annotated[_Robust, BeforeValidator(_share_of_parts)] = Field(
        default=False,
        description="Search by made parts: every gradient step sees others, drawn from the tolerances. true: for "
        'the lens whose parts are best on average; "yield": for that of whose parts 0.95 hold the '
        "limits, or the share that is given. Without it the tolerances have no effect on the lens.",
    )
    fresnel: bool = Field(
        default=True,
        description="Count what both surfaces and a cover glass reflect in the search; the evaluation always does.",
    )

    rim_deg: Annotated[float, Field(ge=1e-3, le=10.0)] = Field(
        default=RIM_DEG,
        description="Angle from the rims of bodies of the `scene` within which light fades out in the search: less is "
        "nearer to the light as it is, and needs more rays.",
    )

    @model_serializer(mode="wrap")
    def _as_before_scenes(self, write: SerializerFunctionWrapHandler) -> dict[str, object]:
        """The section without a usual rim and size: specs without a scene keep the hash that they had before."""
        usual: dict[str, object] = {"rim_deg": RIM_DEG, "size": "height"}
        return {name: value for name, value in write(self).items() if value != usual.get(name, ...)}

    @property
    def counts_light_alone(self) -> bool:
        """True where a search is for as much light in the targets as possible, however it lies."""
        return self.aim != "pattern"

    @property
    def share(self) -> float | None:
        """Share of the parts that is to hold the limits; None if the search does not ask for it."""
        return None if isinstance(self.robust, bool) else _YIELD if self.robust == "yield" else self.robust

    def require_limits(self, given: bool) -> None:
        """Raise ``ValueError`` for an aim, or a share of the parts, that asks for limits where there are none."""
        if self.aim == "size" and not given:
            raise ValueError(
                'optimise.aim = "size" is for the smallest lens that holds limits, and there are none: give [[limits]] '
                "or [[roads]], of which a zone may bound the share of the flux"
            )
        if self.aim == "size" and self.share is not None:
            raise ValueError(
                f'optimise.robust = {self.robust!r} does not go with aim = "size": that lens holds limits as designed; '
                "give robust = true"
            )
        if self.share is not None and not given:
            raise ValueError(
                f"optimise.robust = {self.robust!r} asks for parts that hold limits, and there are none: give "
                "[[limits]] or [[roads]], of which a zone may bound the share of the flux; or robust = true"
            )


@public
class EvaluateSection(Section):
    """Settings of the evaluation."""

    rays: Annotated[int, Field(ge=1, le=2**28)] | None = Field(
        default=None, description="Rays; by default as many as the accuracy preset has."
    )
    pixels: Annotated[int, Field(ge=2, le=2048)] = Field(
        default=128, description="Pixels along the longer side of the picture."
    )
    window_mm: Millimetres | None = Field(
        default=None, description="Side of the square in which flux counts as detected; by default the whole receiver."
    )
    filter_variance: Annotated[float, Field(ge=0.0, le=1e8)] = Field(
        default=1.0, description="Variance of the Gaussian filter of the picture, in pixels squared; 0: none."
    )
