"""Reflectance of layers against closed forms, a thin-film library, and the sums of the verification; tables' errors."""

import numpy as np
import pytest
import torch
from known_refraction import largest_deviation_rad
from own_media import coatings

from lensforge.errors import InputError
from lensforge.optics.coatings import coating_tables, least_reflectances, reflectance_of, stack_reflectances
from lensforge.optics.dielectric import coated_transmittances, fresnel_transmittances
from lensforge.optics.fundamental_limits import best_transmittance, transmittance_of
from lensforge.optics.media import (
    CoatingLayer,
    FaceCoating,
    IndexCurve,
    LayerStack,
    Media,
    Medium,
    Mirror,
    ReflectanceTable,
)
from lensforge.proof.refraction import RefractingFace
from lensforge.spec.internal_reflection import TirSection

RNG = np.random.default_rng(4)
WAVES = RNG.uniform(400.0, 700.0, 60)
COSINES = np.append(RNG.uniform(0.0, 1.0, 56), [0.0005, 0.998, 0.9995, 1.0])
SLOPED = IndexCurve((2.4, 2.3, 2.25), (380.0, 550.0, 720.0))
STACKS = {
    "one": ([(IndexCurve((1.38,)), 100.0)], 1.5, 1.0),
    "four": ([(IndexCurve((1.38,)), 90.0), (SLOPED, 40.0), (IndexCurve((1.65,)), 80.0), (SLOPED, 20.0)], 1.6, 1.0),
    "between gel and a lighter body": ([(IndexCurve((1.5,)), 120.0), (IndexCurve((1.45,)), 60.0)], 1.41, 1.6),
    "evanescent": ([(IndexCurve((1.1,)), 80.0), (IndexCurve((1.2,)), 150.0)], 1.5, 1.33),
}


def stack(layers, body):
    return LayerStack(tuple(CoatingLayer(*layer) for layer in layers), IndexCurve((body,)), (300.0, 2000.0))


@pytest.fixture(params=STACKS)
def face(request):
    layers, body, around = STACKS[request.param]
    return stack(layers, body), around, body


def one_by_one(coating, around):
    pairs = zip(WAVES, COSINES, strict=True)
    return np.array([both(coating, around, np.array([w]), np.array([c]))[:, 0, 0] for w, c in pairs]).T


def both(*given):
    return np.array(stack_reflectances(*given))


def mean_of(*given):
    return both(*given).mean(axis=0)


def test_a_stack_reflects_as_by_a_thin_film_library(face):
    tmm = pytest.importorskip("tmm")
    coating, around, body = face
    wanted = []
    for wave, cosine in zip(WAVES, COSINES, strict=True):
        indices = [around, *(float(layer.index.at(np.array([wave]))[0]) for layer in coating.layers), body]
        thick = [np.inf, *(layer.thickness_nm for layer in coating.layers), np.inf]
        way = 1 if around < body else -1
        given = indices[::way], thick[::way], np.arccos(cosine), wave
        wanted.append([tmm.coh_tmm(polarisation, *given)["R"] for polarisation in "sp"])
    np.testing.assert_allclose(one_by_one(coating, around).T, wanted, rtol=0, atol=1e-12)


@pytest.mark.parametrize("inwards", [True, False])
def test_the_verification_sums_the_same_from_either_side(face, inwards):
    coating, around, body = face
    before, behind = (np.full(60, index) for index in ((around, body) if inwards else (body, around)))
    sines = min(around, body) * np.sqrt(1.0 - COSINES**2)
    of_rays = RefractingFace(before, behind, coating, WAVES, inwards)
    amplitudes = of_rays.reflected(np.sqrt(1.0 - (sines / before) ** 2), np.ones(60, dtype=bool))
    reflectances = np.abs(amplitudes) ** 2
    np.testing.assert_allclose(reflectances, one_by_one(coating, around), rtol=0, atol=1e-9)


def test_closed_forms():
    normal = np.ones(1)
    waves = np.array([500.0, 550.0, 620.0])
    for body in (1.44, 1.7, 2.25):
        root = np.sqrt(body)
        quarter = stack([(IndexCurve((root,)), 550.0 / 4.0 / root)], body)
        assert mean_of(quarter, 1.0, waves, normal)[1, 0] < 1e-30
        half = 2.0 * np.pi * 137.5 / waves * 1.0
        # one layer at normal incidence (Born and Wolf, 1.6.4): both of its faces reflect r
        r = (1.0 - root) / (1.0 + root)
        two = np.abs((r + r * np.exp(2j * half)) / (1.0 + r * r * np.exp(2j * half))) ** 2
        np.testing.assert_allclose(mean_of(quarter, 1.0, waves, normal)[:, 0], two, atol=1e-15)
    air = stack([(IndexCurve((1.5,)), 333.0)], 1.5)  # a layer of the body's own index is none
    cosines = np.linspace(0.05, 1.0, 40)
    bare = 1.0 - torch.stack(fresnel_transmittances(torch.from_numpy(cosines), 1.0 / 1.5)[:2]).numpy()
    np.testing.assert_allclose(both(air, 1.0, waves, cosines), np.tile(bare[:, None], (1, 3, 1)), atol=1e-14)
    np.testing.assert_allclose(both(air, 1.0, waves, np.zeros(1)), 1.0, rtol=1e-14)


def by_table(media, which):
    """Reflectance at the random wavelengths and cosines by the tracers' table."""
    tables = coating_tables(media, (400.0, 700.0))
    rows = np.interp(WAVES, tables.wavelengths_nm, np.arange(len(tables.wavelengths_nm)))
    ratio = 0.5  # into what is denser: the cosine before counts
    given = (torch.from_numpy(array) for array in (tables.faces[which], rows))
    return 1.0 - torch.stack(coated_transmittances(torch.from_numpy(COSINES), ratio, *given)[:2]).numpy()


def test_tables_err_by_less_than_a_hundred_thousandth(face):
    coating, around, body = face
    reflectances = by_table(Media(Medium(body), outside_index=around, coatings=coatings(outer=coating)), "outer")
    far = COSINES > 0.25
    assert np.abs(reflectances - one_by_one(coating, around))[:, far].max() < 1.5e-5


def test_a_table_is_its_own_interpolation():
    angles = (0.0, 30.0, 55.0, 80.0)
    rows = ((0.01, 0.008, 0.02, 0.3), (0.0, 0.002, 0.05, 0.25))
    waves = (450.0, 600.0)
    table = ReflectanceTable(angles, rows, waves)
    exact = reflectance_of(table, 1.0, (400.0, 700.0))
    np.testing.assert_allclose(exact.at(np.array(waves), np.cos(np.radians(angles)))[..., 0], rows, atol=1e-15)
    assert not exact.at(np.array(waves), COSINES)[..., 1].any()  # it states no polarisation
    assert exact.at(np.array([500.0]), np.zeros(1))[0, 0, 0] == pytest.approx(1.0) and exact.least == 0.0
    middle = exact.at(np.array([525.0, 300.0]), np.array([1.0]))[:, 0, 0]
    np.testing.assert_allclose(middle, [0.005, 0.01], atol=1e-15)
    face = RefractingFace(np.ones(60), np.full(60, 1.5), table, WAVES, True)
    by_rays = np.abs(face.reflected(COSINES, np.ones(60, dtype=bool))) ** 2
    np.testing.assert_allclose(
        by_table(Media(Medium(1.5), coatings=coatings(inner=table)), "inner"), by_rays, atol=5e-6
    )


def test_layers_too_thick_for_a_table_are_one_line():
    thick = stack([(IndexCurve((1.6,)), 80_000.0)], 1.5)
    with pytest.raises(InputError, match=r"too thick: more than 4096 wavelengths .* give its reflectance as a table"):
        reflectance_of(thick, 1.0, (400.0, 700.0))
    assert len(reflectance_of(thick, 1.0, (550.0, 550.0)).nodes_nm) == 1


def test_no_light_passes_two_coated_faces_beyond_the_bound(face):
    coating, around, body = face
    media = Media(Medium(body), around, around, coatings=coatings(coating, coating))
    bounds = least_reflectances(media, (400.0, 700.0))
    least = bounds["inner"], bounds["outer"]
    assert least[0] == least[1] and 0.0 <= least[0] <= one_by_one(coating, around).mean(axis=0).min()
    fine = both(coating, around, np.linspace(400.0, 700.0, 301), np.linspace(0.0, 1.0, 301))
    assert least[0] <= 1.0 - np.sqrt(np.mean((1.0 - fine) ** 2, axis=0).max()) < least[0] + 1e-3
    ratio = max(body, around) / min(body, around)
    turns = np.linspace(0.0, largest_deviation_rad(ratio) + 0.2, 50)
    bound = best_transmittance(turns, body, around, around, ((least[0],), (least[1],)))
    assert (bound <= (1.0 - least[0]) ** 2).all() and not bound[turns > largest_deviation_rad(ratio)].any()
    possible = turns < 0.99 * largest_deviation_rad(ratio)
    np.testing.assert_allclose(bound[possible], (1.0 - least[0]) ** 2)
    one_bare = best_transmittance(turns, body, around, around, ((least[0],), (None,)))
    assert (one_bare >= best_transmittance(turns, body, around, around) * 0.97).all() and (
        one_bare <= bound / 0.97
    ).all()
    anywhere = least_reflectances(media, None)["inner"]
    assert transmittance_of(media) == pytest.approx((1.0 - anywhere) ** 2)
    whole = both(coating, around, np.linspace(301.0, 1999.0, 501), np.linspace(0.0, 1.0, 201))
    assert anywhere <= 1.0 - np.sqrt(np.mean((1.0 - whole) ** 2, axis=0).max()) < anywhere + 1e-3
    half = ReflectanceTable((0.0, 90.0), ((0.5, 0.5),))
    assert transmittance_of(Media(Medium(1.5), coatings=coatings(half, half))) == 0.25
    # Of a lens for total internal reflection by the best of its ways: the side is bare, the wall a mirror.
    faces = {"cap": half, "exit": ReflectanceTable((0.0, 90.0), ((0.01, 0.01),)), "wall": Mirror(0.9)}
    films = tuple(FaceCoating(name, "outside", film) for name, film in faces.items())
    tir = Media(Medium(1.5), coatings=films, faces=TirSection.roles)
    assert transmittance_of(tir) == pytest.approx(0.96 * 0.99, rel=1e-12)
    closed = tuple(FaceCoating(name, "outside", Mirror(0.9)) for name in ("wall", "exit"))
    assert transmittance_of(Media(Medium(1.5), coatings=closed, faces=TirSection.roles)) == 0.0


def test_of_a_coating_known_by_its_reflectance_total_reflection_has_the_phases_of_the_bare_face() -> None:
    """Fresnel's, by which s and p part: a table tells none. Short of the critical angle it has its own reflectance."""
    index = 1.5
    angles = np.radians([30.0, 41.0, 43.0, 60.0, 80.0])
    table = ReflectanceTable((0.0, 89.0), ((0.9, 0.9),))
    face = RefractingFace(np.full(5, index), np.ones(5), table, np.full(5, 550.0), False)
    total = index * np.sin(angles) > 1.0
    assert total.tolist() == [False, False, True, True, True]
    s, p = face.reflected(np.cos(angles), ~total)
    assert np.abs(s[~total]) ** 2 == pytest.approx(0.9) and np.abs(p[~total]) ** 2 == pytest.approx(0.9)
    sine = np.sin(angles[total])
    apart = 2.0 * np.arctan(np.cos(angles[total]) * np.sqrt(sine**2 - index**-2.0) / sine**2)  # Born and Wolf, 1.5 (61)
    assert np.abs(np.angle(p[total] / s[total])) == pytest.approx(apart, abs=1e-12)
