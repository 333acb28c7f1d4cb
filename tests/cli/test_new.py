"""``lensforge new``: a commented spec that is valid, its derived values those of a spec without them, and refusals."""

import json
import math
import re
import shlex
import tomllib
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from in_this_process import lensforge

from lensforge.cli.cli import cli
from lensforge.errors import InputError
from lensforge.light.lens_light import source_of
from lensforge.search.scene_check import source_clearance_warnings
from lensforge.search.start_faces import start_faces
from lensforge.search.travel import require_clear_travel
from lensforge.spec import Spec, load_spec, parse_spec
from lensforge.spec.derived_values import WHY
from lensforge.spec.lens_section import LensShape
from lensforge.spec.new_spec import receiver_beside, source_in, target_in
from lensforge.spec.spec_reference import spec_schema
from lensforge.surfaces.grooved_face import GroovedFace

EXAMPLES = Path(__file__).parents[2] / "examples"
LIGHT = ("--source", "disc:1", "--target", "rectangle:200x150@300", "--max-radius", "14", "--material", "PMMA")
LAMP = (*LIGHT, "--lens", "double")


def test_a_new_spec_is_valid_and_says_what_is_derived(tmp_path: Path) -> None:
    code, _, _ = lensforge("new", tmp_path / "lamp.toml", *LAMP)
    assert code == 0
    text = (tmp_path / "lamp.toml").read_text(encoding="utf-8")
    assert text.startswith("#:schema ./lensforge.schema.json\n") and "upper bound 90" in text
    assert json.loads((tmp_path / "lensforge.schema.json").read_text(encoding="utf-8")) == spec_schema()
    spec = load_spec(tmp_path / "lamp.toml")
    assert spec.name == "lamp" and spec.lens.material == "PMMA" and spec.source.kind == "disc"
    kept = [line for line in text.splitlines() if "# derived: " not in line]
    assert len(kept) == len(text.splitlines()) - 6 and "[constraints]\nmax_radius_mm = 14.0 " in text
    assert not any(line.startswith("offset_mm") or "receiver_mm" in line for line in kept), (
        "derived values are comments"
    )
    (tmp_path / "lamp.toml").write_text("\n".join(kept), encoding="utf-8")
    assert load_spec(tmp_path / "lamp.toml") == spec, "a derived value may be left out"
    for why in ("constraints.cavity_radius_mm", "lens.inner.offset_mm", "target.receiver_mm"):
        assert f"# derived: {WHY[why]}" in text


def test_a_new_spec_is_advised_by_what_drafts_reached() -> None:
    """The first lens of docs/first_lens.md: two faces are near by their bound, and behind by their drafts."""
    code, output, errors = lensforge("new", *LIGHT)
    assert code == 0 and parse_spec(tomllib.loads(output), "lamp").lens.kind == "tir"
    reached = (
        "drafts like this reached an efficiency of 0.89 with a lens for total internal reflection (NMSE 0.04), 0.8"
    )
    assert reached in errors and "tir is used, the simplest with 0.97 of the most or more: double has 0.9" in errors


def undercut_deg(spec: Spec) -> float:
    """Least draft of a cavity: the shank of the ball, on the axis at the top of the hemisphere, touches its edge."""
    mouth_mm = spec.lens.faces["inner"].offset_mm
    assert mouth_mm is not None
    above_mm = mouth_mm + (0.0 if spec.base.kind == "none" else spec.base.height_mm)
    shank = math.asin(spec.manufacture.cutter_radius_mm / math.hypot(mouth_mm, above_mm))
    return -math.degrees(math.atan2(mouth_mm, above_mm) - shank)


@pytest.mark.parametrize(
    ("cutter", "limits", "manufacture"),
    [
        (
            (),
            {"concave_radius_mm": 0.5, "draft_deg": "as base and mouth leave"},
            {"cutter_radius_mm": 0.5, "process": "milled"},
        ),
        (
            ("--cutter", "0.7"),
            {"concave_radius_mm": 0.7, "draft_deg": "as base and mouth leave"},
            {"cutter_radius_mm": 0.7, "process": "milled"},
        ),
        (
            ("--cutter", "mould"),
            {"concave_radius_mm": 0.5, "draft_deg": 2.0},
            {"cutter_radius_mm": 0.5, "process": "moulded"},
        ),
        (
            ("--cutter", "mould", "--max-radius", "2", "--source", "disc:0.15"),
            {"concave_radius_mm": 0.4, "draft_deg": 2.0},
            {"cutter_radius_mm": 0.4, "process": "moulded"},
        ),
        (("--cutter", "none"), {"concave_radius_mm": None, "draft_deg": None}, {"process": "none"}),
    ],
)
def test_a_new_spec_has_the_limits_of_the_shop(
    cutter: tuple[str, ...], limits: dict[str, object], manufacture: dict[str, object]
) -> None:
    code, output, _ = lensforge("new", *LAMP, *cutter)
    spec = parse_spec(tomllib.loads(output), "lamp")
    assert code == 0
    for face in ("inner", "outer"):
        kept = dict(limits)
        if kept["draft_deg"] == "as base and mouth leave":
            kept["draft_deg"] = undercut_deg(spec) if face == "inner" else 0.0
        assert vars(spec.face_limits(face)) == pytest.approx(kept), "kept by the search"
        assert spec.lens.faces[face].concave_radius_mm is None, "told once"
    assert {name: getattr(spec.manufacture, name) for name in manufacture} == manufacture
    assert spec.tolerances.preset == ("moulded" if "mould" in cutter else "standard"), "those of what makes the lens"


@pytest.mark.parametrize(
    ("light", "kind"),
    [
        ("beam:12", "tir"), ("beam:60", "double"), ("disc:60@300", "tir"), ("disc:600@500", "double"),
        ("ring:60x40@300", "double"), ("cross:60x12@300", "double"), ("rectangle:30x20@300", "tir"),
        ("rectangle:90x30@300", "tir"), ("line:150x30@300", "double"),
    ],
)  # fmt: skip
def test_the_kind_of_lens_suits_the_light(light: str, kind: str) -> None:
    """Two faces come near where they need to turn little; a picture takes a lens of one way."""
    code, output, errors = lensforge("new", "--source", "square:0.5", "--target", light, "--max-radius", "12")
    spec = parse_spec(tomllib.loads(output), "lamp")
    assert code == 0 and spec.lens.kind == kind and f"; {kind} is used" in errors
    even = light.startswith("rectangle")
    assert spec.lens.levels == ("auto" if kind == "double" else (25, 81) if even else ())
    if light == "beam:12":
        bounds = [float(number) for number in re.findall(r"([0-9.]+) % with a ", errors)]
        assert bounds == [92.3, 88.4, 86.1], "total reflection, a reflector, two faces"


@pytest.mark.parametrize("kind", ["extruded", "extruded_tir"])
def test_a_linear_lens_lies_along_its_line(kind: str) -> None:
    """The line is 80 mm long along y, and so is the lens; any other lens has it along x, as it is written."""
    asked = ("new", "--force", "--source", "square:0.5", "--target", "line:80x12@60", "--max-radius", "30", "--lens")
    texts = [lensforge(*asked, name)[1] for name in (kind, "double")]
    along, across = (parse_spec(tomllib.loads(text), "lamp") for text in texts)
    assert (along.target.width_mm, along.target.height_mm, along.lens.length_mm) == (12.0, 80.0, 80.0)
    assert (across.target.width_mm, across.target.height_mm) == (80.0, 12.0)
    rectangle = lensforge(*(word.replace("line:", "rectangle:") for word in asked), kind)[1]
    assert parse_spec(tomllib.loads(rectangle), "lamp").target.width_mm == 80.0, "given by width and height"


@pytest.mark.parametrize(
    ("more", "process"),
    [
        (("--lens", "tir"), "moulded"),
        (("--lens", "tir", "--cutter", "0.5"), "milled"),
        (("--lens", "double"), "milled"),
        (("--lens", "reflector"), "turned"),
    ],
)
def test_a_lens_with_inner_edges_is_for_a_mould_unless_a_ball_is_given(more: tuple[str, ...], process: str) -> None:
    light = ("--source", "square:1", "--target", "rectangle:200x150@500", "--tilt", "30", "--max-radius", "14")
    code, text, errors = lensforge("new", *light, *more)
    assert code == 0, errors
    assert parse_spec(tomllib.loads(text), "lamp").manufacture.process == process
    assert ("no ball reaches the inner edges" in errors) == (process == "moulded")


@pytest.mark.parametrize(("radius_mm", "sizes_mm"), [(2.0, (4.8, 0.3)), (12.0, (28.8, 1.5))])
def test_a_new_moulded_lens_has_the_line_of_a_flange_that_fits_it(
    radius_mm: float, sizes_mm: tuple[float, float]
) -> None:
    """Without its # it is one that the lens has room for, of 2.4 radii across and 0.15 thick, 1.5 mm at most.

    A lens of two faces takes none, and has no line.
    """
    light = ("--source", f"square:{radius_mm / 10.0}", "--target", "beam:20", "--max-radius", str(radius_mm))
    _, text, _ = lensforge("new", *light, "--lens", "tir", "--cutter", "mould")
    spec = parse_spec(tomllib.loads(text.replace("# flange = {", "flange = {")), "lamp")
    assert parse_spec(tomllib.loads(text), "lamp").lens.rim_flange is None and spec.lens.rim_flange is not None
    assert "flange" in start_faces(spec)
    assert (spec.lens.rim_flange.diameter_mm, spec.lens.rim_flange.thickness_mm) == sizes_mm
    for others in (("--lens", "double", "--cutter", "mould"), ("--lens", "tir", "--cutter", "none")):
        assert "flange" not in lensforge("new", *light, *others)[1]


@pytest.mark.parametrize(
    ("light", "radius_mm", "flat_mm"),
    [
        ("rectangle:200x150@300", "12", 12.06),  # 0.95 of half an inch, beside the lens
        ("rectangle:200x150@300", "12.1", None),  # no room beside it
        ("rectangle:200x150@300", "30", None),  # a base of 54 mm, below the lens
        ("beam:60", "12", 12.06),
    ],
)
def test_the_base_of_two_freeform_faces_has_a_flat_where_it_has_room(
    light: str, radius_mm: str, flat_mm: float | None
) -> None:
    code, text, _ = lensforge(
        "new", "--source", "square:0.5", "--target", light, "--max-radius", radius_mm, "--lens", "double"
    )
    base = parse_spec(tomllib.loads(text), "lamp").base
    assert code == 0 and base.flat_mm == flat_mm
    assert base.diameter_mm == (54.0 if radius_mm == "30" else 25.4)


def test_a_new_moulded_lens_says_that_its_shrinkage_is_not_known() -> None:
    messages = [lensforge("new", *LAMP, "--cutter", cutter)[2] for cutter in ("mould", "1")]
    assert ["shrinkage is not given" in message for message in messages] == [True, False]


def test_a_lens_that_has_no_room_is_not_advised() -> None:
    code, output, errors = lensforge(
        "new", "--source", "square:12", "--target", "beam:6", "--max-radius", "14", "--force"
    )
    assert code == 0 and parse_spec(tomllib.loads(output), "lamp").lens.kind == "double"
    assert "total internal reflection" not in errors


@pytest.mark.parametrize("kind", LensShape.kinds)
def test_a_new_spec_of_every_kind_is_valid_and_names_examples(kind: str, tmp_path: Path) -> None:
    light = ("--source", "square:1.5", "--target", "beam:20", "--max-radius", "12", "--lens", kind)
    force = ("--force",) * kind.startswith("extruded")  # profiles make no round beam
    code, _, errors = lensforge("new", tmp_path / "new.toml", *light, "--cutter", "0.7", *force)
    spec = load_spec(tmp_path / "new.toml")
    assert (code, spec.lens.kind) == (0, kind)
    message = "lensforge: 1.5 mm square Lambertian source; target: gaussian beam 20° in the far field, to 26.7°\n"
    assert errors.endswith(message) and (errors == message) == (not force), "what was written"
    assert ("try a target that is longer along y" in errors) == bool(force)
    milled = kind in {"double", "extruded", "extruded_tir"}
    assert spec.manufacture.process == ("milled" if milled else "turned")
    shaped = [name for name in spec.lens.free if not spec.lens.role(name).follows]
    kept = {name: tuple(vars(spec.face_limits(name)).values()) for name in shaped}
    if kind == "extruded_tir":
        assert set(kept.values()) == {(0.7, None), (0.7, 0.0)}
    elif milled:  # what is drawn has no base below its outer face that a draft would be for
        assert kept == {
            "inner": (0.7, pytest.approx(undercut_deg(spec))),
            "outer": (0.7, 0.0 if kind == "double" else None),
        }
    else:
        assert set(kept.values()) == {(0.02, None)}, "of the nose"
    assert spec.base.kind == ("cylinder" if kind == "double" else "none"), "a wall over a base could not be moulded"
    text = (tmp_path / "new.toml").read_text(encoding="utf-8")
    (named,) = re.findall(r"# Nearest shipped examples: (.*)\.", text)
    assert all(load_spec(EXAMPLES / f"{name}.toml").lens.kind == kind for name in named.split(", "))
    assert text.count("cutter_radius_mm = 0.7") == milled, "what is turned needs no ball"
    usual = lensforge("new", *light, "--force")[1]
    drawn = kind.startswith("extruded")
    assert (parse_spec(tomllib.loads(usual), "usual").manufacture.process == "extruded") == drawn


def test_a_wall_beside_the_axis_is_a_receiver_in_its_place_and_takes_a_lens_that_is_not_of_revolution() -> None:
    """As the shipped wall washer has it; two faces are advised, and a reflector gets levels and is possible."""
    light = ("--source", "square:1", "--target", "rectangle:320x240@500", "--off-axis", "25", "--tilt", "30")
    code, output, errors = lensforge("new", *light, "--max-radius", "14")
    (plane,), spec = (parse_spec(tomllib.loads(output), "wall").receivers, parse_spec(tomllib.loads(output), "wall"))
    (shipped,) = load_spec(EXAMPLES / "wall_washer.toml").receivers
    assert code == 0 and "; double is used" in errors and spec.lens.kind == "double" and spec.target is None
    assert plane.centre_mm == pytest.approx(shipped.centre_mm) and plane.facing == pytest.approx(shipped.facing)
    assert (plane.width_mm, plane.targets[0].width_mm, plane.targets[0].height_mm) == (480.0, 320.0, 240.0)
    assert "wall_washer" in next(line for line in output.splitlines() if "Nearest shipped" in line)
    code, output, errors = lensforge("new", *light, "--max-radius", "14", "--lens", "reflector")
    assert code == 0 and parse_spec(tomllib.loads(output), "wall").lens.levels == (25, 81)
    message = "light to one side takes two faces, --lens double; a reflector has a larger error there"
    assert errors == f"lensforge: lens: {message}\n"
    _, _, errors = lensforge("new", *light, "--max-radius", "14", "--lens", "double")
    assert errors == "", "it is the one"
    code, _, errors = lensforge(
        "new", "--source", "square:1", "--target", "beam:20", "--tilt", "9", "--max-radius", "9"
    )
    assert code == 2 and "--off-axis, --tilt: go with a target on a plane, KIND:SIZE@DISTANCE, not 'beam'" in errors


def test_a_reflector_has_no_material() -> None:
    light = ("--source", "square:1.5", "--target", "beam:20", "--max-radius", "12", "--lens", "reflector")
    code, _, errors = lensforge("new", *light, "--material", "PC")
    assert code == 2 and "--material PC: no light enters a lens of kind 'reflector'; leave it out" in errors


def test_the_ratio_behind_the_choice_of_a_kind_is_said() -> None:
    """On each side of 0.97 of the largest bound: 60 × 40 cm at 1 m takes total reflection, 90 × 60 cm two faces.

    The LED is so small that no drafts are known.
    """
    ratios = {}
    for size in ("600x400", "900x600"):
        light = ("--source", "square:0.4", "--target", f"rectangle:{size}@1000", "--max-radius", "14")
        _, output, errors = lensforge("new", *light)
        assert errors.rstrip().endswith("; drafts like this are not known; --lens selects another")
        bounds = {kind: float(value) for value, kind in re.findall(r"([0-9.]+) % with a ([a-z-]+)", errors)}
        (ratio,) = re.findall(r"double has ([0-9.]+), tir has 1", errors)
        assert float(ratio) == pytest.approx(bounds["double-freeform"] / bounds["lens"], abs=1e-3)
        ratios[parse_spec(tomllib.loads(output), "lamp").lens.kind] = float(ratio)
    assert ratios["tir"] < 0.97 <= ratios["double"]
    _, _, errors = lensforge("new", *light[:2], "--target", "cross:200x60@150", *light[4:])
    assert "double is used, the only kind that suits this light; --lens" in errors


@pytest.mark.parametrize(
    ("light", "kind", "nearest"),
    [
        ("rectangle:600x400@2000", "double", "rectangle"),
        ("rectangle:1000x700@400", "double", "fixed_step_face"),
        ("cross:200x60@150", "double", "plus"),
        ("beam:60x25", "double", "elliptical_beam"),
        ("beam:20", "tir", "flashlight"),
    ],
)
def test_the_nearest_example_is_named_first(light: str, kind: str, nearest: str) -> None:
    """The same light, with nothing besides, of the nearest size: not the first by the alphabet, a backlight."""
    _, text, _ = lensforge("new", "--source", "square:1", "--target", light, "--max-radius", "14", "--lens", kind)
    (named,) = re.findall(r"# Nearest shipped examples: (.*)\.", text)
    assert named.split(", ")[0] == nearest


@pytest.mark.parametrize(("kind", "place"), [("double", "from the origin"), ("tir", "axis"), ("reflector", "axis")])
def test_the_largest_radius_is_said_as_this_kind_of_lens_has_it(kind: str, place: str) -> None:
    _, text, _ = lensforge("new", "--source", "square:1", "--target", "beam:20", "--max-radius", "14", "--lens", kind)
    (row,) = (line for line in text.splitlines() if line.startswith("max_radius_mm"))
    assert place in row and ("height" in row) == (kind == "double") and "total" not in row
    (levels,) = re.findall("(?m)^levels = .*", text) or [""]
    assert ('"auto"' in levels) == ("refined" in levels) == (kind == "double")


@pytest.mark.parametrize(("radius_mm", "base"), [(24, (25.4, 2.0)), (24.1, (43.38, 3.0125)), (30, (54.0, 3.75))])
def test_the_base_of_a_large_lens_is_wider_than_it(radius_mm: float, base: tuple[float, float]) -> None:
    """1.8 radii wide and an eighth of one high beyond 24 mm, up to where the usual one holds the cavity."""
    light = ("--source", "square:1", "--target", "rectangle:600x400@1000", "--lens", "double", "--cutter", "none")
    _, text, _ = lensforge("new", *light, "--max-radius", radius_mm)
    made = parse_spec(tomllib.loads(text), "lamp").base
    assert (made.diameter_mm, made.height_mm) == pytest.approx(base)


def test_the_size_of_a_new_spec_can_be_changed_by_hand() -> None:
    _, output, _ = lensforge("new", *LAMP)
    smaller = parse_spec(tomllib.loads(output.replace("max_radius_mm = 14.0", "max_radius_mm = 8.0")), "lamp")
    assert smaller.lens.start_mm == {"inner": 3.44, "outer": 7.84}, "the hemispheres follow"


_ROOM = [("13", "1", 2.0), ("14", "1", 2.5), ("14", "mould", 2.0)]


@pytest.mark.parametrize(("radius", "cutter", "height_mm"), _ROOM)
def test_the_base_has_room_for_a_step_as_deep_as_the_ball_and_a_wall(
    radius: str, cutter: str, height_mm: float
) -> None:
    """The wall is 0.27 times the root of the radius; with 0.02 to spare 13 mm need 1.994 mm, 14 mm 2.03: half a mm."""
    code, output, _ = lensforge("new", *LAMP[:4], "--max-radius", radius, *LAMP[6:], "--cutter", cutter)
    assert code == 0 and parse_spec(tomllib.loads(output), "lamp").base.height_mm == height_mm


def test_a_file_that_is_there_stays(tmp_path: Path) -> None:
    (tmp_path / "lamp.toml").write_text("mine", encoding="utf-8")
    code, _, errors = lensforge("new", tmp_path / "lamp.toml", *LAMP)
    assert code == 2 and "exists and is not overwritten" in errors
    assert [path.name for path in tmp_path.iterdir()] == ["lamp.toml"]
    assert (tmp_path / "lamp.toml").read_text(encoding="utf-8") == "mine"


def test_where_nothing_can_be_written_one_line_says_so(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    code, output, errors = lensforge("new", tmp_path / "file" / "lamp.toml", *LAMP)
    assert (code, output, len(errors.splitlines())) == (2, "", 1) and "cannot be written" in errors


def test_what_is_impossible_is_said_at_once_and_not_written(tmp_path: Path) -> None:
    cob = ("--source", "disc:3", "--target", "rectangle:60x40@500", "--max-radius", "14", "--lens", "double")
    code, output, errors = lensforge("new", tmp_path / "cob.toml", *cob)
    assert (code, output) == (2, "") and not list(tmp_path.iterdir())
    assert "upper bound 25.2 % of the light (étendue)" in errors and "a larger lens (>= 26.81 mm)" in errors
    assert len(errors.splitlines()) == 1
    code, output, errors = lensforge("new", *cob, "--force")
    assert code == 0 and parse_spec(tomllib.loads(output), "cob").constraints.max_radius_mm == 14.0
    assert "25.2 %" in errors
    code, _, refusal = lensforge("new", *cob, "--anyway")
    assert code == 2 and "No such option: --anyway; it is --force now" in refusal


def test_a_ray_file_and_a_photometric_file_are_named_from_the_folder_of_the_spec(tmp_path: Path) -> None:
    led, light = tmp_path / "led.tm25ray", EXAMPLES / "street_light.ies"
    led.write_bytes((EXAMPLES / "led.tm25ray").read_bytes())
    code, _, errors = lensforge("new", tmp_path / "a.toml", "--source", led, "--target", light, "--max-radius", 14)
    assert code == 0, errors
    text = (tmp_path / "a.toml").read_text(encoding="utf-8")
    assert 'file = "led.tm25ray"' in text and "measured: 99 %" in text
    limits = load_spec(tmp_path / "a.toml").constraints
    shipped = load_spec(EXAMPLES / "led_rayfile.toml").constraints
    assert limits.cavity_radius_mm == pytest.approx(shipped.cavity_radius_mm, rel=0.25)


ARROW = str(EXAMPLES / "arrow.png")


def test_a_new_spec_of_a_picture_names_its_file_from_its_own_folder(tmp_path: Path) -> None:
    """On a plane across the axis and beside it; size and place are said, and from where it is read."""
    light = ("--source", "square:1", "--target", f"image:{ARROW}:200@500", "--max-radius", "12", "--lens", "double")
    for name, beside in (("a", ()), ("b", ("--off-axis", "20"))):
        code, _, errors = lensforge("new", tmp_path / "x" / f"{name}.toml", *light, *beside)
        spec = load_spec(tmp_path / "x" / f"{name}.toml")
        (target,) = spec.all_receivers[0].targets
        assert (code, target.file.resolve(), target.width_mm) == (0, Path(ARROW).resolve(), 200.0)
        assert "target: arrow.png, 200 mm wide, as seen from behind" in errors
        assert "mirrored = true" in (tmp_path / "x" / f"{name}.toml").read_text(encoding="utf-8")


def answered(answers: str, *arguments: str) -> Result:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("lensforge.cli.specs._at_terminal", lambda: True)
        return CliRunner().invoke(cli, ["new", *arguments], input=answers)


def test_a_terminal_is_asked_again_until_the_answer_is_one() -> None:
    result = answered("rectangle:200x150@300\ndisk:1\ndisc:1\n-3\n14\ncube\ndouble\n\n2.5\n")
    assert result.exit_code == 0, result.output
    spec = parse_spec(tomllib.loads(result.stdout), "asked")
    assert spec.source.diameter_mm == 1.0 and spec.manufacture.cutter_radius_mm == 2.5
    assert all(f"{kind}:" in result.stderr for kind in ("ellipse", "cross", "ring", "text", "beam"))
    assert spec.lens.kind == "double" and "--lens cube: must be one of double, tir, reflector" in result.stderr
    assert "disk:1: no kind with its size" in result.stderr and "--max-radius -3: must be" in result.stderr


def test_the_usual_answer_is_what_such_a_lens_is_made_by() -> None:
    """A TIR lens with levels by a mould, whose inner edges no ball reaches; two faces by the ball of their size."""
    light = ("--source", "square:1", "--target", "rectangle:200x150@500", "--tilt", "30", "--max-radius", "14")
    moulded = parse_spec(tomllib.loads(answered("\n\n", *light, "--lens", "tir").stdout), "asked")
    small = ("--source", "disc:0.15", "--target", "rectangle:200x150@300", "--max-radius", "2", "--lens", "double")
    milled = parse_spec(tomllib.loads(answered("\n\n", *small).stdout), "asked")
    assert (moulded.manufacture.process, milled.manufacture.process) == ("moulded", "milled")
    assert milled.manufacture.cutter_radius_mm == 0.4
    assert lensforge("new", *LAMP, "--cutter", "usual")[1] == lensforge("new", *LAMP)[1]


def test_nothing_is_asked_without_a_terminal() -> None:
    code, output, errors = lensforge("new", *LAMP[2:])
    assert (code, output) == (2, "")
    assert errors.startswith("lensforge: --source: is missing; give ") and "square:S" in errors


@pytest.mark.parametrize(
    ("word", "fields"),
    [
        ("disc:50@200", {"kind": "disc", "diameter_mm": 50.0, "distance_mm": 200.0}),
        ("rectangle:9@20", {"kind": "rectangle", "width_mm": 9.0, "height_mm": 9.0, "distance_mm": 20.0}),
        ("text:a:b@c:90@150", {"kind": "text", "text": "a:b@c", "width_mm": 90.0, "distance_mm": 150.0}),
        (f"image:{ARROW}:90@150", {"kind": "image", "file": ARROW, "width_mm": 90.0, "distance_mm": 150.0}),
        ("beam:10", {"kind": "beam", "fwhm_deg": [10.0, 10.0]}),
        ("beam:60x25", {"kind": "beam", "fwhm_deg": [60.0, 25.0]}),
        ("line:300x20@200", {"kind": "rectangle", "width_mm": 300.0, "height_mm": 20.0, "distance_mm": 200.0}),
        ("cross:200x60@150", {"kind": "cross", "length_mm": 200.0, "stroke_mm": 60.0, "distance_mm": 150.0}),
    ],
)
def test_targets_in_a_word(word: str, fields: dict[str, object]) -> None:
    assert target_in(word) == fields


NO_TARGETS = ["disc:50", "disc:a@3", "star:3@4", "text:5@3", "beam:60x25x3", "no.ies", "disc:0@1", "image:a.png@2"]


@pytest.mark.parametrize("word", [*NO_TARGETS, "beam:9deg", "image:no.png:2@3"])
def test_targets_that_are_none_are_refused_with_what_is_allowed(word: str) -> None:
    with pytest.raises(InputError, match=rf"^--target {word}: ") as refusal:
        target_in(word)
    assert "give" in str(refusal.value) or "such as" in str(refusal.value)
    assert "in degrees" in str(refusal.value) or not word.startswith("beam")


def test_sources_in_a_word() -> None:
    assert source_in("rectangle:3x1") == {"kind": "rectangle", "width_mm": 3.0, "height_mm": 1.0}
    assert source_in("square:2") == {"kind": "square", "side_mm": 2.0}
    with pytest.raises(InputError, match="no package and no file that is there"):
        source_in("led.ray")


def test_the_command_that_is_printed_can_be_pasted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    given = [
        "--source",
        "square:1.5",
        "--target",
        "disc:80@150",
        "--max-radius",
        "9",
        "--material",
        "PC",
        "--cutter",
        "1",
    ]
    ran = CliRunner().invoke(cli, ["new", "own lens; v2.toml", *given])
    assert ran.exit_code == 0, ran.output
    command = ran.stdout.rstrip("\n").split("\t")[1]
    assert shlex.split(command) == ["lensforge", "design", "own lens; v2.toml"]


@pytest.mark.parametrize("lens", ["tir", "double"])
def test_a_zoom_has_two_states_and_the_travel_and_the_room_that_it_needs(lens: str) -> None:
    options = ("--source", "square:1", "--target", "zoom:15-45", "--max-radius", "7.5", "--lens", lens)
    code, output, _ = lensforge("new", *options, "--material", "PMMA")
    assert code == 0 and re.search(r"# Spot: upper bound \d.* %.*; flood: upper bound \d", output)
    spec = parse_spec(tomllib.loads(output), "zoom")
    spot, flood = spec.by_state.values()
    assert spec.lens.kind == lens and list(spec.by_state) == ["spot", "flood"]
    assert (spot.target.fwhm_deg, flood.target.fwhm_deg) == (15.0, 45.0)
    wanted_mm = 0.75 * 7.5 * math.radians(0.5 * (45.0 - 15.0))
    assert spot.source.position_mm == (0.0, 0.0, 0.0) and flood.source.position_mm[2] == pytest.approx(
        wanted_mm, abs=0.05
    )
    assert require_clear_travel(spec) == () and not source_clearance_warnings(flood, source_of(flood))
    assert output.count("room for the LED at both stops") == 2 and "measured" not in output


def test_a_zoom_for_a_ray_file_has_room_above_that_of_its_rays() -> None:
    options = ("--source", EXAMPLES / "led.tm25ray", "--target", "zoom:20-50", "--max-radius", "15", "--lens", "double")
    code, output, _ = lensforge("new", *options, "--material", "PMMA")
    spec = parse_spec(tomllib.loads(output), "zoom")
    travel_mm = spec.by_state["flood"].source.position_mm[2]
    assert code == 0 and travel_mm == pytest.approx(0.75 * 15.0 * math.radians(15.0), abs=0.05)
    assert spec.constraints.cavity_height_mm == pytest.approx(1.8 * travel_mm, rel=1e-2)
    assert spec.constraints.cavity_radius_mm > 1.5, "the emitter is 2 mm wide, off the axis"


@pytest.mark.parametrize(
    ("word", "line"),
    [
        ("zoom:45-15", "--target zoom:45-15: the spot is narrower than the flood, which is 130 degrees wide at most"),
        ("zoom:15-150", "--target zoom:15-150: the spot is narrower than the flood, which is 130"),
        ("zoom:15", "--target zoom:15: '15' must be A-B, the full widths of spot and flood in degrees"),
        ("zoom:a-b", "--target zoom:a-b: 'a-b' must be A-B"),
    ],
)
def test_what_makes_no_zoom_is_refused_in_a_line(word: str, line: str) -> None:
    code, _, errors = lensforge("new", "--source", "square:1", "--target", word, "--max-radius", "7.5")
    assert code == 2 and line in errors and len(errors.strip().splitlines()) == 1
    with pytest.raises(InputError, match="go with a target on a plane"):
        receiver_beside(target_in("zoom:15-45"), off_axis_deg=10.0)


def test_a_thin_lens_is_as_low_as_its_light_allows_and_begins_with_a_groove() -> None:
    """Of its radius: half as high as wide, and one fifth lower without room for as much light."""
    spot = ("--source", "square:1", "--target", "beam:12", "--max-radius", "7", "--material", "PMMA")
    code, output, _ = lensforge("new", *spot, "--thin")
    spec = parse_spec(tomllib.loads(output), "thin")
    assert code == 0 and spec.lens.kind == "tir"
    height_mm = spec.constraints.max_height_mm
    assert height_mm is not None and 3.0 < height_mm < 7.0
    assert spec.lens.faces["exit"].groove_radius_mm == pytest.approx(height_mm / 18.0, rel=0.01)
    assert "# so high the lens is: the least with 0.98 of the light of any height" in output
    faces = start_faces(spec)
    assert isinstance(faces["exit"], GroovedFace)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            ("--target", "beam:12", "--lens", "double"),
            "--thin: goes with --lens tir, not 'double'; leave",
        ),
        (
            ("--target", "beam:20x8"),
            "--thin: the groove of a thin lens is round, and this light is not; leave --thin out",
        ),
        (("--target", "beam:12", "--source", "square:5"), "--thin: grooved collimator: height = "),
    ],
)
def test_a_thin_lens_that_cannot_be_is_refused_in_one_line(options: tuple[str, ...], message: str) -> None:
    scene = ("--source", "square:1", "--max-radius", "7", "--material", "PMMA", "--thin", "--force")
    code, _, errors = lensforge("new", *scene, *options)
    assert code == 2 and message in errors
