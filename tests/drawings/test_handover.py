import csv
import hashlib
import json
import re
from dataclasses import replace

import numpy as np
import pytest

from lensforge.errors import InputError
from lensforge.geometry import export_lens
from lensforge.drawings.build import build_handover
from lensforge.drawings.dimensions import dimensions
from lensforge.drawings.section import dimensioned_section
from lensforge.lens import Lens
from lensforge.manufacturing.check import check_lens
from lensforge.spec import parse_spec
from lensforge.surfaces.srbf import SrbfBasis, SrbfSurface

BASE = {"diameter_mm": 16.0, "relief_step_mm": 0.4, "flange_diameter_mm": 20.0, "pocket_diameter_mm": 7.0}


def small_lens(base=BASE):
    basis = SrbfBasis((9, 25), 1.75)
    inner, outer = (
        SrbfSurface(basis, h * 0.01 * np.random.default_rng(int(h)).normal(size=basis.size), h) for h in (3.0, 6.0)
    )
    content = {
        "name": "shop",
        "source": {"kind": "square", "side_mm": 0.5},
        "lens": {
            "levels": [9, 25],
            "inner_offset_mm": 3.0,
            "outer_offset_mm": 6.0,
            "refractive_index": 1.49,
            "material": "<PMMA> & co",
        },
        "constraints": {
            "cavity_height_mm": 0.5,
            "cavity_radius_mm": 0.5,
            "min_thickness_mm": 0.1,
            "max_radius_mm": 8.0,
        },
        "target": {"kind": "flat_top", "distance_mm": 100.0, "receiver_mm": 100.0, "half_width_mm": 30.0},
        "base": base,
    }
    return Lens(inner, outer, parse_spec(content, "test"), 0, "draft")


@pytest.fixture(scope="module")
def handed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("handed")
    lens = small_lens()
    lens.save(folder / "lens.json")
    export_lens(lens, folder, rings=16)
    check_lens(lens, folder)
    return lens, folder, build_handover(folder)


def table(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_points_lie_on_the_exact_faces_with_their_normals_out_of_the_material(handed):
    lens, folder, result = handed
    rows = table(folder / "points.csv")
    assert len(rows) == result["points"] == 2 * 2593
    for name, sign in (("inner", -1.0), ("outer", 1.0)):
        values = np.array(
            [[float(v) for k, v in row.items() if k != "surface"] for row in rows if row["surface"] == name]
        )
        points, normals = values[:, :3], values[:, 3:]
        radius = np.linalg.norm(points, axis=1)
        assert np.abs(radius - getattr(lens, name).radius(points / radius[:, None])).max() < 5e-9
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=2e-9)
        assert (sign * np.sum(points * normals, axis=1) > 0.0).all()
        # The normal is what the points say: perpendicular to the chords around the ring at 45 degrees.
        ring = slice(1 + 17 * 72, 1 + 18 * 72)
        chord = np.roll(points[ring], -1, axis=0) - np.roll(points[ring], 1, axis=0)
        chord /= np.linalg.norm(chord, axis=1, keepdims=True)
        assert np.abs(np.sum(chord * normals[ring], axis=1)).max() < 0.02


def test_the_sag_table_is_the_departure_from_the_sphere_of_the_check(handed):
    _, folder, _ = handed
    check = json.loads((folder / "check.json").read_text(encoding="utf-8"))
    departures = [float(row["departure_mm"]) for row in table(folder / "sag.csv") if row["surface"] == "outer"]
    assert np.ptp(departures) == pytest.approx(check["outer"]["best_fit_sphere"]["pv_mm"], rel=0.03)
    assert np.ptp(departures) <= check["outer"]["best_fit_sphere"]["pv_mm"] * (1.0 + 1e-3)


def test_page_and_pdf_say_what_the_shop_must_know(handed):
    lens, folder, result = handed
    page = (folder / "manufacturing.html").read_text(encoding="utf-8")
    assert "&lt;PMMA&gt; &amp; co" in page
    assert f"{lens.refractive_index:g}" in page
    assert "http" not in re.sub(r"http://www\.w3\.org/[^\"]*", "", page), "one page, nothing fetched"
    for verdict in json.loads((folder / "check.json").read_text(encoding="utf-8"))["verdicts"]:
        assert f"{verdict['name']}, {verdict['surface']}" in page
    for name, digest in result["sha256"].items():
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == digest
        assert digest in page
    for value in ("16.0000 mm", "0.4000 mm", "20.0000 mm", "7.0000 mm"):
        assert value in page
    assert (folder / "manufacturing.pdf").read_bytes().startswith(b"%PDF")


def test_the_same_folder_gives_the_same_bytes(handed):
    _, folder, result = handed
    before = {name: (folder / name).read_bytes() for name in result["files"]}
    assert build_handover(folder)["files"] == result["files"]
    assert {name: (folder / name).read_bytes() for name in result["files"]} == before


def test_a_file_changed_since_the_export_is_refused(handed, tmp_path):
    _, folder, _ = handed
    for path in folder.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    (tmp_path / "lens.stl").write_bytes(b"another")
    with pytest.raises(InputError, match=r"lens\.stl: not the file that export\.json describes"):
        build_handover(tmp_path)
    (tmp_path / "check.json").unlink()
    with pytest.raises(InputError, match=r"check\.json: no such file; run `lensforge check"):
        build_handover(tmp_path)


def test_the_drawing_states_every_size_of_the_base(handed):
    lens, _, _ = handed
    base = lens.spec.base.model_copy(update={"relief_setback_mm": 0.25})
    lens = replace(lens, spec=lens.spec.model_copy(update={"base": base}))
    axes = dimensioned_section(lens).axes[0]
    stated = {text.get_text() for text in axes.texts}
    ring = next(d.value_mm for d in dimensions(lens) if "step's wall" in d.name)
    assert {"A", "B", "16.000", "2.000", "0.400", "20.000", "0.500", "7.000", "1.000", f"{ring:.3f}"} <= stated
    for surface in (lens.inner, lens.outer):
        assert f"{surface.radius(np.array([[0.0, 0.0, 1.0]]))[0]:.3f}" in stated
        assert f"{surface.radius(np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])).sum():.3f}" in stated
