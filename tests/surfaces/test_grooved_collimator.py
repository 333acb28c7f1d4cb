"""The thin lens whose exit is a lens within a ring: its light, its groove, and what it needs room for."""

import numpy as np
import pytest
from chains import clear, tables_of, upwards

from lensforge.errors import InputError
from lensforge.kernels.fate import Fate
from lensforge.light.table_trace import Scene, TracedBundle
from lensforge.optics.face_roles import BODY, CAVITY, OUTSIDE
from lensforge.scene.body import Body, Face
from lensforge.surfaces.bicubic_table import TableGrid
from lensforge.surfaces.collimator import Collimator
from lensforge.surfaces.grooved_collimator import (
    GroovedCollimator,
    ThinRoom,
    best_grooved_collimator,
    lowest_grooved_collimator,
)
from lensforge.surfaces.grooved_face import GroovedFace, blended
from lensforge.surfaces.profile import ProfileFace

INDEX = 1.4936
SIDES = {"cap": (CAVITY, BODY), "side": (CAVITY, BODY), "wall": (BODY, OUTSIDE), "exit": (BODY, OUTSIDE)}
LENSES = {
    "like spot_thin": GroovedCollimator(INDEX, 9.0, 3.3, 3.6, 0.5, 0.386),
    "steep": GroovedCollimator(1.6, 7.0, 2.5, 2.7, 0.5, 0.3, 0.1),
}


@pytest.mark.parametrize("name", LENSES)
def test_all_light_of_a_point_but_that_of_the_groove_leaves_along_the_axis(name: str) -> None:
    lens = LENSES[name]
    faces = lens.faces(0.1)
    body = Body(tuple(Face(name, face, *SIDES[name]) for name, face in faces.items()))
    body.require_sound()
    rays = upwards(20_000, 2)
    polar = np.arccos(rays.directions[:, 2])
    grid = TableGrid(801)
    traced = TracedBundle.of(tables_of(body, grid), Scene(clear(lens.index), grid, chain=body.chain(5)), rays)
    last = traced.met.max(axis=1, where=traced.met >= 0, initial=-1) // 4
    by_exit = (traced.exits.fates == Fate.LEFT_LENS) & (last == list(SIDES).index("exit"))
    by_cap = polar < lens.crease_rad
    kept = np.abs(polar - lens.crease_rad) > 0.02  # of the tables, at the crease and at the groove
    aside = np.linalg.norm(traced.exits.directions[:, :2], axis=1)
    assert by_exit[kept & by_cap].all() and by_exit[kept].mean() > 0.8, "a wall lets light near the horizon through"
    assert aside[by_exit & kept].max() < 3e-4


def test_a_cap_that_does_all_of_the_turn_is_the_hyperboloid_of_the_smooth_lens() -> None:
    smooth = Collimator(INDEX, 15.0, 3.0, 4.5)
    polar = np.linspace(0.01, smooth.crease_rad, 20)
    cap = GroovedCollimator(INDEX, 12.0, 3.0, 4.5, 1.0, 0.0)._cap(polar)
    outwards = np.column_stack([np.sin(polar), 0.0 * polar, np.cos(polar)])
    assert np.hypot(*cap.T) == pytest.approx(smooth.faces["cap"].radius(outwards), rel=1e-12)


def zones(up: float) -> tuple[ProfileFace, ProfileFace]:
    """A lens that falls outwards by 45 degrees, from a height of ``up`` mm, and a ring that rises by 45 degrees."""
    lens = ProfileFace.fitted(lambda z: (z + np.sqrt(1.0 - z**2)) / up, 0.3, 0.995, 40, 30.0)
    ring = ProfileFace.fitted(lambda z: (z - np.sqrt(1.0 - z**2)) / 2.0, 0.3, 0.995, 40, 30.0)
    return lens, ring


def test_a_groove_is_finer_than_its_zones_and_as_fine_as_its_band_is_narrow() -> None:
    lens, ring = zones(3.0)
    fine, coarse = (GroovedFace.of(30.0, lens, ring, radius_mm) for radius_mm in (0.003, 0.01))
    assert fine.detail_rad / coarse.detail_rad == pytest.approx(fine.band_per_mm / coarse.band_per_mm, rel=1e-9)
    assert coarse.detail_rad < min(lens.detail_rad, ring.detail_rad)


@pytest.mark.parametrize("radius_mm", [0.1, 0.3])
def test_a_groove_has_the_radius_that_is_asked_for(radius_mm: float) -> None:
    """Between faces of 45 degrees, where its meridian turns most; it is not in the middle of the band."""
    face = GroovedFace.of(30.0, *zones(6.0), radius_mm)
    middle = np.arctan2(2.0, 4.0)  # r = 2 mm, z = 4 mm
    polar = middle + np.linspace(-0.3, 0.3, 20001)
    rho = face.radius(np.column_stack([np.sin(polar), 0.0 * polar, np.cos(polar)]))
    r, z = rho * np.sin(polar), rho * np.cos(polar)
    assert 4.0 < z[10000] < 4.0 + radius_mm, "the round groove is filled a little"
    turned = np.diff(np.arctan2(np.diff(z), np.diff(r)))
    curvature = turned / (0.5 * (np.hypot(np.diff(r), np.diff(z))[1:] + np.hypot(np.diff(r), np.diff(z))[:-1]))
    assert curvature.max() == pytest.approx(1.0 / radius_mm, rel=0.1)  # the faces bend, too


def test_beyond_its_groove_a_face_is_lens_or_ring_to_the_last_digit() -> None:
    lens, ring = zones(6.0)
    face = GroovedFace.of(30.0, lens, ring, 0.1)
    polar = np.array([0.2, 0.35, 0.6, 0.7])
    at = np.column_stack([np.sin(polar), 0.0 * polar, np.cos(polar)])
    assert np.array_equal(face.radius(at[:2]), lens.radius(at[:2]))
    assert np.array_equal(face.radius(at[2:]), ring.radius(at[2:]))
    assert blended(np.array([0.2]), np.array([0.2]), 0.03) == pytest.approx(0.2 - 0.03 * 5.0 / 32.0)


def test_the_best_has_the_room_that_it_is_given_and_no_lens_without_room_begins() -> None:
    half = np.radians(5.0)
    best = best_grooved_collimator(INDEX, ThinRoom(9.0, 15.0, 0.6, 1.0), 1.0, half)
    assert best.share(half, 1.0) > 0.89 > LENSES["like spot_thin"].share(2.0 / 3.0 * half, 1.0)
    twice = best_grooved_collimator(INDEX, ThinRoom(18.0, 30.0, 1.2, 2.0), 2.0, half)
    assert twice.share(half, 2.0) == pytest.approx(best.share(half, 1.0), abs=1e-6), "light has no length of its own"
    assert twice.radius_mm == pytest.approx(2.0 * best.radius_mm, rel=1e-6)
    lengths = best.least_mm
    assert lengths["wall"] > 0.6 - 0.01 and lengths["gap"] > 0.39 and lengths["step"] > 0.29
    with pytest.raises(InputError, match="height = 2 mm leaves no room for cap, lens and ring; raise it"):
        best_grooved_collimator(INDEX, ThinRoom(2.0, 15.0, 0.6, 1.0), 1.0, half)


def test_the_lowest_has_nearly_the_light_of_any_height_and_a_lower_one_has_less() -> None:
    half = np.radians(6.0)
    room = ThinRoom(9.0, 8.0, 0.6, 1.0)
    lowest = lowest_grooved_collimator(INDEX, room, 1.0, half)
    lower, highest = (
        best_grooved_collimator(INDEX, room._replace(height_mm=height), 1.0, half)
        for height in (0.85 * lowest.height_mm, 9.0)
    )

    def light(lens: GroovedCollimator) -> float:
        return lens.share(half, 1.0) - 0.4 / lens.cavity_mm**2

    assert 4.5 < lowest.height_mm < 8.0
    assert light(lower) < 0.98 * light(highest) < light(lowest) + 0.005
    with pytest.raises(InputError, match="leaves no room for cap, lens and ring"):
        lowest_grooved_collimator(INDEX, ThinRoom(2.0, 8.0, 0.6, 1.0), 1.0, half)


def test_zones_that_do_not_meet_have_no_groove() -> None:
    lens, ring = zones(6.0)
    with pytest.raises(InputError, match="lens and ring do not meet in a groove"):
        GroovedFace.of(30.0, ring, lens, 0.1)
    with pytest.raises(InputError, match="band_per_mm = 0: must be above 0"):
        GroovedFace(30.0, lens, ring, 0.0)
