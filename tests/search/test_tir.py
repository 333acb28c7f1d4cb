"""A lens for total internal reflection from its spec: start, tables, derivatives, limits, and a short search."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import torch
from nightly import first_by_day
from presets import FEW_STEPS
from scenes import small_spec
from tir_lenses import SPOT, margins_but_for_the_wall, spot, wall_not_measured

import lensforge as lf
from lensforge.cad.boundary import boundaries, sharpest_edges
from lensforge.errors import InputError
from lensforge.kernels.traced_body import REFLECTED
from lensforge.light.table_trace import TracedBundle
from lensforge.scene.body import Body, nearest
from lensforge.search.constraints import AugmentedLagrangian
from lensforge.search.feasibility import measure_constraints
from lensforge.search.light_path import SearchParts
from lensforge.search.merit import MeritFunction
from lensforge.search.profiles import FaceParameters, ProfileParameters
from lensforge.search.scene_symmetry import settled_symmetry
from lensforge.search.start_faces import start_faces
from lensforge.sources.build_source import build_source
from lensforge.spec import Spec, parse_spec
from lensforge.surfaces.bicubic_table import evaluate_table, tabulate
from lensforge.surfaces.srbf import fibonacci_hemisphere

EDGES = {"min_edge_angle_deg": 66.0}
PLANE = {"kind": "asphere", "vertex_z_mm": 9.0, "radius_mm": -1e3}


@cache
def begun(*levels: int) -> ProfileParameters:
    """Parameters of the spot's lens with these levels beside its profiles."""
    return ProfileParameters.of(spot(levels=list(levels)), 2.5)


def moved(parameters: ProfileParameters, size: float) -> tuple[torch.Tensor, torch.Tensor]:
    """Parameters beside the start, the same for every test."""
    rng = np.random.default_rng(5)
    (weights, offsets) = parameters.start()
    return weights + size * torch.from_numpy(rng.normal(size=weights.shape)), offsets + size


def share_within(spec: Spec, tables: np.ndarray, scene: object, degrees: float) -> float:
    rays = build_source(spec.source, None).sample(2**15, 77)
    exits = TracedBundle.of(tables, scene, rays).exits
    inside = exits.left_lens & (exits.directions[:, 2] > np.cos(np.radians(degrees)))
    return float(exits.flux[inside].sum() / rays.flux.sum())


@pytest.mark.parametrize("levels", [[], [9]])
def test_tables_are_those_of_the_faces_in_the_record(levels: list[int]) -> None:
    parameters = begun(*levels)
    assert parameters.levels == (8, *levels)
    weights, offsets = moved(parameters, 0.01)
    tables = parameters.tables(weights, offsets)
    grid = parameters.grid
    above = fibonacci_hemisphere(2000)
    for table, (name, surface) in zip(tables, parameters.surfaces(weights, offsets).items(), strict=True):
        exact = tabulate(grid, surface)
        if not levels:
            assert np.allclose(table.numpy(), exact, rtol=0.0, atol=1e-9), name
        off = evaluate_table(grid, table.numpy() - exact, above)  # sums of functions leave out what is negligible
        assert np.abs(off).max() < 3e-5, name
    lens = parameters.lens(weights, offsets, spot(levels=levels), 0, "draft")
    again = parameters.tables(*parameters.parameters_of(lens))
    assert np.allclose(again.numpy(), tables.numpy(), rtol=0.0, atol=1e-6)


def test_a_profile_bends_over_its_part_of_the_body_and_a_tenth_of_a_cosine_beyond() -> None:
    parameters = begun()
    body = Body.of(parameters.start_surfaces, spot(levels=[]).lens.body_roles)
    u = fibonacci_hemisphere(20_000)
    ends = []
    for face, shape in zip(body.faces, parameters.parameters, strict=True):
        if isinstance(shape, FaceParameters):
            faces = body.bounding(face.before)
            cosines = u[nearest(faces, u) == faces.index(face), 2]
            within = max(cosines.min() - 0.1, -0.1), min(cosines.max() + 0.1, 1.0)
            assert (shape.basis.low, shape.basis.high) == pytest.approx(within, abs=0.01), face.name
            ends += within
    assert min(ends) < 0.0 and any(0.0 < end < 0.99 for end in ends), "some end within the hemisphere"


def test_a_lens_with_levels_is_taken_up_from_a_start_with_other_bounds() -> None:
    """A start that has moved has profiles over other angles: they and the functions are fitted, and count once."""
    parameters = begun(4, 9)
    above = fibonacci_hemisphere(4000)
    lens = parameters.lens(*moved(parameters, 0.01), spot(levels=[4, 9]), 0, "draft")
    other = ProfileParameters.of(spot(levels=[4, 9]).replace(constraints={"max_radius_mm": 8.3}), 2.5)
    assert other.parameters[0].basis != parameters.parameters[0].basis
    again = other.surfaces(*other.parameters_of(lens))
    for name in ("cap", "wall"):
        basis = parameters.parameters[parameters.names.index(name)].basis
        there = other.parameters[parameters.names.index(name)].basis
        seen = above[(above[:, 2] > max(basis.low, there.low, 0.0)) & (above[:, 2] < min(basis.high, there.high))]
        was = lens.surfaces[name].radius(seen)
        now = again[name].radius(seen)
        assert np.abs(now - was)[was < 9.0].max() < 0.02, name  # mm, where it may bound the lens


def oval(width_deg: float, **lens: Any) -> Spec:
    target = {"kind": "ellipse", "width_deg": width_deg, "height_deg": 20.0, "half_angle_deg": 60.0}
    content = {**SPOT, "lens": {**SPOT["lens"], "levels": [9], **lens}, "target": target}
    spec = parse_spec({**content, "optimise": {"steps_per_level": [1, 1]}, "limits": []}, "oval")
    return settled_symmetry(spec, build_source(spec.source, None))


def test_a_beam_wider_than_the_source_makes_it_has_the_start_of_the_narrower_one() -> None:
    starts = [start_faces(oval(width)) for width in (60.0, 90.0)]
    assert starts[0]["cap"] == starts[1]["cap"]
    # light that goes up at 20 degrees meets the cap, at 40 degrees the side: a cap as a lens, a wall around it
    up, aside = (np.array([[np.sin(at), 0.0, np.cos(at)]]) for at in np.radians((20.0, 40.0)))
    assert starts[0]["cap"].radius(up) < starts[0]["side"].radius(up)
    assert starts[0]["cap"].radius(aside) > starts[0]["side"].radius(aside)


def test_the_radius_of_a_freeform_lens_is_held_where_wall_and_exit_meet() -> None:
    spec = oval(60.0)
    assert spec.lens.basis.symmetry == "rectangle"
    parameters = ProfileParameters.of(spec, 2.5)
    weights, offsets = moved(parameters, 0.01)
    constraints = AugmentedLagrangian.of(spec, parameters.grid)
    margin = constraints.least(constraints.fields(parameters.tables(weights, offsets)))["radius_margin_mm"]
    faces = parameters.surfaces(weights, offsets)
    polar, azimuth = (
        coordinates.ravel()
        for coordinates in np.meshgrid(np.linspace(0.0, 0.5 * np.pi, 4000), np.linspace(0.0, 3.14, 97))
    )
    across = np.sin(polar)
    directions = np.column_stack([across * np.cos(azimuth), across * np.sin(azimuth), np.cos(polar)])
    rim = across * np.minimum(faces["wall"].radius(directions), faces["exit"].radius(directions))
    assert margin == pytest.approx(spec.constraints.max_radius_mm - rim.max(), abs=0.008)


def test_the_derivative_of_the_merit_counts_light_that_crosses_creases() -> None:
    spec = spot()
    parameters = begun()
    source = build_source(spec.source, None)
    merit = MeritFunction.of(spec, source, parameters)
    without = MeritFunction(spec, parameters, type(merit.light)(merit.light.scene, merit.light.receivers), merit.terms)
    weights, offsets = moved(parameters, 0.003)
    along = torch.tensor([1.0, -1.0, 0.0, 0.0], dtype=torch.float64)  # cap and side against each other: their crease
    rays = source.sample(2**16, 3)

    def loss(moved: torch.Tensor, function: MeritFunction = merit) -> torch.Tensor:
        return function.terms[0].loss(function.light_of(parameters.tables(weights, moved), rays).images[0], False)

    step = 3.2e-2
    slopes = []
    slope = (loss(offsets + step * along) - loss(offsets - step * along)).item() / (2.0 * step)
    for merit_function in (merit, without):
        moving = offsets.clone().requires_grad_()
        loss(moving, merit_function).backward()
        slopes.append(float((moving.grad * along).sum()))
    assert slopes[0] == pytest.approx(slope, rel=0.06)
    assert abs(slopes[1] - slope) > 0.2 * abs(slope), "which no light without the crease explains"


@pytest.mark.parametrize("along", first_by_day(1, [[1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]))
def test_the_derivative_through_made_parts_counts_it_too(along: list[float]) -> None:
    """Of parts whose LED is out of place, tilted, and of another size: the creases are seen from there."""
    amounts = {"source_shift_mm": 0.2, "source_height_mm": 0.1, "source_size": 0.05, "source_flux": 0.2}
    spec = spot().replace(optimise={"robust": True}, tolerances={**amounts, "lens_tilt_deg": 0.5})
    source = build_source(spec.source, None)
    parameters = begun()
    merit = MeritFunction.of(spec, source, parameters)
    pairs = SearchParts.of(spec, parameters).of_step(0, 3)
    (weights, offsets) = parameters.start()
    rays = source.sample(2**15, 3)
    assert abs(pairs[0][0].made.source.origin_mm[0]) > 0.03 and pairs[0][0].flux != 1.0

    def loss(moved: torch.Tensor, function: MeritFunction = merit) -> torch.Tensor:
        return function.training_loss(function.light_of(parameters.tables(weights, moved), rays, pairs), False).loss

    step = 8e-3
    direction = torch.tensor(along, dtype=torch.float64)
    slope = float(loss(offsets + step * direction) - loss(offsets - step * direction)) / (2.0 * step)
    slopes = []
    for merit_function in (merit, replace(merit, light=replace(merit.light, source=None))):
        moving = offsets.clone().requires_grad_()
        loss(moving, merit_function).backward()
        slopes.append(float((moving.grad * direction).sum()))
    assert slopes[0] == pytest.approx(slope, abs=0.015) and abs(slopes[1] - slope) > 0.06


def test_rays_of_half_the_flux_have_half_the_derivative() -> None:
    """Slices of a sample, lenses of one kind of several, and parts whose LED is brighter have other fluxes."""
    spec = spot()
    parameters = begun()
    source = build_source(spec.source, None)
    light = MeritFunction.of(spec, source, parameters).light
    (weights, offsets) = parameters.start()
    rays = source.sample(2**12, 3)
    slopes = []
    for some in (rays, replace(rays, flux=0.5 * rays.flux)):
        moving = offsets.clone().requires_grad_()
        light.collect(parameters.tables(weights, moving), some)[0].image[24:40].sum().backward()
        slopes.append(moving.grad.numpy())
    assert np.allclose(slopes[1], 0.5 * slopes[0], rtol=1e-9) and np.abs(slopes[0]).max() > 1e-3


@pytest.mark.parametrize("along", first_by_day(1, [[0.0, 0.0, 0.0, 1.0], [1.0, -1.0, 0.0, 0.0]]))
def test_the_derivative_of_a_share_of_the_parts_counts_it_once(along: list[float]) -> None:
    """Each of four pairs has a quarter of the rays, and of the light that crosses creases."""
    limits = [{**SPOT["limits"][0], "at_least_share": 0.95}]
    amounts = {"source_shift_mm": 0.2, "source_flux": 0.2}
    spec = spot().replace(optimise={"robust": 0.9}, tolerances=amounts, limits=limits)
    source = build_source(spec.source, None)
    parameters = begun()
    merit = MeritFunction.of(spec, source, parameters)
    pairs = SearchParts.of(spec, parameters).of_step(0, 3)
    (weights, offsets) = parameters.start()
    rays = source.sample(2**15, 3)

    def term(moved: torch.Tensor) -> torch.Tensor:
        light = merit.light_of(parameters.tables(weights, moved), rays, pairs)
        return merit.training_loss(replace(light, terms=0.0 * light.terms), False).loss

    step = 1.6e-2
    direction = torch.tensor(along, dtype=torch.float64)
    moving = offsets.clone().requires_grad_()
    slope = float(term(offsets + step * direction) - term(offsets - step * direction)) / (2.0 * step)
    term(moving).backward()
    assert len(pairs) == 4 and float((moving.grad * direction).sum()) == pytest.approx(slope, rel=0.25)


def test_a_robust_search_takes_parts_in_its_steps() -> None:
    amounts = {"source_shift_mm": 0.2, "source_height_mm": 0.2}
    spec = spot().replace(optimise={"robust": True, "steps_per_level": [1]}, tolerances=amounts)
    with wall_not_measured():
        plain_spec = spec.replace(optimise={"robust": False})
        robust, plain = (lf.design(case, accuracy=FEW_STEPS) for case in (spec, plain_spec))
    assert robust.lens != plain.lens and all(criterion.holds for criterion in robust.criteria)
    assert robust.history[0].loss[0] > plain.history[0].loss[0] + 0.003, "parts are worse than the lens as designed"


def test_limits_of_four_faces_are_those_of_the_body() -> None:
    spec = spot()
    parameters = begun()
    weights, offsets = moved(parameters, 0.01)
    constraints = AugmentedLagrangian.of(spec, parameters.refined().grid)
    least = constraints.least(constraints.fields(parameters.refined().tables(weights, offsets)))
    margins = measure_constraints(parameters.lens(weights, offsets, spec, 0, "draft"))
    for name in ("cavity_clearance_mm", "wall_margin_mm", "radius_margin_mm"):
        assert least[name] == pytest.approx(getattr(margins, name), abs=0.01), name


@pytest.mark.parametrize("levels", [[], [9]])
def test_a_flat_exit_stays_a_plane_and_only_its_height_moves(levels: list[int]) -> None:
    spec = spot(levels=levels, exit={"flat": True})
    parameters = ProfileParameters.of(spec, 2.5)
    weights, offsets = moved(parameters, 0.01)
    height = parameters.start_surfaces["exit"].radius(np.array([[0.0, 0.0, 1.0]]))[0]
    above = fibonacci_hemisphere(2000)
    above = above[above[:, 2] > 0.85]  # where the exit bounds the body
    lens = parameters.lens(weights, offsets, spec, 0, "draft")
    exit_z = lens.surfaces["exit"].radius(above) * above[:, 2]
    assert exit_z == pytest.approx(np.full(len(above), 1.01 * height), rel=1e-12)
    tables = parameters.tables(weights, offsets)
    assert evaluate_table(parameters.grid, tables[3].numpy(), above) * above[:, 2] == pytest.approx(exit_z, rel=1e-6)
    assert np.allclose(parameters.tables(*parameters.parameters_of(lens)).numpy(), tables.numpy(), atol=1e-6)
    start = ProfileParameters.of(spot(exit={"flat": True, "offset_mm": 9.2}), 2.5).start_surfaces["exit"]
    assert start.radius(above) * above[:, 2] == pytest.approx(np.full(len(above), 9.2), rel=1e-12)


@pytest.mark.parametrize("levels", first_by_day(1, [[9], []]))
def test_edges_in_the_search_are_those_of_the_faces_and_have_their_derivative(levels: list[int]) -> None:
    spec = spot(levels=levels).replace(constraints={"min_edge_angle_deg": 70.0})
    parameters = begun(*levels)
    weights, offsets = moved(parameters, 0.01)
    constraints = AugmentedLagrangian.of(spec, parameters.grid)
    margins = margins_but_for_the_wall(parameters.lens(weights, offsets, spec, 0, "draft")).edge_margin_deg
    along = torch.from_numpy(np.random.default_rng(2).normal(size=weights.shape))
    numbers = [constraints.keys.index(f"{name}_edge_margin_deg") for name in margins]

    def edges(size: torch.Tensor) -> torch.Tensor:
        fields = constraints.fields(parameters.tables(weights + size * along, offsets))
        return torch.stack([fields[number].min() / constraints.constraints[number].factor for number in numbers])

    none = torch.zeros((), dtype=torch.float64)
    step = torch.tensor(1e-5, dtype=torch.float64)
    assert edges(none).numpy() == pytest.approx(np.array(list(margins.values())), abs=0.01)
    differences = (edges(step) - edges(-step)) / (2.0 * step)
    assert torch.autograd.functional.jacobian(edges, none).numpy() == pytest.approx(differences.numpy(), rel=1e-5)


@pytest.mark.nightly("ten seconds; by day edges in the search have their derivative, and another search is made")
def test_a_search_keeps_the_edges_that_are_asked_for() -> None:
    kept = lf.design(spot().replace(constraints=EDGES), accuracy="draft")
    start = Body.of(start_faces(kept.lens.spec), kept.lens.spec.lens.roles)
    least = [
        min(edge.angle_deg for side in boundaries(body) for edge in sharpest_edges(side))
        for body in (start, kept.lens.body)
    ]
    assert least[0] < 63.0 and least[1] > 66.0 - 0.01
    assert {"cap edge margin", "wall edge margin"} <= {criterion.key for criterion in kept.criteria if criterion.holds}


@pytest.mark.nightly("twenty seconds; by day that of a reflector, by the same parameters")
def test_a_short_search_gains_light_and_keeps_the_limits(tmp_path: object) -> None:
    spec = spot()
    design = lf.design(spec, accuracy="draft")
    merit = MeritFunction.of(spec, build_source(spec.source, None), ProfileParameters.of(spec, 2.5))
    parameters = merit.parametrisation
    start, end = (
        share_within(spec, parameters.tables(*point).numpy(), merit.light.scene, 10.0)
        for point in (parameters.start(), parameters.parameters_of(design.lens))
    )
    assert end > start + 0.003 and end > 0.9
    limits = design.lens.spec.constraints
    assert design.constraints.radius_margin_mm > -limits.tolerance_mm
    assert design.constraints.wall_margin_mm > -limits.tolerance_mm
    path = tmp_path / "lens.json"
    design.lens.save(path)
    assert lf.load_lens(path) == design.lens
    light = lf.evaluate(design.lens, rays=2**15)
    assert sum(vars(light.flux).values()) == pytest.approx(1.0, abs=1e-12)
    assert light.limits[0].value == pytest.approx(end, abs=0.004)
    assert light.possible.efficiency > light.efficiency.value


def test_a_search_starts_at_the_offsets_that_are_given() -> None:
    up = np.array([[0.0, 0.0, 1.0]])
    aside = np.array([[1.0, 0.0, 0.0]])
    given = {"cap": (2.5, up), "side": (1.6, aside), "wall": (3.1, aside), "exit": (9.2, up)}
    start = start_faces(spot(**{name: {"offset_mm": offset_mm} for name, (offset_mm, _) in given.items()}))
    for name, (offset_mm, direction) in given.items():
        assert start[name].radius(direction)[0] == pytest.approx(offset_mm, rel=1e-4), name


def test_a_silvered_wall_keeps_its_share_of_the_light_that_it_turns() -> None:
    through = []
    for wall in ({}, {"mirror": 0.9}):
        spec = spot(wall=wall)
        source = build_source(spec.source, None)
        parameters = ProfileParameters.of(spec, 2.5)
        scene = MeritFunction.of(spec, source, parameters).light.scene
        tables = parameters.tables(*parameters.start()).numpy()
        through.append(TracedBundle.of(tables, scene, source.sample(2**12, 1)))
    bare, silvered = through
    wall_number = bare.scene.names.index("wall")
    at_wall = bare.met // 4 == wall_number
    same = (bare.met == silvered.met).all(axis=1) & bare.exits.left_lens  # a wall that leaks reflects where silvered
    turned = (at_wall & (bare.met % 4 >= REFLECTED)).sum(axis=1) == 1
    turned &= same
    assert turned.any() and (~turned & bare.exits.left_lens).any()
    ratio = silvered.exits.flux / bare.exits.flux
    assert ratio[turned] == pytest.approx(np.full(turned.sum(), 0.9), abs=2e-3)
    assert ratio[same & ~at_wall.any(axis=1)] == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"lens": {"kind": "tir", "refractive_index": 1.2}}, "index = 1.2: the wall reflects totally from .* a mirror"),
        (
            {"lens": {"kind": "tir", "exit": {"offset_mm": 1.5}}},
            "wall, exit must lie outside of cap, side; change lens",
        ),
        (
            {"target": {**SPOT["target"], "diameter_deg": 2.0}},
            r"upper bound .* \(étendue\) .* a larger lens \(>= [\d.]+ mm\)",
        ),
        ({"constraints": {"max_radius_mm": 1.2}}, "do not fit into max_radius_mm|radius"),
        ({"lens": {"kind": "tir", "refractive_index": 1.05}}, "raise the index"),
        ({"lens": {"kind": "tir", "side": {"draft_deg": 24.0}}}, "lens: cone: slope"),
        ({"lens": {"kind": "tir", "levels": "auto"}}, "lens.levels"),
        ({"lens": {"kind": "prism"}}, "double, extruded, extruded_tir, tir"),
        (
            {"lens": {}, "optimise": {}, "constraints": {"max_radius_mm": 8.0, **EDGES}},
            "min_edge_angle_deg = 66: .* no edge",
        ),
        ({"lens": {"kind": "tir", "exit": {"flat": True, "fixed": PLANE}}}, "give one of flat"),
        ({"lens": {"inner": {"mirror": 0.9}}}, "no light would leave"),
        ({"lens": {"kind": "tir", "wall": {"mirror": 0.9, "coating": {"reflectance": 0.1}}}}, "coating and mirror"),
        ({"lens": {"kind": "tir", "inner": {"offset_mm": 3.0}}}, "lens.inner"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(changes: dict, message: str) -> None:
    with pytest.raises(lf.InputError, match=message) as caught:
        lf.design(parse_spec({**SPOT, **changes}, "spot"), accuracy="draft")
    assert "\n" not in str(caught.value)


def test_the_number_of_steps_counts_the_profile_by_its_name() -> None:
    with pytest.raises(InputError, match=r"has 2 numbers, must have 3: one for lens\.profile, one for each"):
        spot(levels=[25, 81]).replace({"optimise.steps_per_level": [9, 9]})
    with pytest.raises(InputError, match=r"has 1 numbers, must have 2: one for each of lens\.levels = \[9, 25\]"):
        small_spec(lens__levels=[9, 25], optimise__steps_per_level=[9])
