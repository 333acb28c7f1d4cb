"""Numbers on the drawing and in the tables of points against the exact faces of the page."""

import csv
import json
import re
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from crooked import DESIGNS, Case
from page_body import PageBody, directions

import lensforge as lf
from lensforge.shop.dimensions import dimensions
from lensforge.shop.point_tables import GridRequest, dense_tables, points_table
from lensforge.shop.sheet_tables import optical_table

TIR = Path(__file__).parents[1] / "definitions" / "lenses" / "tir.json"


def dimensions_of(lens: dict) -> Iterator[tuple[str, float]]:
    """Every size of a lens on a base without relief, by its name on the drawing."""
    spec = lens["spec"]
    body = PageBody(lens)
    base = spec["base"]
    flange = spec["lens"].get("flange")
    top = max(part.extreme(lambda s, f, part=part: part.at(s, f)[0][..., 2]) for part in body.envelope)
    wide = 2 * max(across_mm(part) for part in body.envelope)
    axis = np.array([[0.0, 0.0, 1.0]])
    apex, width = ("outer apex", "dome") if "outer" in body.parts else ("apex of the exit", "lens")
    if "mouth" not in body.parts:
        outer, inner = (float(body.radius(parts, axis)[0]) for parts in (body.envelope, body.cavity))
        yield from ((f"{apex} above z = 0", outer), ("apex of the cavity above z = 0", inner))
        yield "thickness on the axis", outer - inner
    yield from (("highest point above z = 0", top), (f"width of the {width}", wide))
    for name, start in (("x", 0.0), ("y", np.pi / 2)):
        ways = start + np.array([0.0, np.pi])
        flat = directions(np.full(2, np.pi / 2), ways)
        yield f"outer rim in z = 0, along {name}", body.radius(body.envelope, flat).sum()
        yield f"opening of the cavity in z = 0, along {name}", body.radius(body.cavity, flat).sum()
        for parts in (body.envelope, body.cavity):
            for face, following in pairwise(parts):
                u = directions(face.ends(ways)[1], ways)
                p = face.exact(u)[0][:, None] * u
                label = f"crease of {face.name} and {following.name}, along {name}"
                yield label, np.hypot(p[:, 0], p[:, 1]).sum()
                yield f"{label}, above z = 0", p[0, 2]
    height = 0.0
    if base["kind"] != "none":
        height = base["height_mm"]
        wide = max(wide, base["diameter_mm"])
        yield from (("height of the base below z = 0", height), ("diameter of the base", base["diameter_mm"]))
    if flange:
        exit_ = body.parts["exit"]
        phi = 2 * np.pi * np.arange(1440) / 1440
        u = directions(exit_.ends(phi)[1], phi)
        low = (exit_.exact(u)[0] * u[:, 2]).min() - flange["setback_mm"] - flange["thickness_mm"]
        yield "thickness of the rim's flange", flange["thickness_mm"]
        yield "underside of the rim's flange above z = 0", low
        yield "apex of the cavity to the rim's flange", abs(low - inner)
        yield "diameter of the rim's flange", flange["diameter_mm"]
        wide = max(wide, flange["diameter_mm"])
    yield from (("overall length", top + height), ("largest width", wide))


def across_mm(part) -> float:
    return part.extreme(lambda s, f: np.hypot(*np.moveaxis(part.at(s, f)[0][..., :2], -1, 0)))


@pytest.mark.parametrize("file", [TIR, DESIGNS / "cup" / "lens.json", DESIGNS / "plate" / "lens.json"], ids=str)
def test_every_dimension(file: Path) -> None:
    expected = dict(dimensions_of(json.loads(file.read_text(encoding="utf-8"))))
    sizes = dimensions(lf.load_lens(file))
    assert {size.name: size.value_mm for size in sizes} == {
        name: pytest.approx(value, abs=5e-4 if "crease" in name or "flange" in name else 2e-5)
        for name, value in expected.items()
    }
    for dimension in sizes:  # a size that is drawn is the distance of its ends, measured across or along the axis
        if dimension.ends is not None and dimension.view in ("S", "T"):
            (z, x), (other_z, other_x) = dimension.ends
            assert dimension.value_mm == pytest.approx(
                abs(other_x - x) if dimension.upright else abs(other_z - z), abs=1e-9
            )


@pytest.mark.parametrize("name", ["cup", "plate"])
def test_faces_on_the_drawing(case: Callable[[str], Case], name: str) -> None:
    """Sphere, departure, aperture between the creases, and area of each face of the part, whatever is cut."""
    scene = case(name)
    check = scene.results["check"]
    part = scene.results["export"]
    lens = lf.load_lens(scene.folder / "lens.json")
    body = PageBody(scene.lens)
    told = 0
    for face, column in optical_table(lens, part, check, lens.spec.drawing).columns.items():
        if face not in body.parts:
            continue
        told = told + 1
        text = " ".join(column.values())
        assert column["title"].lower().startswith(f"{face} face")
        stated = {key: float(re.search(rf"{key} ?(-?[\d.]+)", text)[1]) for key in ("best-fit R", "PV", "aperture: ⌀")}
        record = scene.json("check")[face]
        scale = scene.json("check")["scale"]
        assert stated["best-fit R"] == pytest.approx(record["best_fit_sphere"]["radius_mm"] / scale, abs=6e-4)
        assert stated["PV"] == pytest.approx(record["best_fit_sphere"]["pv_mm"] / scale, abs=6e-4)
        assert stated["aperture: ⌀"] == pytest.approx(2.0 * across_mm(body.parts[face]), abs=6e-4)
        assert f"{record['area_mm2'] / scale**2:.1f} mm²" in text
    assert told == len(check.faces)


@pytest.mark.parametrize("name", ["cup", "plate"])
def test_points_of_the_tables(case: Callable[[str], Case], name: str) -> None:
    """Points and normals into the air of the exact faces, times the scale of a mould; departures from the sphere."""
    scene = case(name)
    body = PageBody(scene.lens)
    shop = scene.lens["spec"]["manufacture"]
    check = scene.json("check")
    insert = shop["process"] == "moulded"
    scale = 1.0 + shop["shrinkage"] if insert else 1.0
    lens = lf.load_lens(scene.folder / "lens.json")
    text = points_table(lens, scene.results["check"], [])
    rows = list(csv.reader(line for line in text.splitlines() if not line.startswith("#")))[1:]
    for face in (part for part in body.parts if part in check):
        values = np.array([row[1:] for row in rows if row[0] == face], dtype=float)
        points = values[:, :3]
        air = values[:, 3:6]
        (polar, azimuth, away) = values[:, 6:9].T
        u = directions(np.radians(polar), np.radians(azimuth))
        rho, n = body.parts[face].exact(u)
        np.testing.assert_allclose(points, scale * rho[:, None] * u, rtol=0, atol=2e-8)
        side = (-1.0 if body.parts[face].before == "cavity" else 1.0) * (-1.0 if insert else 1.0)
        np.testing.assert_allclose(air, side * n, rtol=0, atol=2e-8)
        sphere = check[face]["best_fit_sphere"]
        sag = np.linalg.norm(points - sphere["centre_mm"], axis=1) - sphere["radius_mm"]
        np.testing.assert_allclose(away, sag, rtol=0, atol=2e-8)
        low, high = body.parts[face].ends(np.radians(azimuth))
        assert len(values) > 300 and ((low - 1e-6 < np.radians(polar)) & (np.radians(polar) < high + 1e-6)).all()


def test_dense_tables_say_their_error(case: Callable[[str], Case]) -> None:
    """Between the nodes bilinear interpolation over the angles is off by what is stated, found anew in the middles."""
    scene = case("plate")
    lens = lf.load_lens(scene.folder / "lens.json")
    scale = 1.007
    body = PageBody(scene.lens)
    for grid in dense_tables(lens, [], GridRequest(spacing_mm=0.3, interpolation="linear")):
        lines = [line for line in grid.content.decode().splitlines() if line and not line.startswith("#")]
        table = np.array([line.split(",")[-8:] for line in lines[1:]], dtype=float)
        rings = np.unique(table[:, 6])
        turns = np.unique(table[:, 7])
        every = np.concatenate([np.repeat(table[:1], len(turns), axis=0), table[1:]])  # the apex stands there once
        height, across = (
            column.reshape(len(rings), len(turns)) for column in (every[:, 2], np.hypot(every[:, 0], every[:, 1]))
        )
        assert grid.points == len(table) and (np.diff(rings) < rings[1] * 1.01).all()
        off = []
        for z, r, _, phi in middles(height, across, rings, turns):
            points = np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=-1).reshape(-1, 3)
            away = np.linalg.norm(points, axis=1)
            rho, n = body.parts[grid.face].exact(points / away[:, None])
            off.append(abs((away - scale * rho) * (n * points).sum(axis=1) / away).max())
        assert grid.error_nm == pytest.approx(1e6 * max(off), rel=0.05)


def middles(height, across, rings, turns) -> Iterator[tuple[np.ndarray, ...]]:
    """Values in the middle of cells and of their sides, with their angles (rad)."""
    turned = np.radians(np.append(turns, turns[0] + 360.0))
    height, across = (np.column_stack([array, array[:, :1]]) for array in (height, across))
    theta = np.radians(rings)
    for a, b in ((1, 0), (0, 1), (1, 1)):
        rows = len(theta) - a
        columns = len(turned) - b
        mean = [sum(array[i : i + rows, j : j + columns] for i in {0, a} for j in {0, b}) / (1 + a) / (1 + b)
                for array in (height, across)]  # fmt: skip
        yield *mean, theta[:rows, None], ((turned[:columns] + turned[b : columns + b]) / 2)[None, :]
