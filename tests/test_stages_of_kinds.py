"""The table of kinds and stages in docs/architecture.md: a row for each kind that is registered, and each cell holds.

Cells of a day: what makes no sense, and the light. By night every other cell is run.
"""

import re
from collections.abc import Callable
from pathlib import Path
from tempfile import mkdtemp
from typing import Any, get_args

import pytest
from addon_rows import addon_rows, has_addon
from presets import FEW_STEPS
from scenes import small_spec
from undrawn import undrawn

import lensforge as lf
from lensforge.light.lens_light import searched_source
from lensforge.report.results import Results
from lensforge.results import ResultByLed
from lensforge.search.scene_symmetry import settled_symmetry
from lensforge.search.start_faces import start_faces
from lensforge.spec import ReceiverSection
from lensforge.spec.housing_sections import HousingSection
from lensforge.spec.lamps_section import AnyLamps
from lensforge.spec.lens_section import LensShape
from lensforge.surfaces.surface import Surface
from lensforge.verbs import STAGES, STRAY

ROOT = Path(__file__).parents[1]
TABLE = re.search(
    r"<!-- kinds and stages -->\n\n(.*?)\n\n<!--", (ROOT / "docs/architecture.md").read_text("utf-8"), re.S
)
BEAM = {"target": {"kind": "disc", "diameter_deg": 20.0, "half_angle_deg": 60.0}}
CONSTRAINTS = {"cavity_height_mm": 0.5, "cavity_radius_mm": 1.0, "min_thickness_mm": 1.0, "max_radius_mm": 12.0}
TURNED = BEAM | {"constraints": CONSTRAINTS, "optimise": {"steps_per_level": [1], "rays": 512, "aim": "share"}}
LAMPS = {"kind": "table", "places_mm": [[-20.0, 3.0], [18.0, -2.0]]}
AIMS = {"aims_mm": [[0.0, 9.0, 100.0], [5.0, -20.0, 100.0]]}
FAR = {"kind": "far_field", "half_angle_deg": 90.0, "targets": [{"kind": "disc", "diameter_deg": 60.0}]}
ROAD = {"lighting_class": "P4", "width_m": 5.0, "pole_height_m": 5.0, "pole_spacing_m": 14.0, "lamp_lm": 900.0}
DISC = [{"kind": "disc", "diameter_mm": 60.0}]
ROUND = {"centre_mm": [0.0, 0.0, 100.0], "facing": [0.0, 0.0, 1.0], "radius_mm": 200.0}
NEAR = {"kind": "disc", "diameter_mm": 60.0, "distance_mm": 100.0, "receiver_mm": 60.0}


LEANING = {"tilt_deg": [4.0, -7.0], "rotate_z_deg": 20.0}
WALL = "solid wall\n{}endsolid wall\n"
CORNERS = [(-9.0, -1.0, 0.0), (9.0, -1.0, 0.0), (0.0, 8.0, 0.0), (0.0, 0.0, 20.0)]


def wall_file() -> Path:
    """A file of a body with four corners."""
    path = Path(mkdtemp()) / "wall.stl"
    sides = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)]
    vertices = ["".join(f"vertex {' '.join(map(str, CORNERS[corner]))}\n" for corner in side) for side in sides]
    facets = (f"facet normal 0 0 0\nouter loop\n{side}endloop\nendfacet\n" for side in vertices)
    path.write_text(WALL.format("".join(facets)), encoding="utf-8")
    return path


def on(**receiver: Any) -> dict[str, Any]:
    """Changes of a spec for one receiver."""
    return {"target": None, "receivers": [receiver]}


SCENES: dict[str, dict[str, Any]] = {
    "lens double": {},
    "lens tir": TURNED | {"lens": {"kind": "tir"}, "base": {"kind": "none"}},
    "lens reflector": TURNED | {"lens": {"kind": "reflector"}, "base": {"kind": "none"}},
    "lens extruded": {"lens": {"kind": "extruded", "length_mm": 30.0, "profile": 8}, "base": {"kind": "none"}}
    | {"optimise__steps_per_level": [1]},
    "lens extruded_tir": TURNED
    | {"lens": {"kind": "extruded_tir", "length_mm": 30.0, "ends": "free"}, "base": {"kind": "none"}},
    "lamps grid": {"lamps": {"kind": "grid", "columns": 2, "rows": 1, "pitch_mm": 40.0}},
    "lamps hexagon": {"lamps": {"kind": "hexagon", "rings": 1, "pitch_mm": 40.0}},
    "lamps ring": {"lamps": {"kind": "ring", "count": 3, "diameter_mm": 60.0}},
    "lamps table": {"lamps": LAMPS},
    "lamps endless": {"lamps": {"kind": "endless", "pitch_mm": 60.0}, "target": NEAR},
    "lamps with heights and aims": {"lamps": LAMPS | AIMS},
    "lamps with lenses of several kinds": {"lamps": LAMPS | {"kinds": ["wide", "narrow"]}},
    "receiver plane": on(kind="plane", centre_mm=[0.0, 0.0, 100.0], width_mm=200.0, height_mm=150.0, targets=DISC),
    "receiver far_field": on(**FAR),
    "receiver cylinder": on(kind="cylinder", **ROUND, width_mm=200.0, height_mm=150.0, targets=DISC),
    "receiver sphere": on(kind="sphere", **ROUND, half_angle_deg=30.0, targets=DISC),
    "plate": {"lamps": LAMPS, "plate": {"thickness_mm": 2.0}, "base": {"kind": "none"}},
    "plate with lenses of several kinds": {
        "lamps": LAMPS | {"kinds": ["wide", "narrow"]},
        "plate": {"thickness_mm": 2.0},
        "base": {"kind": "none"},
    },
    **({"roads": on(**FAR) | {"roads": [ROAD]}} if has_addon("road") else {}),
    "several LEDs": {
        "source": None,
        "sources": [
            {"name": "one", "source": {"kind": "square", "side_mm": 1.0, "flux_lm": 90.0}},
            {"name": "two", "source": {"kind": "disc", "diameter_mm": 0.7, "position_mm": [0.2, 0.1, 0.0]}},
        ],
    },
    "states": {
        "states": [
            {"name": "near"},
            {
                "name": "far",
                "shift_mm": [0.1, 0.0, -0.3],
                "target": BEAM["target"],
                "limits": [{"kind": "zone", "zone": {"kind": "disc", "diameter_deg": 20.0}, "at_least_share": 0.001}],
            },
        ],
    },
    "bodies": {
        "bodies": [
            {
                "name": "dome",
                "refractive_index": 1.5,
                "inner": {"fixed": {"kind": "sphere", "radius_mm": 15.0}},
                "outer": {"fixed": {"kind": "sphere", "radius_mm": 17.0}},
            }
        ]
    },
    "scene box": {
        "scene": [
            {
                "kind": "box",
                "name": "wall",
                "size_mm": [80.0, 2.0, 30.0],
                "centre_mm": [3.0, 25.0, 30.0],
                "patch_mm": 9.0,
            }
            | LEANING
        ],
        "lamps": LAMPS,
    },
    "scene cylinder": {
        "scene": [
            {
                "kind": "cylinder",
                "name": "bezel",
                "radius_mm": 50.0,
                "bore_radius_mm": 15.0,
                "length_mm": 2.0,
                "patch_mm": 6.0,
                **LEANING,
            }
            | {"centre_mm": [1.0, -2.0, 25.0]}
        ],
        "limits": [{"kind": "body", "body": "bezel", "of": "mean", "at_least": 1e-9, "unit": "w_per_m2"}],
    },
    "scene file": {
        "scene": [{"kind": "file", "name": "wall", "file": str(wall_file()), "centre_mm": [0.0, 30.0, 40.0]}]
    },
    "scene room": {
        "scene": [
            {
                "kind": "room",
                "name": "room",
                "size_mm": [400.0, 300.0, 240.0],
                "centre_mm": [9.0, -5.0, 90.0],
                "patch_mm": 60.0,
            }
            | {"surface": "diffuse", "reflectance": 0.5, "floor_reflectance": 0.2}
            | LEANING
        ],
        "limits": [{"kind": "body", "body": "room-wall-2", "of": "mean", "at_least": 1e-9, "unit": "w_per_m2"}],
    },
    "cover glass": {"lens__cover_glass": {"distance_mm": 20.0, "thickness_mm": 2.0, "refractive_index": 1.5}},
}
NAMES = {"several LEDs": ["one", "two"], "states": ["near", "far"]}
NO_SENSE = "–: "
VERBS: dict[str, Callable[[lf.Lens, Path], Any]] = {
    "design": lambda lens, _: lf.design(lens.spec, accuracy=FEW_STEPS, force=True, warn=lambda _: None),
    "evaluate": lambda lens, _: lf.evaluate(lens, rays=512),
    "export": lambda lens, _: lf.build(lens),
    "check": lambda lens, _: lf.check(lens),
    "verify": lambda lens, _: lf.verify(lf.build(lens), lf.evaluate(lens, rays=512), rays=512),
    "stray": lambda lens, _: lf.stray_light(lf.build(lens), rays=64),
    "photometry": lambda lens, _: lf.photometry(lens, rays=512),
    "report": lambda lens, folder: lf.run(lens.spec, folder, accuracy=FEW_STEPS, force=True, warn=lambda _: None),
    "handover": lambda lens, _: lf.handover(whole(lens), spacing_mm=2.0),
    "sensitivity": lambda lens, _: lf.sensitivity(lens, rays=256),
    "yield": lambda lens, _: lf.tolerance(lens, parts=40, rays=256, budget=False),
    "sweep": lambda lens, _: lf.sweep(lens.spec, "evaluate.rays", [512, 1024], accuracy=FEW_STEPS),
    "tradeoff": lambda lens, _: lf.tradeoff(lens.spec, lens=lens, most_rays=2**12, accuracy=FEW_STEPS),
}
OF_ADDONS: dict[str, Callable[[lf.Lens, Path], Any]] = addon_rows("VERBS")


def whole(lens: lf.Lens) -> Results:
    part = lf.build(lens)
    return Results(lens, {result.stage: result for result in (part, lf.check(part))})


def lens_of(row: str) -> lf.Lens:
    """A lens of the faces from which a search of this scene begins."""
    spec = small_spec(**SCENES[row])
    if spec.lens.levels == "auto":
        spec = spec.replace({"lens.levels": [4]})
    spec = settled_symmetry(spec, searched_source(spec))
    faces: dict[str, Surface] = start_faces(spec)
    others = {kind.name: faces for kind in spec.all_lamps.kinds[1:]}
    return lf.Lens(faces, spec, 0, FEW_STEPS, others=others)


def cells() -> dict[str, dict[str, str]]:
    """Rows of the table in the docs, by their names, each with its cells by the names of the columns."""
    assert TABLE is not None
    head, _, *rows = ([cell.strip(" `") for cell in line.strip("|").split("|")] for line in TABLE[1].splitlines())
    absent = () if has_addon("road") else ("roads",)
    return {name: dict(zip(head[1:], row, strict=True)) for name, *row in rows if name not in absent}


CELLS = [(row, stage, cell) for row, by_stage in cells().items() for stage, cell in by_stage.items()]


def test_every_kind_and_every_stage_has_its_place() -> None:
    """A kind that is registered, and a stage of the table of commands, stand in the table; and no cell is empty."""
    lamps = [kind.model_fields["kind"].default for kind in get_args(get_args(AnyLamps)[0])]
    kinds = {f"lens {kind}" for kind in LensShape.kinds} | {f"lamps {kind}" for kind in lamps}
    kinds |= {f"receiver {kind}" for kind in ReceiverSection.kinds} | {f"scene {kind}" for kind in HousingSection.kinds}
    assert kinds <= set(cells()) and set(cells()) == set(SCENES)
    stages = {stage.name for stage in (*STAGES, STRAY)}
    for row in cells().values():
        assert stages <= set(VERBS) and {*VERBS, *OF_ADDONS} <= set(row)
        assert all(cell == "all" or cell.startswith(NO_SENSE) for cell in row.values())


@pytest.mark.parametrize(("row", "stage", "cell"), [cell for cell in CELLS if cell[-1] != "all"])
def test_what_makes_no_sense_is_said_by_the_result(row: str, stage: str, cell: str, tmp_path: Path) -> None:
    """In one line, the reason of the table first; or refused in such a line, behind the name of the stage."""
    try:
        messages = (VERBS | OF_ADDONS)[stage](lens_of(row), tmp_path).warnings
    except lf.InputError as error:
        messages = (str(error).removeprefix(f"{stage}: "),)
    (line,) = [message for message in messages if message.startswith(cell.removeprefix(NO_SENSE))]
    assert "\n" not in line


@pytest.mark.parametrize("row", ["lens tir", "lens reflector"])
def test_a_lens_without_levels_to_choose_is_searched_as_it_is(row: str) -> None:
    spec = small_spec(**SCENES[row])
    assert spec.with_automatic_levels() == spec


BY_DAY = ("evaluate",)
OTHERS = [
    pytest.param(row, stage, marks=() if stage in BY_DAY else pytest.mark.nightly("a part or a search of each"))
    for row, stage, cell in CELLS
    if cell == "all" and stage in VERBS  # those of add-ons are of one face, whatever the scene
]


@pytest.mark.parametrize(("row", "stage"), OTHERS)
def test_every_other_cell_runs(row: str, stage: str, tmp_path: Path) -> None:
    """Of several LEDs or states a light, a proof and a far field that are of all name each."""
    with undrawn():
        result = VERBS[stage](lens_of(row), tmp_path)
    if row in NAMES and isinstance(result, ResultByLed):
        assert list(result.by_led) == NAMES[row]
