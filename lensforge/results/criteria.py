"""Acceptance criteria: numbers of a result, each with the limit that it must keep, and their names in words."""

from collections.abc import Iterable, Iterator
from math import isfinite
from typing import Literal, TypedDict

from pydantic import computed_field

from lensforge.errors import CriterionMissed
from lensforge.results import Bound, Fact, FactState, NotNegative, Number, Record, Sense, Text
from lensforge.results.numerals import quantity
from lensforge.results.verdict import Reason, judge, within

_STL, _STEP = "mesh (lens.stl)", "STEP file"
_YES = " (1: yes)"  # ends the words of a question
_WORDS = {
    "cavity clearance": "free space over the LED, to spare",
    "wall margin": "wall, above its minimum",
    "radius margin": "distance from the LED, below its maximum",
    "largest wall margin": "wall, below its maximum",
    "height margin": "height, below its maximum",
    "keep out clearance": "distance from the keep-out solid, to spare",
    "flux not converged": "light that the simulation could not follow",
    "thinnest wall": "thinnest wall, along the normal",
    "largest radial wall": "thickest wall, seen from the LED",
    "form_error": f"form of the optical faces in the {_STEP}",
    "normal_error": f"slope of the optical faces in the {_STEP}",
    "step_valid": f"solid of the {_STEP} is valid (1: yes)",
    "step_volume_change": f"volume of the {_STEP} as read back",
    "watertight": f"{_STL} is closed (1: yes)",
    "watertight_3mf": "3MF file is closed (1: yes)",
    "genus_difference": "handles and holes that the mesh should not have",
    "mesh_volume_change": f"volume of the {_STL}, against the solid",
    "surfaces_form_error": "form of the untrimmed faces in their file",
    "surfaces_normal_error": "slope of the untrimmed faces in their file",
    "keep_out_distance": "distance of the part from the keep-out solid",
    "plate_form_error": "form of all lenses in plate.step",
    "plate_step_valid": "solid of plate.step is valid (1: yes)",
    "plate_step_volume_change": "volume of plate.step as read back",
    "plate_volume_error": "volume of plate.step, against its closed form",
    "plate_watertight": "plate.stl is closed (1: yes)",
    "plate_watertight_3mf": "plate.3mf is closed (1: yes)",
    "plate_genus_difference": "handles and holes that the mesh of the plate should not have",
    "plate_mesh_volume_change": "volume of plate.stl, against its closed form",
    "plate_nmse_vs_sum": "pattern of all lamps through plate.stl, against their sum",
    "concave_radius": "smallest hollow of the corrected face",
    "form": "farthest point from the design",
    "gaps": "open edges, and faces that it lacks",
    "open_edges": f"open edges of the {_STL}",
    "plain_cast_disagreements": "first hits that a second ray caster finds elsewhere",
    "volume_change": f"volume of the {_STL}, against the export",
    "area_change": f"area of the {_STL}, against the export",
    "box_change": f"outer size of the {_STL}, against the export",
    "brep_volume_change": f"volume of the {_STEP}, against the export",
    "brep_area_change": f"area of the {_STEP}, against the export",
    "brep_box_change": f"outer size of the {_STEP}, against the export",
    "own_rays_emission": "light of freshly drawn rays as it leaves the LED",
    "own_rays_efficiency": "efficiency with freshly drawn rays",
    "own_rays_nmse": "pattern of freshly drawn rays, against the design",
    "deviation_rms": f"landing of rays through the {_STL}, against the design",
    "flux_deviation": f"light of each ray through the {_STL}, against the design",
    "fate_disagreement_flux": f"light that ends elsewhere through the {_STL}",
    "nmse_same_rays": f"pattern of the {_STL}, against the design, same rays",
    "nmse_vs_design": f"pattern of the {_STL}, against the design",
    "brep_deviation_rms": f"landing of rays through the {_STEP}, against the design",
    "brep_flux_deviation": f"light of each ray through the {_STEP}, against the design",
    "brep_fate_disagreements": f"rays that end elsewhere through the {_STEP}",
    "mitsuba_nmse_vs_design": f"pattern of the {_STL} by Mitsuba, against the design",
    "mitsuba_deviation_rms": f"landing of rays through the {_STL} by Mitsuba",
    "mitsuba_flux_deviation": f"light of each ray through the {_STL} by Mitsuba",
    "mitsuba_fate_disagreement_flux": f"light that ends elsewhere through the {_STL} by Mitsuba",
    "stray_balance": "light that the stray-light budget cannot account for",
    "stray_leaked": "light that leaks through the edges of the mesh",
    "stray_too_dim": "light that is still in the part when it is given up",
    "photo_clipped": "pixels of the photograph that are saturated",
    "points_used": "measured points that lie on the surface",
    "surface_covered": "part of the surface that was measured",
}


# Of a face, after its name.
_OF_FACE = {
    "curvature margin": "hollows of the {} face, wider than the tool",
    "draft margin": "draft of the {} face, above its minimum",
}


class Kept(TypedDict, total=False):
    """Limit and state of a criterion, as a fact takes them."""

    limit: Bound
    state: FactState


class Judged(Record):
    """A ``value`` that must be ``sense`` ``limit``, but for the ``tolerance`` of its measure."""

    value: Number | None
    sense: Sense
    limit: Number | None
    unit: Text
    tolerance: NotNegative = 0.0

    @property
    def is_kept(self) -> bool:
        """True where the limit is kept; False where the value could not be measured."""
        return within(self.value, self.sense, self.limit, self.tolerance)


class Criterion(Judged):
    """``value`` (None: not measured) must be ``sense`` ``limit``; ``remedy``: what to try where it is not."""

    name: Text
    limit: Number
    remedy: Text

    @computed_field  # type: ignore[prop-decorator]  # mypy knows no decorated properties
    @property
    def passed(self) -> bool:
        """True where the criterion is met; False where the value could not be measured."""
        return self.is_kept

    @property
    def words(self) -> str:
        """Words for its name, which begins with its face or file, or with its receiver where that is not the first."""
        receiver, colon, short = self.name.rpartition(": ")
        face, _, of_face = short.partition(" ")
        if of_face in _OF_FACE:
            return f"{receiver}{colon}{_OF_FACE[of_face].format(face)}"
        return f"{receiver}{colon}{_WORDS.get(short, short.replace('_', ' '))}"

    @property
    def fact(self) -> Fact:
        """The criterion as a fact."""
        state, note = judge(self.value, self.sense, self.limit, tolerance=self.tolerance), self.name.replace("_", " ")
        question = self.words.removesuffix(_YES)
        if question != self.words:
            answer = "yes" if self.passed else "no"
            return Fact(self.name, question, answer, state=state, note=note, remedy=self.remedy)
        return Fact(
            self.name,
            self.words,
            self.value,
            self.unit,
            limit=Bound(self.sense, self.limit),
            state=state,
            note=note,
            remedy=self.remedy,
        )

    def __str__(self) -> str:
        limit = f"must be {Bound(self.sense, self.limit).text(self.unit)}"
        if self.value is None:
            return f"{self.name} could not be measured ({limit}); {self.remedy}"
        missed = quantity(abs(self.value - self.limit), self.unit, digits=3)
        verdict = "met" if self.passed else f"missed by {missed}; {self.remedy}"
        return f"{self.name} = {quantity(self.value, self.unit)} ({limit}): {verdict}"


def at_most(name: str, value: float, limit: float, unit: str, remedy: str, tolerance: float = 0.0) -> Criterion:
    """The criterion ``value <= limit``, to ``tolerance``; a value that is not finite counts as not measured."""
    return _criterion(name, value, "<=", limit, unit, remedy, tolerance)


def at_least(name: str, value: float, limit: float, unit: str, remedy: str, tolerance: float = 0.0) -> Criterion:
    """The criterion ``value >= limit``, to ``tolerance``; a value that is not finite counts as not measured."""
    return _criterion(name, value, ">=", limit, unit, remedy, tolerance)


def _criterion(
    name: str, value: float, sense: Sense, limit: float, unit: str, remedy: str, tolerance: float
) -> Criterion:
    measured = float(value) if isfinite(value) else None
    return Criterion(name=name, value=measured, sense=sense, limit=limit, unit=unit, remedy=remedy, tolerance=tolerance)


def missed(criteria: Iterable[Criterion]) -> Iterator[Reason]:
    """A reason against a result for each of its ``criteria`` that is not met."""
    for criterion in criteria:
        if not criterion.passed:
            yield "fail", str(criterion)


def state_of(criteria: Iterable[Criterion], *names: str) -> Literal["pass", "fail", ""]:
    """``pass`` if all of ``criteria`` called ``names`` are met, else ``fail``; ``""`` where there is none of them."""
    met = [criterion.passed for criterion in criteria if criterion.name in names]
    return ("pass" if all(met) else "fail") if met else ""


def kept(criteria: Iterable[Criterion], name: str) -> Kept:
    """Limit and state of the criterion called ``name``, for the fact on the same value; empty where there is none."""
    judged = next((criterion for criterion in criteria if criterion.name == name), None)
    if judged is None:
        return {}
    return {"limit": Bound(judged.sense, judged.limit), "state": "pass" if judged.passed else "fail"}


def require(criteria: Iterable[Criterion]) -> None:
    """Raise :class:`CriterionMissed` naming every criterion that is missed."""
    failed = [str(criterion) for criterion in criteria if not criterion.passed]
    if failed:
        raise CriterionMissed("; ".join(failed))
