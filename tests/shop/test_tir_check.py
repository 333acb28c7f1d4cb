"""The check of a lens for total internal reflection made of spheres: draft from both halves of a mould, edges, base."""

from dataclasses import replace

import numpy as np
import pytest
from known_shapes import sphere
from presets import CHECKED
from shop_lenses import OfSpheres
from tir_lenses import TIR, spot, spot_lens

from lensforge.scene.lens import Lens
from lensforge.search.constraints import AugmentedLagrangian
from lensforge.search.profiles import ProfileParameters
from lensforge.shop.check import check_lens
from lensforge.shop.check_facts import check_facts
from lensforge.shop.check_result import Check

# Spheres by radius and height of their centre, and the height at which wall and exit meet. One wall widens all the way
# up: 144 - (z - 6)^2 = 1600 - (z + 35)^2. The other narrows above z = 2: 25 - (z - 2)^2 = 144 - (z + 6)^2.
CAVITY = ((2.0, -0.5), (1.8, 0.0))
OPEN = ((12.0, 6.0), (40.0, -35.0))
OPEN_MM = 267.0 / 82.0
SHUT = ((5.0, 2.0), (12.0, -6.0))
SHUT_MM = 87.0 / 16.0


def checked(envelope: tuple, **sections: object) -> tuple[Check, Lens]:
    faces = {
        name: sphere(radius, (0.0, 0.0, height))
        for name, (radius, height) in zip(TIR, (*CAVITY, *envelope), strict=True)
    }
    lens = OfSpheres(faces, spot().replace(sections), 0, CHECKED)
    return on_few_nodes(lens), lens


def on_few_nodes(lens: Lens) -> Check:
    return check_lens(lens, dict.fromkeys(TIR, 81))


@pytest.fixture(scope="module")
def bare() -> tuple[Check, Lens]:
    return checked(OPEN, base={"kind": "none"})


def test_the_wall_is_drawn_from_below_and_the_other_faces_as_ever(bare: tuple[Check, Lens]) -> None:
    """A sphere's normal is along its radius: its outward z is the height over the centre by the radius."""
    lowest = {"cap": (0.51 + 0.5) / 2.0, "side": 0.0, "wall": (6.0 - OPEN_MM) / 12.0, "exit": (OPEN_MM + 35.0) / 40.0}
    for name, sine in lowest.items():
        face = bare[0].faces[name]
        assert face.draft_deg.min == pytest.approx(np.degrees(np.arcsin(sine)), abs=2e-3), name
        assert face.largest_tilt_deg == pytest.approx(0.0, abs=2e-3) and face.undercut_fraction == 0.0


def test_a_wall_that_narrows_upwards_is_undercut() -> None:
    wall = checked(SHUT, base={"kind": "none"})[0].faces["wall"]
    assert wall.draft_deg.min == pytest.approx(-np.degrees(np.arcsin((SHUT_MM - 2.0) / 5.0)), abs=2e-3)
    assert wall.undercut_fraction == pytest.approx((SHUT_MM - 2.0) / SHUT_MM, abs=1e-4), "a zone's area is its height"


def test_what_lies_over_the_base_is_drawn_by_neither_half_and_a_mould_says_so() -> None:
    over = 6.0 - np.sqrt(144.0 - 11.0**2)  # where the wall is 11 mm from the axis
    base = {"kind": "cylinder", "diameter_mm": 22.0, "height_mm": 2.0}
    check, _ = checked(OPEN, base=base, manufacture={"process": "moulded", "shrinkage": 0.01})
    assert check.mould is not None
    wall = check.mould.faces["wall"]
    assert wall.undercut_fraction == pytest.approx(over / OPEN_MM, abs=1e-3) and wall.draft_deg == pytest.approx(
        check.faces["wall"].draft_deg.min, abs=0.02
    )
    judged = {(verdict.key, verdict.place): verdict for verdict in check.verdicts}
    finding = judged["undercut", "wall"]
    assert not finding.holds and finding.remedy == 'base.kind = "none", or a narrower base'
    assert "of the wall face is undercut, from z = 0 to 1.2 mm" in finding.note.replace("\u2009", " ")
    assert judged["draft", "wall"].holds and all(judged["undercut", name].holds for name in ("cap", "side", "exit"))
    shown = {fact.key: fact for group in check_facts(check) for fact in group.facts}
    assert shown["wall_drawn"].value == pytest.approx(100.0 * (1.0 - over / OPEN_MM), abs=0.1)
    assert shown["gate"].value == "at the side of the base"
    assert shown["inner_corners"].value == "cap and side" and shown["parting"].value == "where exit and wall meet"


def test_an_edge_has_the_angle_of_the_spheres_that_meet_there(bare: tuple[Check, Lens]) -> None:
    """By the law of cosines: of the lines from a point of both spheres to their centres."""
    (check, _) = bare
    wanted = {}
    for names, ((one, low), (other, high)) in (((TIR[0], TIR[1]), CAVITY), ((TIR[3], TIR[2]), OPEN[::-1])):
        turned = np.degrees(np.arccos((one**2 + other**2 - (low - high) ** 2) / (2.0 * one * other)))
        wanted[names] = 180.0 - turned
    assert {edge.faces: edge.angle_deg for edge in check.edges} == {
        names: pytest.approx(angle, abs=5e-3) for names, angle in wanted.items()
    }
    assert [edge.point_mm[2] for edge in check.edges] == pytest.approx([0.51, OPEN_MM], abs=1e-4)
    facts = next(group for group in check_facts(check) if group.key == "edges").facts
    assert [fact.value for fact in facts] == [edge.angle_deg for edge in check.edges]
    assert "cavity" in facts[0].note and "lens" in facts[1].note


def test_the_search_keeps_the_draft_of_the_wall_from_below() -> None:
    spec = spot(wall={"draft_deg": 5.0})
    parameters = ProfileParameters.of(spec, 2.5)
    grid = parameters.refined().grid
    tables = parameters.refined().tables(*parameters.start())
    constraints = AugmentedLagrangian.of(spec, grid)
    margins = constraints.least(constraints.fields(tables))
    (least,) = (value for key, value in margins.items() if "draft" in key)
    faces = parameters.start_surfaces
    polar = np.linspace(0.0, 0.5 * np.pi, 20_001)
    u = np.column_stack([np.sin(polar), np.zeros_like(polar), np.cos(polar)])
    on_wall = faces["wall"].radius(u) <= faces["exit"].radius(u)
    draft = -np.degrees(np.arcsin(faces["wall"].normal(u[on_wall])[:, 2].max()))
    assert draft > 10.0 and least == pytest.approx(min(draft, 30.0) - 5.0, abs=0.2)


def test_edges_sharper_than_asked_miss_their_criterion() -> None:
    check, lens = checked(OPEN, base={"kind": "none"}, constraints={"min_edge_angle_deg": 150.0})
    criteria = {criterion.key: criterion for criterion in check.criteria if criterion.key.startswith("edge")}
    assert set(criteria) == {"edge of cap and side", "edge of exit and wall"}
    assert [criterion.value for criterion in criteria.values()] == [edge.angle_deg for edge in check.edges]
    assert [criterion.holds for criterion in criteria.values()] == [True, False], "the cavity's is nearly flat"
    facts = next(group for group in check_facts(check) if group.key == "edges").facts
    assert [(fact.limit, fact.state) for fact in facts] == [(150.0, "pass"), (150.0, "fail")]
    blunt = replace(lens, spec=lens.spec.replace(constraints={"min_edge_angle_deg": 10.0}))
    judged = [
        criterion for criterion in check.model_copy(update={"lens": blunt}).judge() if criterion.key.startswith("edge")
    ]
    assert [limit.holds for limit in judged] == [True, True]


def test_a_flat_face_has_no_radius() -> None:
    lens = spot_lens(spot(exit={"flat": True}), base={"kind": "none"})
    check = on_few_nodes(lens)
    assert check.faces["exit"].curvature.smallest_concave_radius_mm is None
    assert check.faces["exit"].cutter.largest_radius_mm is None and check.faces["exit"].best_fit_sphere.pv_mm < 1e-6
    facts = {fact.key: fact.value for group in check_facts(check) for fact in group.facts}
    assert (facts["exit_sphere"], facts["exit_nose"]) == ("plane", "any")
