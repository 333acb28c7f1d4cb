"""A moulded part by closed forms: what two halves draw of spheres and cones, the parting, the largest ball, cooling."""

from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from known_shapes import sphere
from presets import CHECKED
from scenes import random_surface, small_spec
from scipy.spatial import cKDTree
from shop_lenses import OfSpheres
from tir_lenses import spot, spot_lens

from lensforge.cad.form_error import fit_lens
from lensforge.cad.plan import lay_out
from lensforge.cad.wall import largest_ball
from lensforge.errors import InputError
from lensforge.shop.check_measures import Draft, FaceResult, InscribedBall, Mould, MouldedFace, PartingLine
from lensforge.shop.findings import draft_finding, undercut_finding
from lensforge.shop.mould_facts import PLASTICS, mould_facts, plastic_of
from lensforge.shop.mould_halves import Moulding, pieces_of
from lensforge.spec import BaseSection
from lensforge.spec.feasible import base_warnings
from lensforge.surfaces.reciprocal import ConeFace

NODES, TURN = 81, np.linspace(0.0, 2.0 * np.pi, 360, endpoint=False)
PROCESSES = "milled", "turned", "moulded", "printed"
NO_BASE, WIDE = {"kind": "none"}, {"kind": "cylinder", "diameter_mm": 14.0, "height_mm": 2.0}


def moulded(faces: dict[str, Any], spec: Any) -> Mould:
    lens = OfSpheres(faces, spec, 0, CHECKED)
    return Moulding.of(lens, fit_lens(lens, *[NODES] * len(faces))).mould()


def dome(base: dict[str, Any] = NO_BASE, **sections: Any) -> Mould:
    """A sphere of 5 mm about a place 2 mm above the origin, its equator at z = 2; a cavity of 2 mm."""
    faces = {"inner": sphere(2.0), "outer": sphere(5.0, (0.0, 0.0, 2.0))}
    return moulded(faces, small_spec(base=base, **sections))


def test_the_halves_of_a_sphere_meet_at_its_equator() -> None:
    mould = dome()
    outer, inner = mould.faces["outer"], mould.faces["inner"]
    assert outer.upper_fraction == pytest.approx(5.0 / 7.0, abs=1e-3), "a zone's area is its height"
    assert outer.lower_fraction == pytest.approx(2.0 / 7.0, abs=1e-3)
    assert (outer.undercut_fraction, outer.undercut_heights_mm, outer.draft_deg) == (0.0, None, 0.0)
    assert (inner.upper_fraction, inner.draft_deg) == (0.0, pytest.approx(0.0, abs=1e-3))
    assert inner.lower_fraction == pytest.approx(1.0)
    line = mould.parting
    assert (line.places, line.radius_mm) == (("outer",), pytest.approx(5.0, abs=1e-5))
    assert (line.low_mm, line.high_mm) == (pytest.approx(2.0, abs=1e-5), pytest.approx(2.0, abs=1e-5))
    assert mould.thickest.diameter_mm == pytest.approx(5.0, rel=1e-3) and mould.gate is None


@pytest.mark.parametrize(("wide_mm", "share"), [(9.0, 0.0), (14.0, 2.0 / 7.0), (9.6, None)])
def test_what_lies_over_a_base_is_undercut_below_the_equator(wide_mm: float, share: float | None) -> None:
    """Of a base within the rim, which is 4.58 mm from the axis, nothing is in the way; of one in between a part."""
    outer = dome({**WIDE, "diameter_mm": wide_mm}).faces["outer"]
    if share is None:  # up to where the sphere is as wide as the base
        share = (2.0 - np.sqrt(25.0 - (wide_mm / 2.0) ** 2)) / 7.0
    assert outer.undercut_fraction == pytest.approx(share, abs=1e-3)
    assert outer.upper_fraction + outer.lower_fraction == pytest.approx(1.0 - share, abs=1e-3)
    if share:
        assert outer.undercut_heights_mm == pytest.approx((0.0, 7.0 * share), abs=0.02)


@pytest.mark.parametrize("flange", [{}, {"flange_diameter_mm": 20.0, "flange_height_mm": 0.75}])
def test_a_drafted_base_parts_at_the_top_of_its_widest_side(flange: dict[str, Any]) -> None:
    """In one height, where the size is as stated; upright, in all of its heights."""
    base = {**WIDE, "diameter_mm": 16.0, "height_mm": 3.0, **flange}
    for draft_deg in (0.0, 1.5):
        line = dome({**base, "draft_deg": draft_deg}).parting
        top, height = (-2.25, 0.75) if flange else (0.0, 3.0)
        low = top if draft_deg else top - height
        assert (line.places, line.radius_mm) == (("base",), pytest.approx(10.0 if flange else 8.0))
        assert (line.low_mm, line.high_mm) == (pytest.approx(low), pytest.approx(top, abs=1e-9))
    drafts = {process: small_spec(base=base, manufacture__process=process).base_made.draft_deg for process in PROCESSES}
    assert drafts == {"milled": None, "turned": None, "moulded": 1.0, "printed": None}


def test_a_plate_is_in_the_way_of_its_lenses_and_parts_at_its_top() -> None:
    mould = dome(plate={"thickness_mm": 1.5}, constraints={"max_radius_mm": 8.0})
    assert mould.faces["outer"].undercut_fraction == pytest.approx(2.0 / 7.0, abs=1e-3)
    assert mould.parting == PartingLine(places=("plate",), radius_mm=None, low_mm=0.0, high_mm=0.0)
    assert mould.gate == "plate"


@pytest.mark.parametrize("draft_deg", [-12.0, -0.5, 1.0, 15.0])
def test_a_cone_is_drawn_by_the_half_that_it_widens_towards_with_its_own_draft(draft_deg: float) -> None:
    """A wall as a cone: from below where it widens upwards, from above where it narrows."""
    slope, exit_mm = float(np.tan(np.radians(draft_deg))), 5.0
    faces = {
        "cap": sphere(2.0, (0.0, 0.0, -0.5)),
        "side": ConeFace(6.0, 1.8, -float(np.tan(np.radians(3.0)))),
        "wall": ConeFace(14.0, 6.0, slope),
        "exit": sphere(40.0, (0.0, 0.0, exit_mm - 40.0)),
    }
    mould = moulded(faces, spot().replace(base=NO_BASE))
    wall, side, line = mould.faces["wall"], mould.faces["side"], mould.parting
    assert wall.draft_deg == pytest.approx(abs(draft_deg), abs=5e-3)
    assert side.draft_deg == pytest.approx(3.0, abs=2e-3) and side.lower_fraction == pytest.approx(1.0)
    assert (wall.lower_fraction, wall.upper_fraction)[draft_deg < 0.0] == pytest.approx(1.0)
    assert line.places == (("wall", "base") if draft_deg < 0.0 else ("exit", "wall"))
    top = max(line.high_mm, 0.0)
    assert line.radius_mm == pytest.approx(6.0 + slope * top, abs=2e-3)


def test_a_wall_that_widens_above_a_plate_or_a_base_is_undercut_and_the_spec_says_so_first() -> None:
    """All of it, of any size: the plate goes on beside the lens. A flange at the rim leaves it free."""
    printed = {"manufacture": {"process": "printed"}, "plate": {"thickness_mm": 2.0}}
    for shape in (spot(), spot(side={"offset_mm": 1.6}, exit={"flat": True})):
        lens = spot_lens(shape, base=NO_BASE, **printed)
        wall = Moulding.of(lens, fit_lens(lens)).mould().faces["wall"]
        assert wall.undercut_fraction == pytest.approx(1.0) and wall.undercut_heights_mm is not None
        with pytest.raises(InputError, match=r"plate: the wall of .* 'tir' widens above it.*\[lens\.flange\]"):
            lens.spec.replace({"manufacture.process": "moulded"})
    wide, limits = spot().base, spot().constraints
    (warning,) = base_warnings(spot().lens, limits, wide, "moulded")
    assert warning.startswith("base: the wall of lens.kind = 'tir' widens above it") and "base.kind = 'none'" in warning
    narrow = wide.changed(diameter_mm=15.9)
    others = (spot().lens, narrow, "turned"), (spot().lens, wide, "printed"), (small_spec().lens, wide, "moulded")
    assert not any(base_warnings(shape, limits, base, process) for shape, base, process in others)


def test_a_flange_is_the_widest_and_a_place_for_the_gate() -> None:
    lens = spot_lens(spot(flange={"diameter_mm": 20.0, "thickness_mm": 1.2}), base=NO_BASE)
    mould = Moulding.of(lens, fit_lens(lens)).mould()
    line = mould.parting
    assert (line.places, line.radius_mm, mould.gate) == (("flange",), pytest.approx(10.0), "flange")
    assert line.high_mm - line.low_mm == pytest.approx(1.2)
    assert mould.faces["wall"].lower_fraction == pytest.approx(1.0) == mould.faces["exit"].upper_fraction


def test_a_mould_fills_the_flange_before_the_base() -> None:
    spec = spot(flange={"diameter_mm": 20.0, "thickness_mm": 1.2}).replace(
        base={"kind": "cylinder", "diameter_mm": 7.0}
    )
    lens = spot_lens(spec)
    assert Moulding.of(lens, fit_lens(lens)).mould().gate == "flange"


def revolved(*corners: tuple[float, float]) -> np.ndarray:
    """Points of a section at all azimuths, 160 along each of its sides."""
    along = (np.arange(160) / 160)[:, None]
    line = np.concatenate([
        np.array(a) + along * (np.array(b) - np.array(a)) for a, b in pairwise(corners)
    ])  # fmt: skip
    axes = np.stack([np.cos(TURN), np.sin(TURN)], axis=1)
    return np.concatenate([line[None, :, :1] * axes[:, None], np.tile(line[None, :, 1:], (len(TURN), 1, 1))], axis=2)


def test_the_largest_ball_of_a_slab_is_as_thick_as_that() -> None:
    diameter, centre = largest_ball(revolved((0.0, 4.0), (10.0, 4.0), (10.0, 0.0), (0.0, 0.0)))
    assert diameter == pytest.approx(4.0, rel=2e-3) and centre[2] == pytest.approx(2.0, abs=2e-2)


def test_the_largest_ball_of_a_cone_touches_base_and_side() -> None:
    """Of a section of sides 3, 4 and 5 about its axis: the radius of the circle inscribed in both halves of it."""
    diameter, centre = largest_ball(revolved((0.0, 4.0), (3.0, 0.0), (0.0, 0.0)))
    assert diameter == pytest.approx(3.0, rel=2e-3), "area 12, perimeter 16"
    assert centre == pytest.approx([0.0, 0.0, 1.5], abs=2e-2)


def test_the_largest_ball_in_a_freeform_body_has_no_rival() -> None:
    """None of 20,000 balls about random places in the wall is larger, and nothing of the body's boundary is in it."""
    lens = OfSpheres(
        {"inner": random_surface(1, 3.0, 0.04), "outer": random_surface(2, 6.0, 0.04)}, small_spec(), 0, CHECKED
    )
    plan = lay_out(*fit_lens(lens, NODES, NODES), BaseSection(kind="none"))
    diameter, centre = largest_ball(
        np.concatenate([piece.points for piece in pieces_of(plan, azimuths=360, along=96)], axis=1)
    )
    rng = np.random.default_rng(3)
    z, turn, share = rng.random(20_000), 2.0 * np.pi * rng.random(20_000), rng.random((20_000, 1))
    u = np.column_stack([np.sqrt(1.0 - z**2) * np.cos(turn), np.sqrt(1.0 - z**2) * np.sin(turn), z])
    low, high = (face.radius(u)[:, None] * u for face in (lens.inner, lens.outer))
    flat = rng.random((20_000, 1)) * high[:20_000]
    flat[:, 2] = 0.0  # the level ring between both rims
    ring = flat[np.hypot(*flat.T[:2]) > 2.0]
    ring = ring[np.linalg.norm(ring, axis=1) > lens.inner.radius(ring / np.linalg.norm(ring, axis=1)[:, None])]
    tree = cKDTree(np.concatenate([low, high, ring]))
    rivals = tree.query(low + share * (high - low))[0]
    assert 2.0 * rivals.max() < diameter * (1.0 + 2e-3)
    assert 2.0 * tree.query(centre)[0] > diameter * (1.0 - 2e-3)


def test_a_slab_of_acrylic_cools_as_by_hand() -> None:
    """4 mm: 16 / (9.8696 x 0.11) = 14.738; 4/pi x 170/25 = 8.6580, its logarithm 2.1585; 31.81 s."""
    assert PLASTICS["pmma"].cooling_s(4.0) == pytest.approx(31.81, abs=0.005)
    assert PLASTICS["pmma"].cooling_s(8.0) == pytest.approx(4.0 * 31.81, abs=0.02)
    low, high = PLASTICS["pmma"].cooling_range_s(4.0)  # 16 / pi^2 / 0.132 ln(4/pi 180/35), and with 0.088 and 160/15
    assert (low, high) == (pytest.approx(23.08, abs=0.005), pytest.approx(48.06, abs=0.005))
    assert plastic_of("PMMA at 564 nm") is plastic_of("pmma") and plastic_of("PC") is PLASTICS["pc"]
    assert plastic_of("silicone") is plastic_of("a plastic") is plastic_of("") is None


FACE = MouldedFace(upper_fraction=1.0, lower_fraction=0.0, undercut_fraction=0.0, draft_deg=3.0)
LINE = PartingLine(places=("outer",), radius_mm=5.0, low_mm=2.0, high_mm=2.0)


def facts(
    spec: Any, ratio: float = 2.0, line: PartingLine = LINE, gate: str | None = None, **changes: Any
) -> dict[str, Any]:
    plastic = plastic_of(spec.lens.material)
    mould = Mould(
        faces={"outer": FACE.changed(**changes)},
        parting=line,
        thickest=InscribedBall(diameter_mm=1.5 * ratio, centre_mm=(0.0, 0.0, 1.0)),
        gate=gate,
        cooling_s=None if plastic is None else plastic.cooling_s(1.5 * ratio),
    )
    check = SimpleNamespace(min_wall_mm=1.5, edges=(), spec=spec)
    return {fact.key: fact for fact in mould_facts(mould, check)}


def test_what_a_moulder_is_told() -> None:
    spec = small_spec()
    shown = facts(spec)
    assert shown["parting"].value == "the widest of the outer" and "5 mm from the axis at most, z = 2 mm" in plain(
        shown["parting"].note
    )
    assert shown["gate"].value == "none" and "a base, a flange or a plate" in shown["gate"].notice
    assert facts(spot())["gate"].notice.startswith("give it a flange: ")
    assert (
        facts(spec, gate="flange")["gate"].notice == ""
        and facts(spec, gate="base")["gate"].value == "at the side of the base"
    )
    for ratio, sinks in ((2.999, False), (3.001, True)):
        fact = facts(spec, ratio)["thickness_ratio"]
        assert fact.value == pytest.approx(ratio) and bool(fact.notice) == sinks and "at most 3" in fact.note
    assert "13 to 27 s for ±20 %" in plain(shown["cooling"].note)
    assert "estimate" in shown["cooling"].note and shown["cooling"].value == pytest.approx(
        PLASTICS["pmma"].cooling_s(3.0)
    )
    for material, phrase in (("silicone resin", "cures"), ("a plastic", "thermal data of a plastic not known")):
        fact = facts(small_spec(lens__material=material, lens__refractive_index=1.41))["cooling"]
        assert fact.value == "no estimate" and phrase in fact.note
    crease = PartingLine(places=("exit", "wall"), radius_mm=5.0, low_mm=3.0, high_mm=3.25)
    fact = facts(spec, line=crease)["parting"]
    assert fact.value == "where exit and wall meet" and "z = 3 to 3.25 mm" in plain(fact.note)
    ledge = PartingLine(places=("base",), radius_mm=8.0, low_mm=-2.0, high_mm=0.0)
    assert facts(spec, line=ledge, gate="base")["inner_corners"].value == "base and outer"
    assert shown["inner_corners"].value == "none"
    both = facts(spec, upper_fraction=0.5, lower_fraction=0.25, undercut_fraction=0.25)["outer_drawn"]
    assert (both.value, both.unit) == (75.0, "%") and "by both halves" in both.note


def plain(text: str) -> str:
    return text.replace("\u2009", " ")


def test_an_undercut_is_judged_by_its_share_and_the_draft_by_what_is_drawn() -> None:
    spec = small_spec(manufacture__process="moulded", base={"kind": "cylinder"})
    whole = undercut_finding("outer", FACE, spec)
    assert (
        whole.holds
        and (whole.value, whole.limit) == (0.0, 0.0)
        and whole.note == "the upper half of the mould releases the outer face"
    )
    split = undercut_finding("outer", FACE.changed(upper_fraction=0.5, lower_fraction=0.5), spec)
    assert split.holds and split.note == "both halves of the mould release the outer face"
    hidden = FACE.changed(upper_fraction=0.9, undercut_fraction=0.1, undercut_heights_mm=(0.0, 0.4561))
    finding = undercut_finding("outer", hidden, spec)
    assert (
        not finding.holds
        and finding.value == 0.1
        and "10 % of the outer face is undercut, from z = 0 to 0.46 mm" in plain(finding.note)
    )
    assert finding.remedy == 'base.kind = "none", or a narrower base', "its draft is enough, the base is in the way"
    steep = undercut_finding("outer", hidden.changed(draft_deg=0.0), spec.replace({"base.kind": "none"}))
    assert steep.remedy == "lens.outer.draft_deg = 2 and design again"
    signed = FaceResult.model_construct(draft_deg=Draft(min=-9.0), undercut_fraction=0.5)
    for draft_deg, holds in ((2.0, True), (1.981, True), (1.979, False), (None, False)):
        finding = draft_finding("outer", signed, spec, FACE.changed(draft_deg=draft_deg))
        assert finding.holds == holds and finding.value == draft_deg
