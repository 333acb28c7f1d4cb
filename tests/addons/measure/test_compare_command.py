"""``lensforge compare`` as a user meets it."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from in_this_process import lensforge
from made_once import copied
from measured_lenses import lens, probed
from PIL import Image

import lensforge as lf
from lensforge.addons.measure.measured_facts import photo_facts
from lensforge.cli.cli import cli
from lensforge.errors import InputError
from lensforge.light.evaluation_result import Light
from lensforge.verbs import EVALUATE

LENS = lens()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("measured")
    LENS.save(directory / "lens.json")
    EVALUATE.run(directory)
    return directory


def run(*arguments: object):
    return CliRunner().invoke(cli, ["compare", *map(str, arguments)])


def seen_straight_on(light: np.ndarray, path: Path) -> list[tuple[float, float]]:
    """Save a photograph with 8 pixels for each of the simulation, row 0 on top; the corners of the light in it."""
    seen = np.kron(light[::-1] / light.max(), np.ones((8, 8)))
    Image.fromarray(np.round(60000 * np.pad(seen, 10)).astype(np.uint16)).save(path)
    right, low = (9.5 + 8 * count for count in (light.shape[1], light.shape[0]))
    return [(9.5, 9.5), (right, 9.5), (right, low), (9.5, low)]


def test_a_photograph_of_the_simulated_light_is_found_alike(folder: Path) -> None:
    corners = seen_straight_on(Light.read(folder).map, folder / "on.png")
    done = run(
        folder, "--on", folder / "on.png", "--corners", *(f"{column},{row}" for column, row in corners), "--json"
    )
    assert done.exit_code == 0, done.output
    content = json.loads((folder / "compare.json").read_text(encoding="utf-8"))
    assert json.loads(done.stdout)["compare"]["ssim"] == content["ssim"]
    assert content["ssim"] > 0.995
    assert abs(content["alignment"]["displacement_x_mm"]["value"]) < 1.0
    assert content["alignment"]["scale"]["value"] == pytest.approx(1.0, abs=0.01)
    assert content["alignment"]["scale"]["standard_error"] > 0.0


def test_a_photograph_with_the_second_led_is_compared_with_its_light(tmp_path: Path) -> None:
    leds = {"one": {"kind": "disc", "diameter_mm": 3.0}, "two": {"kind": "square", "side_mm": 0.5}}
    sources = [{"name": name, "source": {**led, "position_mm": [1.5, 0.0, 0.0]}} for name, led in leds.items()]
    both = lf.Lens.double(LENS.inner, LENS.outer, LENS.spec.replace(source=None, sources=sources), 0, "draft")
    light = lf.evaluate(both)
    corners = seen_straight_on(light.by_led["two"].map, tmp_path / "on.png")
    first, second = (lf.compare(light, on=tmp_path / "on.png", corners=corners, led=led) for led in (None, "two"))
    assert (first.led, second.led, second.inputs["evaluate"]) == ("one", "two", light.sha256)
    (shown,) = photo_facts(second)
    assert second.nmse < 0.01 * first.nmse and shown.facts[0].note == "with the LED two"
    with pytest.raises(InputError, match=r"^led = 'three': must be one of one, two"):
        lf.compare(light, on=tmp_path / "on.png", led="three")


def on_receiver(**receiver: object) -> lf.Lens:
    """The lens before one receiver."""
    spec = LENS.spec.replace({"target": None, "receivers": [receiver]})
    return lf.Lens.double(LENS.inner, LENS.outer, spec, LENS.seed, LENS.accuracy)


def test_light_on_a_rectangle_is_compared_where_its_lens_says(tmp_path: Path) -> None:
    target = {"kind": "rectangle", "width_mm": 120.0, "height_mm": 60.0, "uniform_mm": (100.0, 40.0)}
    made = on_receiver(kind="plane", centre_mm=(0.0, 0.0, 100.0), width_mm=160.0, height_mm=80.0, targets=[target])
    light = lf.evaluate(made, rays=2**12)
    corners = seen_straight_on(light.map, tmp_path / "on.png")
    comparison = lf.compare(light, on=tmp_path / "on.png", corners=corners, lens=made)
    assert comparison.ssim > 0.99 and comparison.measured.shape == light.map.shape
    assert comparison.simulated_evenness.uniformity == pytest.approx(light.raw.uniformity)
    assert lf.compare(light, on=tmp_path / "on.png", corners=corners).simulated_evenness.uniformity is None
    with pytest.raises(InputError, match="lens: the light was evaluated with another lens"):
        lf.compare(light, on=tmp_path / "on.png", corners=corners, lens=LENS)


def test_a_photograph_needs_a_plane(tmp_path: Path) -> None:
    made = on_receiver(kind="far_field", half_angle_deg=60.0, targets=[{"kind": "disc", "diameter_deg": 40.0}])
    with pytest.raises(InputError, match=r"^receivers: the first, 'far_field', is a far_field, must be a plane"):
        lf.compare(lf.evaluate(made, rays=64), on=tmp_path / "on.png")


def test_measured_points_are_compared(folder: Path) -> None:
    np.savetxt(folder / "cloud.csv", probed(LENS.inner, 4000, noise_mm=0.0005), delimiter=",", header="x,y,z")
    done = run(folder, "--points", folder / "cloud.csv", "--surface", "inner", "--rays", 8192)
    assert done.exit_code == 0, done.output
    content = json.loads((folder / "compare_inner_8192rays.json").read_text(encoding="utf-8"))
    assert content["rays"] == 8192
    assert content["residual_rms_um"] == pytest.approx(0.5, rel=0.1)
    assert content["form_deviation_um"]["pv"] < 1.5


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "--on PHOTO"),
        (["--on", "a.png", "--points", "b.csv"], "--on PHOTO"),
        (["--on", "a.png"], "a.png: no such file"),
        (["--points", "b.csv"], "surface = None: must be one of inner, outer"),
        (["--points", "b.csv", "--surface", "side"], "surface = 'side': must be one of inner, outer"),
        (["--points", "b.csv", "--surface", "outer"], "no such file"),
        (
            ["--points", "b.csv", "--surface", "outer", "--off", "a.png", "--gamma", "2.2", "--corners", *["1,2"] * 4],
            "compare: off, corners, gamma: of no use in a comparison with points; leave it out",
        ),
        (
            ["--on", "a.png", "--rays", "64", "--surface", "outer", "--registration", "none"],
            "compare: surface, registration, rays: of no use in a comparison with a photograph",
        ),
    ],
)
def test_what_is_missing_is_said_in_a_line(folder: Path, options: list[str], message: str) -> None:
    done = run(folder, *options)
    assert isinstance(done.exception, InputError)
    assert message in str(done.exception)


def test_a_corner_is_two_numbers(folder: Path) -> None:
    done = run(folder, "--on", "a.png", "--corners", "1,2", "3", "5,6", "7,8")
    assert done.exit_code == 2
    assert "column,row" in done.output


def test_a_comparison_with_nothing_is_refused_in_the_words_of_the_command(small_run: lf.Run, tmp_path: Path) -> None:
    result = lensforge("compare", copied(small_run.folder, tmp_path / "copy"))
    assert result.code == 2 and "--on PHOTO" in result.stderr and "--points FILE --surface FACE" in result.stderr
