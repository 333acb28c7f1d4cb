from dataclasses import replace

import numpy as np
import pytest
from result_folders import small_lens

from lensforge.light.ray_lines import ENDS, ray_lines, trace_fan
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface

REACH = 30.0


def fan(count=41, widest_deg=85.0, azimuth=0.4):
    theta = np.radians(np.linspace(-widest_deg, widest_deg, count))
    across = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    return np.sin(theta)[:, None] * across + np.cos(theta)[:, None] * np.array([0.0, 0.0, 1.0])


def with_surface(lens, **changed):
    return replace(lens, surfaces={**lens.surfaces, **changed})


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def test_rays_from_the_centre_of_two_spheres_go_straight():
    directions = fan()
    paths = trace_fan(small_lens(bump_mm=0.0), np.zeros_like(directions), directions, REACH)
    for index, radius in ((1, 4.0), (2, 10.0), (3, REACH)):
        assert paths[:, index] == pytest.approx(radius * directions, abs=1e-6)


def test_every_hit_lies_on_its_surface_and_obeys_snell():
    lens, directions = small_lens(bump_mm=0.4), fan()
    start = np.tile([0.5, -0.3, 0.0], (len(directions), 1))
    paths = trace_fan(lens, start, directions, REACH)
    whole = ~np.isnan(paths[:, 3, 0])
    assert whole.sum() > 30
    paths = paths[whole]
    n = lens.refractive_index
    for index, surface, before, behind in ((1, lens.inner, 1.0, n), (2, lens.outer, n, 1.0)):
        hits = paths[:, index]
        assert surface.radius(unit(hits)) == pytest.approx(np.linalg.norm(hits, axis=1), abs=1e-5)
        normal = surface.normal(unit(hits))
        arriving, leaving = unit(hits - paths[:, index - 1]), unit(paths[:, index + 1] - hits)
        # Snell's law as a vector equation: n d x N is the same on both sides.
        assert before * np.cross(arriving, normal) == pytest.approx(behind * np.cross(leaving, normal), abs=1e-5)


def test_total_reflection_leaves_nothing():
    basis = SrbfBasis((81,), 1.2)
    rough = SrbfSurface(basis, np.random.default_rng(5).normal(0.0, 0.8, basis.size), 10.0)
    lens, directions = with_surface(small_lens(), outer=rough), fan(201)
    paths = trace_fan(lens, np.zeros_like(directions), directions, REACH)
    arrived = ~np.isnan(paths[:, 2, 0])
    hits = paths[arrived, 2]
    arriving, normal = unit(hits - paths[arrived, 1]), rough.normal(unit(hits))
    sine = lens.refractive_index * np.linalg.norm(np.cross(arriving, normal), axis=1)
    assert (sine > 1.0).any(), "the case must occur"
    assert (sine < 1.0).any(), "and the other"
    assert np.isnan(paths[arrived, 3, 0]).tolist() == (sine > 1.0).tolist()


def test_a_ray_that_runs_back_into_the_cavity_ends_there():
    """A deep pit in the cavity's wall: rays bent around its corner would cross air again on their way out."""
    basis = SrbfBasis((81,), 1.2)
    jagged = SrbfSurface(basis, np.random.default_rng(1).normal(0.0, 1.2, basis.size), 5.0)
    lens, directions = with_surface(small_lens(outer_mm=14.0, bump_mm=0.0), inner=jagged), fan(401, azimuth=0.1)
    paths = trace_fan(lens, np.tile([3.0, 0.0, 0.0], (401, 1)), directions, REACH)
    entered, left = ~np.isnan(paths[:, 1, 0]), ~np.isnan(paths[:, 3, 0])
    assert (entered & ~left).any(), "the case must occur"
    share = np.linspace(0.001, 0.999, 1001)[:, None, None]
    way = paths[left, 1] + share * (paths[left, 2] - paths[left, 1])
    above = np.linalg.norm(way, axis=-1) - jagged.radius(unit(way).reshape(-1, 3)).reshape(way.shape[:2])
    assert (above > -0.02).all(), "no ray that is drawn to the end passes through air inside the lens"


def test_rays_that_go_below_the_plane_end():
    directions = unit(np.array([[1.0, 0.0, -0.2], [1.0, 0.0, 0.2]]))
    paths = trace_fan(small_lens(bump_mm=0.0), np.zeros((2, 3)), directions, REACH)
    assert np.isnan(paths[0, -1]).all() and (paths[0, :-1] == 0.0).all()
    assert np.isfinite(paths[1]).all()


def test_each_way_to_end_has_its_name():
    """Straight up; refracted down through the lens to z = 0; down to z = 0 in the cavity."""
    directions = unit(np.array([[0.0, 0.0, 1.0], [1.0, 0.0, -0.45], [1.0, 0.0, -1.0]]))
    starts = np.tile([0.0, 0.0, 2.0], (3, 1))
    lines = ray_lines(small_lens(bump_mm=0.0), RayBundle(starts, directions, np.ones(3)), REACH)
    assert [ENDS[end] for end in lines.ends] == ["leaves", "base", "opening"]
    assert {name: len(drawn) for name, drawn in lines.by_end().items()} == {"leaves": 1, "base": 1, "opening": 1}
    assert lines.by_end()["leaves"][0][-1] == pytest.approx([0.0, 0.0, REACH])
