"""A kind of lens that the package does not know, from its TOML to the proof of its files; and who asks for a kind."""

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from presets import FAR
from pydantic import Field
from scenes import small_spec

import lensforge as lf
from lensforge.optics.face_roles import BODY, CAVITY, OUTSIDE, FaceRole
from lensforge.scene.body import Chain
from lensforge.scene.lens import Lens
from lensforge.search.parameters import SphereParameters
from lensforge.search.start_faces import start_faces
from lensforge.spec.derived_values import LensSizes
from lensforge.spec.lens_section import LensShape, ProfiledShape, StartConditions
from lensforge.surfaces.reciprocal import ConicFace, PlaneFace
from lensforge.surfaces.surface import Surface

RIM_RAD = np.radians(40.0)  # angle from the axis at which wall and top meet
INDEX = 1.5
WELL_MM = 1.2
ROLES = (
    FaceRole("well", CAVITY, BODY),
    FaceRole("mirror", BODY, OUTSIDE, reflects=True, widens=True, is_placed=True),
    FaceRole("top", BODY, OUTSIDE, on_axis=True, is_placed=True),
)
SPEC = f"""
[source]
kind = "square"
side_mm = 0.02
[lens]
kind = "dish"
refractive_index = {INDEX}
profile = 8
[lens.mirror]
form_um = 0.5
[constraints]
max_radius_mm = 8.0
[target]
kind = "disc"
diameter_deg = 10.0
half_angle_deg = 20.0
[optimise]
aim = "share"
steps_per_level = [6]
rays = 1024
[[limits]]
kind = "zone"
zone = {{ kind = "disc", diameter_deg = 10.0 }}
at_least_share = 0.5
"""


@pytest.fixture(autouse=True)
def _forgotten() -> Iterator[None]:
    """The package knows the kinds of a test as long as it runs."""
    before = dict(LensShape.kinds)
    yield
    LensShape.kinds.clear()
    LensShape.kinds.update(before)
    LensShape.build_holders_again()


@pytest.fixture
def dish() -> type[LensShape]:
    """A solid paraboloid about the source, with a ball of air in it: three faces, one of which reflects totally."""

    class DishSection(ProfiledShape):
        """A dish."""

        roles = ROLES
        title = "dish"
        kind: Literal["dish"]
        well: lf.FaceSection = Field(default_factory=lf.FaceSection)
        mirror: lf.FaceSection = Field(default_factory=lf.FaceSection)
        top: lf.FaceSection = Field(default_factory=lf.FaceSection)

        def start_faces(self, conditions: StartConditions) -> dict[str, Surface]:
            radius_mm = conditions.limits.rim_radius_mm
            height_mm = radius_mm / np.tan(RIM_RAD)
            reach_mm = 1.4 * np.hypot(radius_mm, height_mm)
            wall = ConicFace(reach_mm, radius_mm * np.tan(0.5 * RIM_RAD), 1.0)
            return {"well": ConicFace(reach_mm, WELL_MM, 0.0), "mirror": wall, "top": PlaneFace(reach_mm, height_mm)}

    return DishSection


def test_a_kind_of_lens_of_ones_own_is_read_lit_searched_built_and_proven(
    dish: type[LensShape], tmp_path: Path
) -> None:
    file = tmp_path / "dish.toml"
    file.write_text(SPEC, encoding="utf-8")
    spec = lf.load_spec(file)
    assert type(spec.lens) is dish
    assert spec.part_tolerances.amount("mirror", "form_um") == 0.5
    with pytest.raises(lf.InputError, match=r"well\.shift_mm: this face is what the next is placed against; give mirr"):
        spec.replace({"lens.well.shift_mm": 0.1})
    with pytest.raises(
        lf.InputError, match=r"lens\.kind = 'dash': must be one of double, extruded, extruded_tir, tir, reflector, dish"
    ):
        spec.replace({"lens.kind": "dash"})

    start = lf.evaluate(Lens(start_faces(spec), spec, 0, FAR), rays=2**14)
    once, straight = 1.0 - ((INDEX - 1.0) / (INDEX + 1.0)) ** 2, np.sin(np.radians(5.0)) / INDEX
    (limit,) = start.limits
    assert limit.value == pytest.approx(once**2 * (np.cos(RIM_RAD) ** 2 + straight**2), abs=2e-3)
    assert {way.faces for way in start.ways} == {("well", "top"), ("well", "mirror", "top"), ("mirror",)}

    design = lf.design(spec, accuracy=FAR)
    assert all(criterion.holds for criterion in design.criteria)
    light, part = lf.evaluate(design.lens, rays=2**12), lf.build(design.lens)
    assert light.limits[0].value > limit.value - 0.01
    assert all(f"OPTICAL_{role.name.upper()}".encode() in part.step for role in ROLES)
    cast = lf.verify(part, light, rays=2**10).first.brep
    assert cast is not None and cast.against_design.fates <= 2
    assert cast.against_design.rms < 0.05, "mm at 1 m, through the STEP file"


def test_a_lens_of_two_faces_with_another_start_is_searched_from_there() -> None:
    class ShellSection(lf.LensSection):
        """A shell that is half as thick as others."""

        kind: Literal["shell"] = "shell"  # type: ignore[assignment]

        def derived_offsets_mm(self, sizes: LensSizes) -> dict[str, float]:
            outer = super().derived_offsets_mm(sizes)["outer"]
            return {"inner": outer - 2.0 * sizes.min_thickness_mm, "outer": outer}

    usual = small_spec(lens={"levels": [9, 25]})
    spec = usual.replace({"lens.kind": "shell"})
    assert type(spec.lens) is ShellSection and spec.lens.start_mm["outer"] == usual.lens.start_mm["outer"] == 6.86
    begun = SphereParameters.of(spec, 2.5).start_surfaces["inner"]
    assert begun.radius(np.eye(3)) == pytest.approx(6.86 - 2.0 * 0.714, abs=1e-12)  # 0.27 times the root of 7 mm
    assert Chain.of_lens(spec.lens) is None, "light meets one face after the other"


PACKAGE = Path(lf.__file__).parent
KINDS = {"double_lens.py", "internal_reflection.py", "extruded_tir.py", "reflector.py"}
# Names of the faces of some kinds that nothing else is called.
WORDS = {"cap", "exit", "cup", "mouth", "tir", "reflector", "double"}
OF_NUMBERS = {("point_files.py", "double")}  # the type of a column in a PLY file


def test_nothing_but_its_own_module_and_shape_asks_for_a_kind_of_lens() -> None:
    asking, importing = set(), set()
    for path in (path for path in PACKAGE.rglob("*.py") if path.name not in KINDS):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and node.value in WORDS:
                asking.add((path.name, node.value))
            if isinstance(node, ast.ImportFrom) and f"{(node.module or '').rpartition('.')[2]}.py" in KINDS:
                importing.add(path.relative_to(PACKAGE).as_posix())
    assert {name for name, _ in asking - OF_NUMBERS} == {
        "collimator.py",
        "drawn_collimator.py",
        "grooved_collimator.py",
        "reflector_cup.py",
        "lens_section.py",
    }, "the shapes, and the kind of a bare table"
    assert importing == {"spec/__init__.py", "spec/design_spec.py"}
