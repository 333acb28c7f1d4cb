"""Faces that scatter and are met more than once: each time by numbers of their own, held against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from chains import REACH, clear, mirrors, tables_of, upwards

from lensforge.kernels.fate import Fate
from lensforge.light.table_trace import Scene, TracedBundle
from lensforge.optics.face_roles import CAVITY, OUTSIDE
from lensforge.optics.media import FaceScatter
from lensforge.optics.scattering import GaussianFacets, lambertian
from lensforge.scene.body import Body, Face
from lensforge.scene.rough_faces import numbers_again, roughness
from lensforge.sources.build_source import build_source
from lensforge.spec.source_sections import SquareSource
from lensforge.surfaces.asphere import sphere
from lensforge.surfaces.bicubic_table import TableGrid
from lensforge.surfaces.reciprocal import PlaneFace

GRID = TableGrid(301)
EVENTS = 6
BALL = Body((Face("cup", sphere(10.0), CAVITY, "body"), Face("mouth", PlaneFace(REACH, 8.0), CAVITY, OUTSIDE)))
WHITE = replace(clear(coatings=mirrors(0.9, cup=CAVITY)), scatter=(FaceScatter("cup", lambertian(1.0)),))


def test_light_in_a_white_sphere_ends_as_its_closed_form_says() -> None:
    """What a sphere sends to itself by Lambert's law is even over it: 0.4 of it meets the zone again, 0.1 the mouth.

    Of the light 0.36 leaves directly; the mirror keeps 0.9 each time. Numbers that hang together between the times that
    a ray meets the mirror changed what goes back by a tenth.
    """
    rays = build_source(SquareSource(side_mm=0.0), facets=1).sample(2**17, 3)
    traced = TracedBundle.of(tables_of(BALL, GRID), Scene(WHITE, GRID, chain=BALL.chain(EVENTS)), rays)
    exits = traced.exits
    met = (traced.met >= 0).sum(axis=1)
    times = np.arange(1, EVENTS)
    wanted = 0.64 * 0.9**times * 0.4 ** (times - 1)
    for number, share in zip(times, wanted, strict=True):
        by_mouth = exits.flux[exits.left_lens & (met == number + 1)].sum()
        assert by_mouth == pytest.approx(0.1 * share, abs=5.0 * np.sqrt(0.1 * share / len(rays))), number
    assert exits.flux[exits.left_lens & (met == 1)].sum() == pytest.approx(0.36, abs=1e-4)
    backward = exits.flux[exits.fates == Fate.BACKWARD].sum()
    assert backward == pytest.approx(0.447279, abs=0.0025) and backward == pytest.approx(0.5 * wanted.sum(), abs=0.0025)
    assert exits.absorbed.sum() == pytest.approx(0.1 * (1.0 - 0.36**EVENTS), abs=5e-4)


def test_facets_of_a_mirror_that_is_met_again_are_others() -> None:
    """Of two facets on the way through a shallow cup the tilts of a ray are independent, as of two faces."""
    media = replace(WHITE, scatter=(FaceScatter("cup", GaussianFacets(0.2)),))
    rays = upwards(50_000, 4)
    rough, steep = (
        TracedBundle.of(tables_of(BALL, GRID), Scene(materials, GRID, chain=BALL.chain(3)), rays)
        for materials in (media, replace(media, scatter=(FaceScatter("cup", GaussianFacets(1e-9)),)))
    )
    assert (rough.met >= 0).sum(axis=1).max() == 3 and not np.array_equal(rough.met, steep.met)
    keys = roughness(media, ("cup", "mouth"), rays).keys
    numbers = []
    for face in (0, 1):
        numbers += [numbers_again(keys, face, np.full(len(rays), times)) for times in (1, 2, 3)]
    assert np.abs(np.corrcoef(np.column_stack(numbers).T) - np.eye(12)).max() < 0.025
    assert np.abs(np.mean(numbers, axis=1) - 0.5).max() < 0.007
