"""Media answer index and absorption at the wavelengths of rays, which carry nothing else of the lens."""

import pickle
from dataclasses import fields

import numpy as np
import pytest
from scenes import sphere, table_of

from lensforge.light.table_trace import Scene, trace_tables
from lensforge.optics.face_roles import CAVITY, OUTSIDE
from lensforge.optics.material import MATERIALS, Absorption, Formula, Material
from lensforge.optics.media import FaceCoating, Media, Medium, Mirror, ReflectanceTable, Wavelengths
from lensforge.sources.build_source import SquareEmitter
from lensforge.sources.ray_bundle import RayBundle
from lensforge.surfaces.bicubic_table import TableGrid

WAVES = np.linspace(420.0, 680.0, 40)
OF_RAYS = Wavelengths(WAVES)
SMOKED = Material(
    "smoked", Formula("cauchy", (1.5, 0.004)), (400.0, 700.0), "", None, Absorption((400.0, 700.0), (0.3, 0.0))
)


def test_a_bundle_carries_wavelengths_and_no_index() -> None:
    of_light = ["origins", "directions", "flux", "waves"]
    of_source = ["of_source", "tristimulus", "facets"]  # colours, which LED, numbers: not what a medium asks
    assert sorted(field.name for field in fields(RayBundle)) == sorted(of_light + of_source)


def test_one_medium_is_the_same_for_every_ray_and_another_by_its_material() -> None:
    plain = Medium(1.4, 0.01)
    smoked = Medium(1.51, 0.02, SMOKED)
    for waves in (None, OF_RAYS):
        assert plain.index(waves).tolist() == [1.4] and plain.absorption(waves).tolist() == [0.01]
        assert plain.indices(waves, 40).tolist() == [1.4] * 40 and plain.absorptions(waves, 40).tolist() == [0.01] * 40
    assert smoked.indices(None, 3).tolist() == [1.51] * 3 and smoked.absorptions(None, 3).tolist() == [0.02] * 3
    np.testing.assert_allclose(smoked.indices(OF_RAYS, 40), 1.5 + 0.004 / (1e-3 * WAVES) ** 2, rtol=1e-15)
    np.testing.assert_allclose(smoked.absorptions(OF_RAYS, 40), (700.0 - WAVES) * 1e-3, atol=1e-15)
    assert Medium(1.4).absorption(OF_RAYS).size == 0 and Medium(1.4).absorptions(OF_RAYS, 2).tolist() == [0.0, 0.0]


def test_an_error_of_the_index_is_added_at_every_wavelength() -> None:
    smoked = Medium(1.51, 0.0, SMOKED)
    made = Medium(1.51, 0.0, SMOKED, 0.003)
    assert made.index(None).tolist() == [1.51 + 0.003]
    assert made.index(OF_RAYS).tolist() == (smoked.index(OF_RAYS) + 0.003).tolist()


@pytest.mark.parametrize("name", MATERIALS)
def test_an_answer_has_the_bits_of_the_material_whoever_was_asked_before(name: str) -> None:
    """Also where many rays are asked in parts, some of them once more, and other wavelengths take an old place."""
    material = MATERIALS[name]
    for seed in range(3):
        waves = Wavelengths(np.random.default_rng(seed).uniform(300.0, 900.0, 10_001))
        for medium, glass in ((Medium(1.5, 0.0, material), material), (Medium(1.5, 0.0, SMOKED), SMOKED)):
            for _ in range(2):
                assert medium.index(waves).tobytes() == glass.nearest_index(waves.nm).tobytes()


def test_the_same_rays_are_bent_and_dimmed_by_what_each_medium_answers() -> None:
    grid = TableGrid(32)
    rays = SquareEmitter(0.5).sample(256, 1)
    coloured = rays.with_wavelengths(np.linspace(420.0, 680.0, 256))
    tables = [table_of(sphere(radius), grid).numpy() for radius in (1.0, 2.0)]
    results = [
        trace_tables(tables, Scene(Media(body), grid), coloured)
        for body in (Medium(1.51), Medium(1.51, 0.0, SMOKED), Medium(1.51, 0.0, MATERIALS["PC"]))
    ]
    ways = [exits.directions[exits.left_lens] for exits in results]
    assert np.abs(ways[0] - ways[1]).max() > 1e-4 and np.abs(ways[1] - ways[2]).max() > 1e-3
    assert results[0].absorbed is None and results[1].absorbed is not None and results[2].absorbed is None


def test_coatings_and_what_lies_around_are_found_by_name() -> None:
    bright, dark = (ReflectanceTable((0.0, 90.0), ((share, share),)) for share in (0.01, 0.5))
    films = FaceCoating("inner", CAVITY, bright), FaceCoating("outer", OUTSIDE, dark)
    media = Media(Medium(1.5), 1.1, 1.2, coatings=films)
    assert (media.coating("inner"), media.coating("outer"), media.coating("cap")) == (bright, dark, None)
    with pytest.raises(ValueError, match=r"'wall'.*faces are"):  # nothing would ask for it, and bounds be too low
        Media(Medium(1.5), coatings=(*films, FaceCoating("wall", OUTSIDE, dark)))
    assert (media.around(CAVITY), media.around(OUTSIDE)) == (1.1, 1.2)
    assert media.coated and not Media(Medium(1.5)).coated
    silvered = Media(Medium(1.5), coatings=(FaceCoating("outer", OUTSIDE, Mirror(0.9)),))
    assert not silvered.coated, "a mirror is no film, which fields would have to pass"
    assert media.wavelengths(None, 2).tolist() == [587.5618] * 2 and media.wavelengths(WAVES, 40) is WAVES


@pytest.mark.parametrize(
    "rows", [slice(3, 90), slice(None), np.array([5, 5, 0, 99]), np.arange(100) % 3 == 0, np.zeros(0, dtype=int)]
)
def test_some_of_the_wavelengths_have_the_answers_of_all(rows: slice | np.ndarray) -> None:
    waves = Wavelengths(np.random.default_rng(1).uniform(420.0, 680.0, 100))
    some = waves.take(rows)
    indices, absorptions = some.values_of(SMOKED)
    assert indices.tolist() == SMOKED.nearest_index(waves.nm)[rows].tolist()
    assert absorptions.tolist() == SMOKED.absorption.at(waves.nm)[rows].tolist()
    assert some.values_of(SMOKED)[0] is indices and waves.values_of(SMOKED)[0] is waves.answer[1][0], "asked once"
    assert some.take(slice(0, 2)).values_of(SMOKED)[0].tolist() == indices[:2].tolist()
    assert some.values_of(MATERIALS["PC"])[1] is None
    assert some.values_of(SMOKED)[0].tolist() == indices.tolist(), "not those of the one asked last"
    sent = pickle.loads(pickle.dumps(some))
    assert sent.nm.tolist() == some.nm.tolist() and sent.chosen_from is None is sent.answer
