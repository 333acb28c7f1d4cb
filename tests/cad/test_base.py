"""Bases of every kind: closed forms of their bodies, arcs of the seat, and what is refused."""

import re

import cadquery as cq
import numpy as np
import pytest
from geometry_lenses import exact_volume, make_lens, plan_of, random_surface
from hypothesis import given, settings
from hypothesis import strategies as st
from known_shapes import sphere as sphere_at
from nightly import first_by_day, scaled

from lensforge.cad.form_error import fit_lens
from lensforge.cad.mesh import build_mesh, check_closed
from lensforge.cad.outline import FULL_TURN, outline_of
from lensforge.cad.plan import lay_out, make_plan, rim_directions
from lensforge.cad.solid import build_solid
from lensforge.cad.step import parse_step, step_bytes
from lensforge.errors import InputError
from lensforge.spec import BaseSection
from lensforge.surfaces.srbf import SrbfSurface
from lensforge.surfaces.step_file import parts_of

DISC = np.pi * 25.4**2 / 4.0
SEGMENT = 12.7**2 * np.arccos(11.0 / 12.7) - 11.0 * np.sqrt(12.7**2 - 11.0**2)
PLAIN = {"OPTICAL_INNER", "OPTICAL_OUTER", "BASE_SIDE", "BASE_BOTTOM", "BASE_BORE", "BASE_TOP"}
SQUARE = PLAIN - {"BASE_SIDE"} | {f"BASE_SIDE_{k}" for k in (1, 2, 3, 4)}
FLANGE = {"FLANGE_TOP", "FLANGE_SIDE"}
POCKET = {"POCKET_TOP", "POCKET_SIDE"}
RELIEF = {0.0: set(), 0.7: {"BASE_RELIEF"}}

# What each base has instead of, or besides, the plain cylinder: keys of the spec, its faces, volume below z = 0
# without the bore and the step (mm^3).
BASES = {
    "square": ({"kind": "square", "side_mm": 30.0}, SQUARE, 1800.0),
    "flat": ({"flat_mm": 11.0}, PLAIN | {"CLOCKING_FLAT"}, 2.0 * (DISC - SEGMENT)),
    "flange": ({"flange_diameter_mm": 32.0}, PLAIN | FLANGE, 1.5 * DISC + 0.5 * np.pi * 16.0**2),
    "pocket": ({"pocket_diameter_mm": 16.0}, PLAIN | POCKET, 2.0 * DISC - np.pi * 8.0**2),
    "square, pocket, flange": (
        {"kind": "square", "side_mm": 26.0, "pocket_diameter_mm": 16.0, "flange_diameter_mm": 40.0},
        SQUARE | FLANGE | POCKET,
        1.5 * 26.0**2 + 0.5 * np.pi * 20.0**2 - np.pi * 8.0**2,
    ),
}


def _whole(name):
    """The walls below a rim have a face for each edge of the rim."""
    return re.sub(r"(BORE|RELIEF|SIDE)_\d+$", r"\1", name)


def closed_form(inner, outer, base, below, relief):
    """Integrals over the surfaces, and prisms: the bore is the inner rim drawn down, the step the outer one."""
    azimuth = np.linspace(0.0, 2.0 * np.pi, 512, endpoint=False)
    opening, seat = (np.pi * np.mean(surface.radius(rim_directions(azimuth)) ** 2) for surface in (inner, outer))
    pocket = 0.0 if base.pocket_diameter_mm is None else base.pocket_depth_mm
    shell = exact_volume(inner, outer, BaseSection(kind="none"))
    area = below / 2.0 if base.flange_diameter_mm is None and not pocket else None
    area = area or {"square": base.side_mm**2, "cylinder": DISC}[base.kind]
    return shell + below - opening * (base.height_mm - pocket) - relief * (area - seat)


def sound(plan, volume):
    """The solid of a plan and its finer mesh, both closed and of the ``volume`` (mm^3), and the STEP file alike."""
    solid = build_solid(plan)
    assert solid.valid
    assert solid.volume_mm3 == pytest.approx(volume, rel=2e-9)
    again = parse_step(step_bytes(solid, "lens"))
    assert again.valid
    assert set(again.faces) == set(solid.faces)
    assert again.volume_mm3 == pytest.approx(solid.volume_mm3, rel=1e-9)
    coarse, fine = (build_mesh(plan, rings) for rings in (24, 48))
    closure = check_closed(fine.vertices, fine.triangles)
    assert (closure.watertight, closure.genus) == (True, 0)
    assert (4.0 * fine.volume() - coarse.volume()) / 3.0 == pytest.approx(volume, rel=2e-5)
    return solid, fine


# Each feature of a base by day, with a step and without; all pairs nightly.
PAIRS = [("square, pocket, flange", 0.7), ("flat", 0.0), ("square", 0.0), ("flange", 0.0), ("pocket", 0.7)]
PAIRS += [(name, relief) for name in BASES for relief in (0.0, 0.7) if (name, relief) not in PAIRS]


def frustum(top, foot, height):
    """Volume between two similar areas."""
    return height * (top + foot + np.sqrt(top * foot)) / 3.0


@pytest.mark.parametrize("section", [{"kind": "square", "side_mm": 30.0}, {"diameter_mm": 30.0, "flat_mm": 12.0}])
def test_the_piece_at_an_azimuth_of_any_turn_is_the_one_that_has_the_radius_there(section):
    """The first piece of a square begins at 45 degrees, that of a flat where it ends."""
    outline = outline_of(BaseSection(**section))
    for azimuth in np.linspace(-7.0, 14.0, 40):
        turned = outline._turned(np.array([azimuth]))
        radius = outline.piece_at(azimuth).radius(turned)
        x, y = radius[0] * np.cos(azimuth), radius[0] * np.sin(azimuth)
        if section.get("kind") == "square":
            assert max(abs(x), abs(y)) == pytest.approx(15.0)
        else:
            assert x == pytest.approx(12.0) if np.cos(azimuth) > 0.8 else radius[0] == pytest.approx(15.0)


@pytest.mark.parametrize("kind", ["cylinder", "square", "flange and pocket"])
def test_a_drafted_base_is_of_frusta_as_wide_as_stated_at_their_tops(kind):
    """Between concentric spheres; 3.4 mm high, the flange 0.9 and the pocket 1.1 of it, with 2.3 degrees."""
    slope = np.tan(np.radians(2.3))
    pi = np.pi
    sizes = {"height_mm": 3.4, "draft_deg": 2.3}
    if kind == "square":
        sizes |= {"kind": "square", "side_mm": 7.0}
        sides = frustum(7.0**2, (7.0 - 6.8 * slope) ** 2, 3.4)
    elif kind == "cylinder":
        sizes |= {"diameter_mm": 8.0}
        sides = frustum(pi * 4.0**2, pi * (4.0 - 3.4 * slope) ** 2, 3.4)
    else:
        sizes |= {"diameter_mm": 8.0, "flange_diameter_mm": 10.0, "flange_height_mm": 0.9}
        sizes |= {"pocket_diameter_mm": 3.0, "pocket_depth_mm": 1.1}
        sides = frustum(pi * 4.0**2, pi * (4.0 + 2.5 * slope) ** 2, 2.5)
        sides += frustum(pi * 5.0**2, pi * (5.0 - 0.9 * slope) ** 2, 0.9)
        sides -= frustum(pi * 1.5**2, pi * (1.5 + 1.1 * slope) ** 2, 1.1)
    bore = 2.3 if "pocket" in kind else 3.4
    hole = frustum(pi * 0.8**2, pi * (0.8 + bore * slope) ** 2, bore)
    plan = make_plan(*fit_lens(make_lens(0.8, 2.45, 0.0, base={"kind": "none"})), BaseSection(**sizes))
    solid, _ = sound(plan, 2.0 / 3.0 * pi * (2.45**3 - 0.8**3) + sides - hole)
    flat = {name for name, face in solid.faces.items() if cq.Face(face).geomType() == "PLANE"}
    cones = {_whole(name) for name, face in solid.faces.items() if cq.Face(face).geomType() == "CONE"}
    assert cones >= ({"FLANGE_SIDE", "POCKET_SIDE", "BASE_SIDE"} & {_whole(name) for name in set(solid.faces) - flat})
    assert kind != "square" or {f"BASE_SIDE_{k}" for k in (1, 2, 3, 4)} < flat, "planes and cones, no splines"


@pytest.mark.parametrize(
    ("sizes", "lacks"),
    [({"diameter_mm": 2.5}, "BASE_BOTTOM"), ({"diameter_mm": 8.0, "flange_diameter_mm": 8.4}, "FLANGE_TOP")],
)
def test_draft_that_leaves_nothing_of_a_base_is_refused(sizes, lacks):
    pair = fit_lens(make_lens(0.8, 2.45, 0.0, base={"kind": "none"}))
    for draft_deg in (1.0, 9.0):
        base = BaseSection(**sizes, height_mm=2.0, draft_deg=draft_deg)
        if draft_deg == 1.0:
            assert make_plan(*pair, base).has_base
        else:
            with pytest.raises(InputError, match=rf"base\.draft_deg = 9: leaves no {lacks};"):
                make_plan(*pair, base)


@pytest.mark.parametrize(("name", "relief"), first_by_day(2, PAIRS))
def test_every_base_is_one_closed_named_body_of_its_closed_form(name, relief):
    keys, faces, below = BASES[name]
    base = BaseSection(**keys, relief_step_mm=relief)
    inner = random_surface(6.0, 0.02, 3)
    outer = random_surface(10.2, 0.01, 4)
    plan = plan_of(inner, outer, base)
    volume = closed_form(inner, outer, base, below, relief)
    solid, fine = sound(plan, volume)
    assert {_whole(name) for name in solid.faces} == {_whole(name) for name in faces | RELIEF[relief]}
    assert len(parts_of(solid.shape, "FACE")) == len(solid.faces), "a face without a name"
    # The mesh does not tell the sides of a square apart, nor a flat from the rest of its side.
    assert {_whole(name) for name in solid.faces} - {"CLOCKING_FLAT"} == set(fine.names)


@pytest.mark.parametrize("width", first_by_day(1, [25.4, 15.0]))
def test_a_step_that_stands_back_from_the_rim_is_a_circle_all_around(width):
    inner = random_surface(6.0, 0.02, 3)
    outer = random_surface(10.2, 0.01, 4)
    base = BaseSection(diameter_mm=width, relief_step_mm=0.7, relief_setback_mm=0.3)
    plan = plan_of(inner, outer, base)
    rim = outer.radius(rim_directions(np.linspace(0.0, 2.0 * np.pi, 720)))
    wall = plan.ring.radius(np.array([0.0, 1.0]))
    assert wall == pytest.approx(rim.min() - 0.3, abs=1e-5)
    opening = np.pi * np.mean(inner.radius(rim_directions(np.linspace(0.0, 2.0 * np.pi, 512, endpoint=False))) ** 2)
    below = 0.7 * np.pi * wall[0] ** 2 + 1.3 * np.pi * width**2 / 4.0 - 2.0 * opening
    volume = exact_volume(inner, outer, BaseSection(kind="none")) + below
    solid, _ = sound(plan, volume)
    assert {"RIM", "BASE_RELIEF"} < {re.sub(r"_\d+$", "", name) for name in solid.faces}


# Each takes a second: a thousand of them nightly.
@settings(max_examples=min(scaled(12, by_day=2), 1000), deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 10_000),
    outer=st.floats(8.0, 13.7),
    kind=st.sampled_from(["cylinder", "square"]),
    width=st.floats(16.5, 30.0),
    extras=st.sets(st.sampled_from(["flat", "flange", "pocket", "relief", "setback"])),
)
def test_random_lenses_on_random_bases_are_valid_and_closed(seed, outer, kind, width, extras):
    content = {"kind": kind, "side_mm" if kind == "square" else "diameter_mm": width}
    content |= {"flat_mm": 0.45 * width} if "flat" in extras and kind == "cylinder" else {}
    content |= {"flange_diameter_mm": 1.6 * width} if "flange" in extras else {}
    content |= {"pocket_diameter_mm": 14.0} if "pocket" in extras else {}
    content |= {"relief_step_mm": 0.6} if extras & {"relief", "setback"} else {}
    content |= {"relief_setback_mm": 0.2} if "setback" in extras else {}
    try:
        plan = plan_of(random_surface(5.5, 0.02, seed), random_surface(outer, 0.02, seed + 1), BaseSection(**content))
    except InputError:  # a step below a rim that crosses the outline: tested below
        return
    mesh = build_mesh(plan, 16)
    closure = check_closed(mesh.vertices, mesh.triangles)
    assert (closure.status, closure.genus) == ("NoError", 0)
    solid = build_solid(plan)
    assert solid.valid
    assert len(parts_of(solid.shape, "FACE")) == len(solid.faces)
    assert closure.volume_mm3 == pytest.approx(solid.volume_mm3, rel=0.03)


@pytest.mark.parametrize(
    ("keys", "word"),
    [
        ({"kind": "square", "side_mm": 11.0}, r"base\.side_mm = 11: the cavity opens"),
        ({"diameter_mm": 10.0}, r"base.diameter_mm = 10: the cavity opens to 12 mm.*at least 12.02"),
        ({"flat_mm": 5.0}, r"base\.flat_mm = 5: the cavity opens.*at least 6\.01"),
        ({"relief_step_mm": 0.5, "relief_setback_mm": 4.0}, r"base\.relief_setback_mm = 4: .* at most 3\.99"),
        ({"pocket_diameter_mm": 11.0}, r"base\.pocket_diameter_mm = 11: from 12\.02"),
        ({"pocket_diameter_mm": 26.0}, r"base\.pocket_diameter_mm = 26: .* to 25\.38"),
    ],
)
def test_a_base_that_does_not_fit_is_refused_by_its_field(keys, word):
    with pytest.raises(InputError, match=word):
        plan_of(random_surface(6.0, 0.0, 0), random_surface(10.0, 0.0, 0), BaseSection(**keys))


def test_a_step_below_a_rim_that_crosses_the_outline_is_refused():
    with pytest.raises(InputError, match=r"base\.relief_step_mm = 0\.5: the wall of the step, .* meets"):
        plan_of(random_surface(6.0, 0.0, 0), random_surface(12.7, 0.02, 51), BaseSection(relief_step_mm=0.5))


@pytest.mark.parametrize(
    ("keys", "line"),
    [
        ({"relief_step_mm": 2.0}, "must"),
        ({"relief_setback_mm": 0.1}, "relief_setback_mm = 0.1 needs a relief_step_mm above 0, not 0"),
        (
            {"relief_step_mm": 1.6, "flange_diameter_mm": 30.0},
            "relief_step_mm = 1.6 and the flange's height, 0.5, must",
        ),
        ({"kind": "step"}, "give both, or neither"),
        ({"kind": "cylinder", "file": "clamp.step"}, "go"),
        ({"kind": "step", "file": "clamp.step", "relief_step_mm": 0.5}, "go"),
        ({"kind": "step", "file": "clamp.step", "height_mm": 3.0}, "height_mm = 3 does not go with kind = 'step'"),
        ({"pocket_diameter_mm": 20.0, "pocket_depth_mm": 2.0}, "must"),
        ({"flat_mm": 13.0}, "flat"),
        ({"kind": "square", "flat_mm": 10.0}, "flat"),
        ({"flange_diameter_mm": 25.0}, "flange_diameter_mm = 25: must exceed the width of the base, 25.4"),
        ({"pocket_depth_mm": 0.5}, "give both, or neither"),
        ({"flange_height_mm": 0.7}, "give both, or neither"),
        ({"side_mm": 20.0}, "go"),
        ({"kind": "square", "diameter_mm": 20.0}, "go"),
    ],
)
def test_heights_and_widths_that_contradict_each_other_are_refused(keys, line):
    with pytest.raises(InputError, match=r"^BaseSection: ") as caught:
        BaseSection(**keys)
    assert line in str(caught.value)


def sphere(radius):
    return random_surface(radius, 0.0, seed=0)


def test_arcs_go_once_around_and_change_over_exactly_on_the_cylinder():
    plan = plan_of(sphere(6.0), random_surface(12.65, 0.02, seed=2))
    starts, ends = np.array([[arc.start, arc.end] for arc in plan.arcs]).T
    assert len(plan.arcs) >= 2
    np.testing.assert_array_equal(ends, [*starts[1:], starts[0] + FULL_TURN])
    np.testing.assert_allclose(plan.envelope.radius(rim_directions(plan.crossings)), 12.7, atol=1e-11)
    for arc in plan.arcs:
        radius = plan.envelope.radius(rim_directions(np.linspace(arc.start, arc.end, 50)[1:-1]))
        assert ((radius > 12.7) == (arc.relation == "overhang")).all()


def test_surfaces_that_cross_are_refused_with_the_place():
    outer = sphere(2.45)
    weights = outer.weights_mm.copy()
    weights[0] = -1.8  # the first centre is the nearest to the axis
    with pytest.raises(InputError, match=r"wall = -0\.\d+ mm in the direction \(0\.\d+"):
        plan_of(sphere(0.8), SrbfSurface(outer.basis, weights, 2.45))


def test_walls_that_stand_back_go_round_the_farthest_and_the_nearest_place_of_rims_off_the_axis():
    """A cavity 0.5 mm aside reaches 2.5 mm, an outer sphere 1 mm aside comes as near as 5 mm; each limit from both
    sides.
    """
    inner = sphere_at(2.0, (0.3, -0.4, 0.0))
    outer = sphere_at(6.0, (-0.6, 0.8, 0.0))
    sizes = {"diameter_mm": 25.4, "height_mm": 2.0, "relief_step_mm": 0.5, "bore_setback_mm": 0.2}
    plan = lay_out(inner, outer, BaseSection(**sizes, relief_setback_mm=0.3))
    turn = np.linspace(0.0, 6.0, 9)
    assert plan.bore.radius(turn) == pytest.approx(np.full(9, 2.7), abs=1e-4)
    assert plan.ring.radius(turn) == pytest.approx(np.full(9, 4.7), abs=1e-4)
    for field, most, more in (
        ("relief_setback_mm", 5.0 - 2.7 - 0.01, {}),
        ("bore_setback_mm", 12.7 - 2.5 - 0.01, {"relief_step_mm": 0.0}),
        ("bore_setback_mm", 4.0 - 2.5 - 0.01, {"relief_step_mm": 0.0, "pocket_diameter_mm": 8.0}),
    ):
        lay_out(inner, outer, BaseSection(**{**sizes, **more, field: most - 1e-3}))
        with pytest.raises(InputError, match=rf"base\.{field} = .* at most {most:.4g}$"):
            lay_out(inner, outer, BaseSection(**{**sizes, **more, field: most + 1e-3}))
    for field, least in (("diameter_mm", 2.0 * 2.51), ("pocket_diameter_mm", 2.0 * 2.51)):
        make_plan(inner, outer, BaseSection(**{"diameter_mm": 25.4, field: least + 1e-3}))
        with pytest.raises(InputError, match=rf"base\.{field} = "):
            make_plan(inner, outer, BaseSection(**{"diameter_mm": 25.4, field: least - 1e-3}))
