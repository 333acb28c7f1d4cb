"""Cp and Cpk of the place of a face on several parts, against known displacements, on each side of a limit."""

from dataclasses import replace

import numpy as np
import pytest
from measured_lenses import lens
from scipy.spatial.transform import Rotation

from lensforge.addons.measure.first_cut import FirstCut, Request
from lensforge.addons.measure.measured_points import PartPoints
from lensforge.addons.measure.nominal_face import NominalFace
from lensforge.addons.measure.part_places import place_capabilities
from lensforge.addons.measure.registration import RigidMotion
from lensforge.addons.measure.several_parts import common_cut
from lensforge.results.figure import facts_in
from lensforge.surfaces.srbf import fibonacci_hemisphere

LIMITS = {"shift_mm": 0.04, "gap_mm": 0.05, "tilt_deg": 0.4}
PLAIN = lens()
TOLERANCED = PLAIN.spec.replace({f"lens.outer.{name}": amount for name, amount in LIMITS.items()})
LENS = replace(PLAIN, spec=TOLERANCED)
FACE = NominalFace.of(LENS, "outer")
CAVITIES = ("C2", "C1", "C2", "C1", "C1", "C2", "C1")
DIRECTIONS = ("shift in x", "shift in y", "shift in z", "tilt about x", "tilt about y")
# Displacements in µm and degrees: a mean of each cavity, and a scatter of each part.
MEANS = {"C1": np.array([12.0, -4.0, 3.0, 0.07, 0.0]), "C2": np.array([-2.0, 9.0, 5.0, -0.03, 0.2])}
PLACES = np.array([MEANS[name] for name in CAVITIES]) + np.random.default_rng(6).normal(size=(7, 5)) * [
    5.0, 4.0, 7.0, 0.05, 0.08
]  # fmt: skip


def part(number: int) -> PartPoints:
    """Points of a part whose outer face is out of place, with the noise of a probe and a form that all have."""
    rng = np.random.default_rng(40 + number)
    u = Rotation.from_rotvec([0.0, 0.0, rng.uniform(0.0, 6.0)]).apply(fibonacci_hemisphere(500))
    off = 2e-3 * u[:, 0] * u[:, 1] * u[:, 2] + 3e-4 * rng.normal(size=len(u))
    points = u * (LENS.outer.radius(u) + off)[:, None]
    turned = Rotation.from_rotvec(np.radians([*PLACES[number, 3:], 0.0])).apply(points)
    return PartPoints(turned + 1e-3 * PLACES[number, :3], f"{CAVITIES[number]}_{number}.csv", CAVITIES[number])


PARTS = [part(number) for number in range(len(CAVITIES))]
GROUPS = [[number for number, name in enumerate(CAVITIES) if name == cavity] for cavity in ("C2", "C1")]


@pytest.fixture(scope="module")
def cut() -> FirstCut:
    return common_cut(PARTS, FACE, Request(registration="none"))


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_capability_is_that_of_the_known_places(cut: FirstCut, direction: str) -> None:
    axis = DIRECTIONS.index(direction)
    made = next(place for place in cut.series.places if place.direction == direction)
    limit = (40.0, 40.0, 50.0, 0.4, 0.4)[axis]
    groups = [PLACES[numbers, axis] for numbers in GROUPS]
    scatter = np.sqrt(sum(((group - group.mean()) ** 2).sum() for group in groups) / 5.0)
    margins = [limit - abs(group.mean()) for group in groups]
    worst = groups[int(np.argmin(margins))]
    assert made.limit == pytest.approx(limit)
    assert made.scatter.value == pytest.approx(scatter, rel=0.03)
    assert made.scatter.standard_error == pytest.approx(made.scatter.value / np.sqrt(10.0))
    assert made.mean.value == pytest.approx(worst.mean(), abs=2.5 * made.part_error)
    assert made.cp.value == pytest.approx(limit / (3.0 * scatter), rel=0.03)
    assert made.cpk.value == pytest.approx(min(margins) / (3.0 * scatter), rel=0.04)
    wanted = np.sqrt(1.0 / (9.0 * len(worst)) + made.cpk.value**2 / 10.0)
    assert made.cpk.standard_error == pytest.approx(wanted)
    assert 0.0 < made.part_error < 0.3 * scatter


def motions(count: int, error_um: float = 0.1) -> list[RigidMotion]:
    """Motions of parts that are shifted in y by 6 ± 2 µm."""
    shifts = 6.0 + 2.0 * np.random.default_rng(3).normal(size=count)
    error = 1e-3 * np.full(3, error_um)
    return [RigidMotion(np.zeros(3), np.array([0.0, -1e-3 * y, 0.0]), error, error) for y in shifts]


@pytest.mark.parametrize(("limit_um", "state"), [(10.0, "fail"), (20.0, "pass"), (14.0, "undecided")])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_place_is_judged_on_each_side_of_the_customary_limit(
    cut: FirstCut, limit_um: float, state: str, sign: float
) -> None:
    moved = [replace(motion, translation_mm=sign * motion.translation_mm) for motion in motions(60)]
    (made,) = place_capabilities(moved, [range(60)], {"shift_mm": 1e-3 * limit_um})
    (fact,) = facts_in(cut.series, (), made)
    assert (fact.key, fact.state, fact.limit, fact.sense) == ("cpk_shift_in_y", state, 1.33, ">=")
    assert f"within ±{limit_um:g}" in fact.note.replace("\u202f", " ") and not fact.notice
    assert made.mean.value == pytest.approx(sign * 6.0, abs=1.0)


def test_places_that_points_hardly_tell_or_not_at_all_are_told(cut: FirstCut) -> None:
    (badly,) = place_capabilities(motions(9, 1.6), [range(9)], {"shift_mm": 0.01})
    (fact,) = facts_in(cut.series, (), badly)
    assert "a part's place is known to 1.6" in fact.notice.replace("\u202f", " ")
    unknown = [replace(motion, translation_error_mm=np.array([np.inf, 1e-4, 1e-4])) for motion in motions(9)]
    assert [made.direction for made in place_capabilities(unknown, [range(9)], {"shift_mm": 0.01})] == ["shift in y"]


def test_a_registration_takes_places_out() -> None:
    told = {}
    for registration in ("rigid", "shift"):
        series = common_cut(PARTS, FACE, Request(registration=registration)).series
        told[registration] = [place.direction for place in series.places]
        place = next(fact for fact in facts_in(series) if fact.key == "place_registered")
        assert place.text == "not judged" and "--registration none" in place.note
    assert told == {"rigid": [], "shift": ["tilt about x", "tilt about y"]}
    assert NominalFace.of(LENS, "inner").places == {}, "the face against which the outer one is placed"
