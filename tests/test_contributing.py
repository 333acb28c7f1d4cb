"""What a further thing costs: the files that CONTRIBUTING names, and a kind of face that the package does not know."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from chains import clear, tables_of, upwards

from lensforge.cad.body_export import build_body, prove
from lensforge.kernels.fate import Fate
from lensforge.light.simulation import TracedLens
from lensforge.light.table_trace import Scene, TracedBundle
from lensforge.optics.media import BODY, CAVITY, OUTSIDE
from lensforge.proof.proof_inputs import optical_of
from lensforge.proof.sequential_cast import CastFate
from lensforge.proof.verification import passage_through
from lensforge.scene.body import Body, Face
from lensforge.surfaces.asphere import sphere
from lensforge.surfaces.bicubic_table import TableGrid
from lensforge.surfaces.reciprocal import ReciprocalSurface

ROOT = Path(__file__).parents[1]


def test_each_thing_to_add_touches_six_files_at_most_and_they_are_there() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    rows = [line.split("|")[1:3] for line in text.splitlines() if re.match(r"\| an? ", line)]
    assert {"a kind of face", "a body", "a receiver", "a source", "a ray-file format"} <= {
        row[0].strip() for row in rows
    }
    for thing, places in rows:
        named = re.findall(r"`((?:lensforge|docs|examples)/[\w./]+)`", places)
        assert len(named) <= 6, thing
        assert [place for place in named if not (ROOT / place).exists() and "NAME" not in place] == [], thing


@dataclass(frozen=True)
class Roof(ReciprocalSurface):
    """A pyramid's four planes, rounded into one another: a kind of face of a user's own."""

    height_mm: float = 8.0

    @property
    def symmetry(self) -> str:
        return "none"

    def reciprocal(self, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """``(z + (x^4 + y^4)/4) / h``."""
        x, y, z = directions.T
        slope = np.stack([x**3, y**3, np.ones_like(z)], axis=1) / self.height_mm
        return (z + 0.25 * (x**4 + y**4)) / self.height_mm, slope


def test_a_face_of_a_kind_of_ones_own_is_traced_exported_and_cast() -> None:
    body = Body(
        (
            Face("cap", sphere(4.0), CAVITY, BODY),
            Face("shell", sphere(9.0), BODY, OUTSIDE),
            Face("roof", Roof(12.0), BODY, OUTSIDE),
        )
    )
    media, rays, grid = clear(), upwards(200, 3, 0.5), TableGrid(401)
    traced = TracedLens.of_body(body, media, 3, 8.0)
    assert set(traced.table_error_nm) == {"cap", "shell", "roof"}
    design = TracedBundle.of(tables_of(body, grid), Scene(media, grid, True, None, body.chain(3)), rays)
    assert {0, 4, 8} <= set((design.met[design.met >= 0] // 4 * 4).tolist())
    built = build_body(body)
    files = built.files("roof")
    proof = prove(built, *files)
    assert proof.solid.valid and proof.stl.watertight
    assert max(error.form_max_nm for error in proof.form.values()) < 1.0
    found = passage_through(files[0], optical_of(body, 3), media, rays)
    left = design.exits.fates == Fate.LEFT_LENS
    assert np.array_equal(found.fates == CastFate.LANDED, left) and left.sum() > 100
    assert np.linalg.norm(found.points - design.exits.points, axis=1)[left].max() < 1e-5
    assert found.flux[left] == pytest.approx(design.exits.flux[left], rel=1e-4)
