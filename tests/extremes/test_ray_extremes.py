"""Rays at the edge of every decision of the tracer; étendue is kept; and any lens through the exact tracer."""

import numpy as np
import pytest
import torch
from exact_surface import ExactSurface
from extremes import bundle, fuzzed, is_sound, quick_table_of, sound
from hypothesis import given
from hypothesis import strategies as st
from inlined import alone
from known_refraction import normal_transmittance
from landed import in_torch, plane_at, trace_exact, trace_tables
from scenes import hemisphere_directions, random_surface, sphere, table_of

from lensforge.errors import InputError
from lensforge.kernels import fresnel
from lensforge.kernels.fate import Fate
from lensforge.light.table_trace import Scene
from lensforge.optics.media import Media, Medium
from lensforge.sources.build_source import SquareEmitter
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.bicubic_table import TableGrid
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface

transmittances, transmitted_cosine_squared = map(alone, (fresnel.transmittances, fresnel.transmitted_cosine_squared))
INDEX = st.one_of(st.just(1.0), st.just(4.0), st.floats(1.0, 4.0))


def _expected_hits(rays: RayBundle, radii: tuple[float, float], index: float, distance: float) -> np.ndarray:
    """Concentric spheres in closed form (Bouguer): n |r x d| is kept, so both refractions turn the ray in one plane."""
    moment = np.cross(rays.origins, rays.directions)
    b = np.linalg.norm(moment, axis=1)
    axis = moment / np.where(b > 0.0, b, 1.0)[:, None]
    inside, outside = (np.arcsin(b / r) - np.arcsin(b / (index * r)) for r in radii)
    turn = (outside - inside)[:, None]
    d = rays.directions * np.cos(turn) + np.cross(axis, rays.directions) * np.sin(turn)
    foot = b[:, None] * np.cross(d, axis)
    return (foot + ((distance - foot[:, 2]) / d[:, 2])[:, None] * d)[:, :2]


@fuzzed(30)
@given(
    INDEX,
    st.floats(-3.0, 4.0),  # size of the lens: 1e-3 to 1e4 mm
    st.floats(-13.0, 1.0),  # thickness of the shell, relative
    st.floats(0.0, 7.0),  # distance of the receiver, in lens radii
    st.one_of(st.just(0.0), st.floats(-9.0, 0.0).map(lambda e: 10.0**e)),  # half width of the source, relative
    st.integers(0, 2**31),
)
def test_concentric_spheres_do_what_bouguer_says(index, size, thickness, distance, width, seed) -> None:
    inner = 10.0**size
    outer = inner * (1.0 + 10.0**thickness)
    plane = 1.01 * outer * 10.0**distance
    emitted = SquareEmitter(1.4 * width * inner).sample(64, seed)
    arrivals = sound(sphere(inner), sphere(outer), emitted, index, plane, nodes=24)
    arrived = arrivals.landed.numpy()
    assert set(arrivals.fates.tolist()) <= {Fate.LEFT_LENS, Fate.BASE}
    expected = _expected_hits(emitted, (inner, outer), index, plane)[arrived]
    hits = arrivals.hits.detach().numpy()[arrived]
    scale = plane + np.linalg.norm(expected, axis=1, keepdims=True) ** 2 / plane  # a tilt moves far hits more
    assert (np.abs(hits - expected) <= 1e-10 * scale).all()
    if width == 0.0:
        assert arrived.all()
        assert arrivals.flux.sum().item() == pytest.approx(normal_transmittance(index) ** 2, rel=1e-12)
        assert np.allclose(arrivals.sin2_exit.detach().numpy(), 0.0, atol=1e-11)


@fuzzed(30)
@given(
    st.integers(0, 2**31),
    st.floats(0.0, 0.15),
    INDEX,
    st.sampled_from([1.0001, 1.01, 1.5, 3.0]),
    st.floats(0.0, 2.2),
    st.floats(0.0, 0.5),
)
def test_any_lens_is_traced_or_refused(seed, roughness, index, ratio, side, depth) -> None:
    """Rough surfaces that nearly vanish, touch or cross; sources up to wider than the cavity, some of it below."""
    inner, outer = (random_surface(seed + k, radius, roughness, levels=(9, 25)) for k, radius in ((0, 1.0), (1, ratio)))
    rays = SquareEmitter(side).sample(64, seed)
    rays.origins[::2, 2] = -depth
    try:
        arrivals = sound(inner, outer, rays, index, distance=20.0)
    except InputError as refusal:
        _says_why(refusal)
    else:
        assert not (arrivals.fates == Fate.NOT_CONVERGED).any()


def _says_why(refusal: InputError) -> None:
    assert "must stay above 0" in str(refusal)


def transmittance(c: float, q: float, ratio: float) -> tuple[float, float]:
    """Of unpolarised light, and its slope."""
    (t_s, t_p, _), (by_s, by_p, _) = transmittances(c, q, ratio)
    return 0.5 * (t_s + t_p), 0.5 * (by_s + by_p)


@pytest.mark.parametrize("cosine", [1.0, 0.5, 1e-3, 1e-8, 1e-15, 1e-150])
def test_a_body_of_air_passes_rays_at_any_angle(cosine: float) -> None:
    squared = transmitted_cosine_squared(cosine, 1.0)
    assert squared == cosine**2
    value, slope = transmittance(cosine, np.sqrt(squared), 1.0)
    assert value == pytest.approx(1.0, abs=1e-15) and abs(slope) <= 1e-15


@fuzzed(100)
@given(st.floats(1.0, 4.0), st.integers(-3, 3))
def test_fresnel_at_the_critical_angle_to_the_last_bit(index: float, bits: int) -> None:
    """Either totally reflected, or a transmittance that falls to 0 as sqrt does, with a finite slope."""
    critical = np.sqrt((index - 1.0) * (index + 1.0)) / index
    cosine = min(1.0, critical + bits * np.spacing(critical))
    squared = transmitted_cosine_squared(cosine, index)
    if squared > 0.0:
        value, slope = transmittance(cosine, np.sqrt(squared), index)
        assert np.isfinite(slope) and 0.0 <= value <= 1.0
        # 1 - (r_s^2 + r_p^2)/2 to first order in q: 2 q (ratio/c + 1/(ratio c)) / ... bounded by 4 (n + 1/n) q / c
        assert value <= 4.0 * (index + 1.0 / index) * np.sqrt(squared) / max(cosine, np.sqrt(squared))


@fuzzed(100)
@given(st.floats(1.0, 4.0), st.floats(-12.0, 0.0))
def test_grazing_light_is_reflected(index: float, exponent: float) -> None:
    """Into the body no angle is critical; T -> 4c (n^2+1)/(2 n^2) n / sqrt(n^2-1) ... -> 0 with c; energy is kept."""
    cosine = 10.0**exponent
    squared = transmitted_cosine_squared(cosine, 1.0 / index)
    behind = np.sqrt(squared)
    value, slope = transmittance(cosine, behind, 1.0 / index)
    # textbook: t^2 (n2 cos2)/(n1 cos1), mean of both polarisations
    ts, tp = 2.0 * cosine / (cosine + index * behind), 2.0 * cosine / (index * cosine + behind)
    expected = 0.5 * (ts**2 + tp**2) * index * behind / cosine
    assert value == pytest.approx(expected, rel=1e-12, abs=1e-15)
    assert np.isfinite(slope)


@pytest.mark.parametrize("rise", [1e-3, 1e-8, 1e-15, 1e-100, 1e-310])
@pytest.mark.parametrize("distance", [1e-2, 1e3, 1e7])
@pytest.mark.parametrize("below", [0.0, 1e-9])
def test_towards_the_horizon(rise: float, distance: float, below: float) -> None:
    """theta -> 90 deg: a hit far out, or the word that there is none; never infinity."""
    rays = bundle([0.0, 0.0, -below], [[1.0, 0.0, rise], [0.0, -1.0, rise], [0.0, 0.6, -rise], [1.0, 0.0, 0.0]])
    arrivals = sound(sphere(1e-3), sphere(2e-3), rays, 1.0, distance, nodes=24)
    assert arrivals.fates[2:].tolist() == [Fate.BACKWARD] * 2
    if rise >= 1e-8 and below == 0.0:
        assert arrivals.hits[0, 0].item() == pytest.approx(distance / rise, rel=1e-6)
    elif rise < 1e-15:
        assert not arrivals.landed.any()


def test_rays_that_are_no_numbers_never_arrive() -> None:
    bad = np.array([[np.nan, 0.0, 1.0], [0.0, 0.0, np.nan], [np.inf, 0.0, 1.0]])
    up = np.tile([0.0, 0.0, 1.0], (3, 1))
    rays = RayBundle(np.concatenate([0.0 * up, bad]), np.concatenate([bad, up]), np.ones(6))
    grid = TableGrid(24)
    arrivals = trace_tables((table_of(sphere(r), grid) for r in (1.0, 2.0)), Scene(Media(Medium(1.5)), grid), rays)
    assert not arrivals.left_lens.any()


@pytest.mark.parametrize("gap", [1e-3, 1e-6, 1e-9, 1e-12])
def test_a_corner_within_a_hair_of_the_wall(gap: float) -> None:
    """A square whose corners all but touch a cavity of 0.8 mm: nothing is lost, nothing outside; then just beyond."""
    corner = (0.8 - gap) / np.sqrt(2.0)
    corners = np.array([[sx * corner, sy * corner, 0.0] for sx in (-1, 1) for sy in (-1, 1)])
    rays = bundle(np.repeat(corners, 50, axis=0), np.tile(hemisphere_directions(50), (4, 1)))
    arrivals = sound(sphere(0.8), sphere(2.45), rays)
    assert not np.isin(arrivals.fates.numpy(), (Fate.OUTSIDE_CAVITY, Fate.NOT_CONVERGED)).any()
    beyond = sound(sphere(0.8), sphere(2.45), bundle(corners * (0.8 + gap) / (0.8 - gap), rays.directions[:4]))
    assert (beyond.fates == Fate.OUTSIDE_CAVITY).all()


@pytest.mark.parametrize("least", [1e-1, 1e-3, 1e-6])
def test_a_radius_of_nearly_zero(least: float) -> None:
    """A dent to a hair above the source: all accounted for, or refused where the table's own error is larger."""
    basis = SrbfBasis((1, 9), 1.0)
    weights = np.zeros(10)
    weights[0] = least - 1.0
    dented = SrbfSurface(basis, weights, 1.0)
    rays = bundle(np.zeros(3), np.concatenate([basis.centres, hemisphere_directions(100)]))
    if least > 1e-4:
        assert not (sound(dented, sphere(2.0), rays, nodes=100).fates == Fate.NOT_CONVERGED).any()
    through = SrbfSurface(basis, weights - (np.arange(10) == 0) * (least + 0.01), 1.0)
    with pytest.raises(InputError, match="must stay above 0"):
        sound(through, sphere(2.0), rays, nodes=100)


@pytest.mark.parametrize("thickness", [-1e-3, -1e-15, 0.0, 1e-15, 1e-12, 1e-9, 1e-3])
def test_surfaces_that_nearly_touch(thickness: float) -> None:
    """Down to rounding the shell passes rays straight; touching or crossed ones are named so."""
    u = hemisphere_directions(200)
    arrivals = sound(sphere(1.0), sphere(1.0 + thickness), bundle(np.zeros(3), u))
    allowed = (
        {Fate.LEFT_LENS}
        if thickness >= 1e-12
        else {Fate.SURFACES_INTERSECT}
        if thickness < -1e-14
        else {0, Fate.SURFACES_INTERSECT}
    )
    assert set(arrivals.fates.tolist()) <= allowed
    straight = (u[:, :2] / u[:, 2:] * 1000.0)[arrivals.landed.numpy()]
    assert np.allclose(arrivals.hits[arrivals.landed].detach(), straight, rtol=1e-8)


@fuzzed(20)
@given(INDEX)
def test_multiple_reflections_are_what_a_single_pass_lacks_to_a_window(index: float) -> None:
    """A window passes 2n/(n^2+1); one pass through both faces, (1-R)^2, is that times 1 - R^2."""
    flux = sound(sphere(1.0), sphere(2.0), bundle(np.zeros(3), [[0.0, 0.0, 1.0]]), index, nodes=24).flux.item()
    reflected = 1.0 - normal_transmittance(index)
    assert flux == pytest.approx((4.0 * index / (index + 1.0) ** 2) ** 2, rel=1e-13)
    assert flux / (1.0 - reflected**2) == pytest.approx(2.0 * index / (index**2 + 1.0), rel=1e-13)


def _phase_space(states: np.ndarray, tables: list, index: float, grid: TableGrid) -> np.ndarray:
    """(x, y, p, q) behind the lens from those in the source plane: at a plane behind it; NaN: not arrived."""
    directions = np.column_stack([states[:, 2:], np.sqrt(1.0 - np.sum(states[:, 2:] ** 2, axis=1))])
    origins = np.column_stack([states[:, :2], np.zeros(len(states))])
    rays = RayBundle(origins, directions, np.ones(len(states)))
    exits = trace_tables(tables, Scene(Media(Medium(index)), grid), rays)
    seen = plane_at(4.0).land_by_arrays(exits)
    state = np.column_stack([seen.hits, exits.directions[:, :2]])
    return np.where(seen.landed[:, None], state, np.nan)


def _liouville_error(
    states: np.ndarray, tables: list[torch.Tensor], index: float, grid: TableGrid, h: float
) -> np.ndarray:
    """How far the determinant of the map is from 1, by central differences; they lose digits where it stretches."""
    columns = []
    for axis in range(4):
        ahead, behind = (_phase_space(states + s * h * np.eye(4)[axis], tables, index, grid) for s in (1, -1))
        columns.append((ahead - behind) / (2.0 * h))
    jacobian = np.stack(columns, axis=-1)
    return np.abs(np.linalg.det(jacobian) - 1.0) / np.linalg.norm(jacobian, axis=(1, 2)) ** 2


@fuzzed(10)
@given(INDEX, st.integers(0, 2**31))
def test_etendue_is_kept_by_any_lens(index: float, seed: int) -> None:
    """The map of (x, y, p, q) through both surfaces has determinant 1 (Liouville)."""
    grid = TableGrid(60)
    tables = [quick_table_of(random_surface(seed + k, r, 0.01, (9, 25)), grid) for k, r in ((0, 1.0), (1, 2.0))]
    count, rng = 40, np.random.default_rng(seed)
    states = np.column_stack([rng.uniform(-0.3, 0.3, (count, 2)), 0.6 * hemisphere_directions(count, seed)[:, :2]])
    # where a knot of the spline lies between, its third derivative jumps: then the other step tells
    error = np.fmin(*(_liouville_error(states, tables, index, grid, h) for h in (1e-5, 3e-6)))
    assert np.isfinite(error).sum() > 20
    assert np.nanmax(error) < 1e-8


@fuzzed(20, by_day=8)
@given(
    st.integers(0, 2**31),
    st.floats(0.0, 0.1),
    st.sampled_from([1.0, 1.4936, 4.0]),
    st.floats(0.0, 1.8),
    st.sampled_from([1e-3, 1.0, 1e4]),
    st.sampled_from([1.001, 1.5, 3.0]),
)
def test_any_lens_through_the_exact_tracer(seed, roughness, index, side, size, ratio) -> None:
    surfaces = [
        ExactSurface.of(random_surface(seed + k, radius * size, roughness, levels=(9,)), requires_grad=True)
        for k, radius in ((0, 1.0), (1, ratio))
    ]
    rays = SquareEmitter(side * size).sample(32, seed)
    arrivals = in_torch(trace_exact(*surfaces, Media(Medium(index)), rays), 20.0 * size)
    is_sound(arrivals, rays, [p for s in surfaces for p in (s.weights_mm, s.offset_mm)])
