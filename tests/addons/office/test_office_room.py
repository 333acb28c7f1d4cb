"""Glare in offices: the printed table of CIE 190, plain loops over a crooked lamp, and both sides of a limit."""

from math import atan2, cos, degrees, hypot, log10, pi, radians, sin
from pathlib import Path

import numpy as np
import pytest
import torch
from cie_luminaire import LUMINOUS_M, OFFICE, luminaire

from lensforge.addons.office import office_room
from lensforge.addons.office.office_light import OfficeLight
from lensforge.addons.office.office_room import OfficeReadings, position_index
from lensforge.addons.office.office_section import OfficeSection
from lensforge.addons.office.unified_glare import UnifiedGlare
from lensforge.errors import InputError
from lensforge.light.by_intensities import of_table
from lensforge.sources.intensity import TabulatedIntensity

# UGR of the example of CIE 190:2010, printed with one digit, whose lamps are one H apart: crosswise and endwise, each
# for ceiling, walls and plane of 70/50/20 and of 30/30/20.
PRINTED = {
    "2H 2H": (8.9, 11.1, 10.7, 12.9), "2H 12H": (12.0, 14.0, 13.8, 15.8), "4H 8H": (13.0, 14.7, 14.7, 16.4),
    "8H 4H": (12.4, 14.1, 14.0, 15.8), "8H 12H": (14.1, 15.7, 15.2, 16.8), "12H 8H": (13.7, 15.3, 15.1, 16.7),
}  # fmt: skip


def office(**fields: object) -> OfficeSection:
    return OfficeSection(**OFFICE | fields)


@pytest.mark.parametrize("room", PRINTED)
def test_example_of_the_standard(room: str) -> None:
    ratings = []
    for reflectances in ("70/50/20", "30/30/20"):
        section = office(room=room, reflectances=reflectances, spacing=1.0, luminous_m=LUMINOUS_M)
        judged = OfficeLight(section).judged(luminaire(), "office")
        ratings.append((judged.crosswise.value, judged.endwise.value))
    (cross, end), (cross_dark, end_dark) = ratings
    assert (cross, cross_dark, end, end_dark) == pytest.approx(PRINTED[room], abs=0.14)


def test_another_program_finds_the_same() -> None:
    """eulumdat-ugr 1.0.2: the same lamps a quarter of H apart in 4H 8H, 70/50/20."""
    judged = OfficeLight(office(luminous_m=LUMINOUS_M)).judged(luminaire(), "office")
    assert (judged.crosswise.value, judged.endwise.value) == pytest.approx((13.24916, 14.79994), rel=1e-3)


C_DEG, GAMMA_DEG = np.arange(0.0, 361.0, 30.0), np.arange(0.0, 91.0, 5.0)


def crooked() -> TabulatedIntensity:
    turn, gamma = np.meshgrid(np.radians(C_DEG), np.radians(GAMMA_DEG), indexing="ij")
    values = 1500.0 * np.cos(gamma) ** 1.3 * (1.0 + 0.5 * np.sin(gamma) * np.cos(turn - 0.7)) + 20.0
    return TabulatedIntensity(C_DEG, GAMMA_DEG, values)


def candela_at(table: TabulatedIntensity, c_deg: float, gamma_deg: float) -> float:
    """Bilinear between the nodes."""
    i = int(c_deg % 360.0 // 30.0)
    k = min(int(gamma_deg // 5.0), 17)
    a, b = c_deg % 360.0 / 30.0 - i, gamma_deg / 5.0 - k
    near = (1.0 - b) * table.values[i, k] + b * table.values[i, k + 1]
    far = (1.0 - b) * table.values[i + 1, k] + b * table.values[i + 1, k + 1]
    return float((1.0 - a) * near + a * far)


def by_loops(section: OfficeSection, table: TabulatedIntensity, turn_deg: float) -> tuple[float, float]:
    """UGR and background of lamps in a room of 4 x 6 H, one after the other; reflected light bounce after bounce."""
    high = section.above_eyes_m
    rows = [line.split(",") for line in Path(office_room.__file__).with_name("position_index.csv").read_text().split()]
    index = {
        (float(row[0]), float(up)): float(p)
        for row in rows[1:]
        for up, p in zip(rows[0][1:], row[1:], strict=True)
        if p
    }

    def p_of(up: float, aside: float) -> float:
        low_up, low_aside = int(up * 10) / 10, int(aside * 10) / 10
        u, v = (up - low_up) * 10, (aside - low_aside) * 10
        corner = [[index[round(low_aside + k / 10, 1), round(low_up + j / 10, 1)] for j in (0, 1)] for k in (0, 1)]
        return (1 - v) * ((1 - u) * corner[0][0] + u * corner[0][1]) + v * ((1 - u) * corner[1][0] + u * corner[1][1])

    total = 0.0
    for ahead in (0.5 + np.arange(6)) * high:
        for aside in (-1.5 * high, -0.5 * high, 0.5 * high, 1.5 * high):
            if abs(aside) > 3.0 * ahead or high / ahead > 1.7:
                continue
            level = hypot(ahead, aside)
            gamma = degrees(atan2(level, high))
            # Files count C the other way than a lens its azimuth.
            candela = candela_at(table, -(degrees(atan2(-aside, ahead)) + turn_deg), gamma)
            area = section.luminous_m[0] * section.luminous_m[1] * cos(radians(gamma))
            luminance = candela / area
            total += luminance**2 * area / (level**2 + high**2) / p_of(high / ahead, abs(aside) / ahead) ** 2
    flux = np.zeros(4)  # within the cones, and of all
    for gamma in np.arange(0.05, 90.0, 0.1):
        mean = np.mean([candela_at(table, c + 0.001, gamma) for c in np.arange(2.5, 360.0, 5.0)])
        part = mean * 2.0 * pi * sin(radians(gamma)) * radians(0.1)
        flux += part * (cos(radians(gamma)) > np.array([0.75, 0.5, 0.25, -1.0]))
    direct = float(flux @ [0.296, 0.203, 0.449, -0.006])  # k = 2.4
    lit = np.array([direct, flux[3] - direct, 0.0]) * 24.0  # plane, walls, ceiling
    opposite = facing_squares(4.0, 6.0)
    ends = 24.0 * (1.0 - opposite) / 20.0
    first = lit[1]
    received = 0.0
    for _ in range(60):
        plane, walls, ceiling = lit * [0.2, 0.3, 0.5]
        lit = np.array(
            [
                walls * ends + ceiling * opposite,
                (plane + ceiling) * (1.0 - opposite) + walls * (1.0 - 2.0 * ends),
                plane * opposite + walls * ends,
            ]
        )
        received += lit[1]
    assert first > 0.0
    background = received / (20.0 * high**2) / pi
    return 8.0 * log10(0.25 / background * total), background


def facing_squares(width: float, length: float, steps: int = 60) -> float:
    """Share of light from one rectangle on an equal one at the distance 1: the double integral over both, by shifts."""
    x, y = (np.arange(-steps + 0.5, steps) / steps * side for side in (width, length))
    across, along = np.meshgrid(x, y)
    overlap = (width - abs(across)) * (length - abs(along))
    kernel = 1.0 / (pi * (1.0 + across**2 + along**2) ** 2)
    return float((overlap * kernel).sum() * (width / steps) * (length / steps) / (width * length))


@pytest.mark.parametrize("turn_deg", [0.0, 90.0])
def test_a_crooked_lamp_by_plain_loops(turn_deg: float) -> None:
    section = office(room="4H 6H", reflectances="50/30/20", spacing=1.0, above_eyes_m=1.4, luminous_m=(0.3, 0.8))
    judged = OfficeLight(section).judged(of_table(crooked(), 270.0, 1.0), "office")
    rating, background = by_loops(section, crooked(), turn_deg)
    metric = judged.crosswise if turn_deg == 0.0 else judged.endwise
    assert metric.value == pytest.approx(rating, abs=2e-3)
    assert judged.background_cd_per_m2.value == pytest.approx(background, rel=1e-3)
    assert judged.crosswise.value != pytest.approx(judged.endwise.value, abs=0.1)


def test_twice_the_light_is_a_rating_higher_by_8_lg_2() -> None:
    """The sum grows with its square, the background with it."""

    def rating(factor: float) -> float:
        return OfficeLight(office()).judged(of_table(crooked(), 270.0, factor), "o").crosswise.value

    assert rating(2.0) - rating(1.0) == pytest.approx(8.0 * log10(2.0), abs=1e-9)


@pytest.mark.parametrize(("off", "reached"), [(-1e-6, "UGR 19"), (1e-6, "UGR 22")])
def test_both_sides_of_a_limit(off: float, reached: str) -> None:
    whole = OfficeLight(office()).judged(of_table(crooked(), 270.0, 1.0), "o")
    largest = max(whole.crosswise.value, whole.endwise.value)
    factor = 10.0 ** ((19.0 + off - largest) / 8.0)
    judged = OfficeLight(office()).judged(of_table(crooked(), 270.0, factor), "o")
    worse = max(judged.limits, key=lambda limit: limit.metric.value)
    assert worse.metric.value == pytest.approx(19.0 + off, abs=1e-9)
    assert worse.holds == (off < 0.0) and judged.reached == reached


PLANE = {"pitch_m": (2.4, 1.8), "mean_lx": 1.0, "uniformity": 0.9}


def test_an_endless_ceiling_sends_all_its_light_to_the_plane() -> None:
    """Of Lambertian lamps of 1000 lm that part of it that meets the plane within five heights: 25/26."""
    gamma = np.linspace(0.0, 90.0, 181)
    lambertian = TabulatedIntensity(np.zeros(1), gamma, 1000.0 / pi * np.cos(np.radians(gamma))[None])
    judged = OfficeLight(office(**PLANE)).judged(of_table(lambertian, 270.0, 1.0), "o")
    assert judged.mean_lx is not None and judged.uniformity is not None
    assert judged.mean_lx.value == pytest.approx(1000.0 * 25.0 / 26.0 / (2.4 * 1.8), rel=2e-3)
    assert 0.97 < judged.uniformity.value < 1.0


def test_the_plane_below_crooked_lamps_by_plain_loops() -> None:
    table, high = crooked(), 2.45
    lux = []
    for x in (np.arange(7) + 0.5) / 7.0 * 2.4:  # steps of 0.37 m at most
        for y in (np.arange(5) + 0.5) / 5.0 * 1.8:
            here = 0.0
            for i in range(-9, 10):
                for j in range(-9, 10):
                    east, north = x - 2.4 * i, y - 1.8 * j
                    if hypot(east, north) <= 5.0 * high:
                        gamma = degrees(atan2(hypot(east, north), high))
                        candela = candela_at(table, -degrees(atan2(north, east)), gamma)
                        here += candela * high / (east**2 + north**2 + high**2) ** 1.5
            lux.append(here)
    judged = OfficeLight(office(**PLANE)).judged(of_table(table, 270.0, 1.0), "o")
    assert judged.mean_lx is not None and judged.uniformity is not None
    assert judged.mean_lx.value == pytest.approx(np.mean(lux), rel=1e-9)
    assert judged.uniformity.value == pytest.approx(np.min(lux) / np.mean(lux), rel=1e-9)
    bounds = {limit.label: (limit.metric.value, limit.bound) for limit in judged.limits[2:]}
    assert bounds == {
        "mean illuminance": (judged.mean_lx.value, 1.0), "uniformity U0": (judged.uniformity.value, 0.9)
    }  # fmt: skip


def test_bounds_of_the_plane_need_a_pitch() -> None:
    with pytest.raises(
        InputError, match=r"uniformity is of the working plane below lamps in equal steps; give their pi"
    ):
        office(uniformity=0.6)
    assert OfficeLight(office()).judged(luminaire(), "o").mean_lx is None


def test_position_index_of_the_table() -> None:
    assert position_index(np.array([0.5, 0.55]), np.array([0.5, 0.5])) == pytest.approx([2.91, 0.5 * (2.91 + 3.40)])
    assert np.isnan(position_index(np.array([1.95, 1.85]), np.array([1.0, 0.1]))).all()


def test_the_search_follows_the_rating() -> None:
    """1 at the bound; its gradient by finite differences."""
    light = np.array([40.0, 70.0, 20.0, 310.0])
    rating = UnifiedGlare().value(light[None], "<=", "", light[None]).value
    assert rating == pytest.approx(8.0 * log10(0.25 * (40.0**2 + 70.0**2 + 20.0**2) / 310.0))
    assert UnifiedGlare().relative(light, rating, light) == pytest.approx([1.0])
    leaf = torch.tensor(light, requires_grad=True)
    (relative,) = UnifiedGlare().relative(leaf, 19.0, leaf)
    relative.backward()
    steps = 1e-5 * np.eye(4)
    sides = ([UnifiedGlare().relative(light + sign * s, 19.0, light).item() for s in steps] for sign in (1.0, -1.0))
    differences = np.subtract(*sides) / 2e-5
    assert leaf.grad is not None and leaf.grad.numpy() == pytest.approx(differences, rel=1e-6)


def test_the_dark_glares_most_and_a_beam_that_ends_early_not_at_all() -> None:
    dark = np.zeros((1, 5))
    assert UnifiedGlare().value(dark, "<=", "", dark).value == 1e6
    early = np.array([[0.0, 0.0, 3.0]])
    assert UnifiedGlare().value(early, "<=", "", early).value == 0.0


def test_lamps_beyond_the_table_and_near_the_horizon_do_not_glare() -> None:
    light = OfficeReadings(office(room="2H 12H"))._lamps(0.0)
    assert light.gamma_deg.max() <= 85.0
    level = np.tan(np.radians(light.gamma_deg))
    ahead = level * np.cos(np.radians(light.azimuth_deg + 90.0))
    aside = level * np.sin(np.radians(light.azimuth_deg + 90.0))
    assert (ahead > 1.0 / 1.9).all() and (np.abs(aside) <= 3.0 * ahead).all()
