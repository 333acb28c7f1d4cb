"""Errors of a made lens from pictures of its light: hidden ones are found again, and wrong pictures are refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hidden_errors import light_of, made_lens
from photo_scenes import homography
from PIL import Image
from presets import FEW
from scenes import small_spec
from scipy.ndimage import map_coordinates

import lensforge as lf
from lensforge.addons.measure.form_unknowns import FormUnknowns
from lensforge.addons.measure.picture_model import PictureModel
from lensforge.light.lens_light import source_of
from lensforge.light.simulation import TracedLens
from lensforge.scene.receiver_shapes import receivers_of
from lensforge.surfaces.srbf import SrbfSurface

SPEC = small_spec(
    source__side_mm=0.5,
    optimise__steps_per_level=[40, 40],
    optimise__pixels=32,
    target__width_mm=120.0,
    target__uniform_mm=80.0,
)
LED_MM = np.array([[0.0, 0.0, 0.0], [0.2, 0.03, 0.0], [-0.05, -0.2, 0.1]])
CORNERS = np.array([[31.2, 22.7], [281.4, 30.1], [272.9, 268.8], [24.5, 259.3]])
SIZE = (310, 300)
CORNER_PX = 0.2
LED_OFF_MM = np.array([0.015, -0.012, 0.0])  # where the LED stands by mistake
# Coefficients (µm) by the names of the record.
HIDDEN = {"inner coma x": 2.0, "inner astigmatism 45°": -1.5, "outer trefoil 0°": 2.5, "outer spherical": -1.8}
DECENTRE_UM = {"decentre x": 9.0, "decentre y": -6.0}


def pictures_of(lens, folder: Path):
    """Photographs of the made lens with the LED at each place, and the table of the places."""
    made = made_lens(lens, HIDDEN | DECENTRE_UM, FEW)
    noise = np.random.default_rng(8)
    columns, rows = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    seen = np.stack([columns.ravel(), rows.ravel(), np.ones(columns.size)])
    x, y, w = np.linalg.inv(homography(CORNERS, (200.0, 200.0))) @ seen
    paths = []
    for number, place in enumerate(LED_MM):
        light = light_of(made, place + LED_OFF_MM, 40 + number)
        at = [(y / w + 100.0) / 1.5625 - 0.5, (x / w + 100.0) / 1.5625 - 0.5]
        image = map_coordinates(light / light.max(), at, order=1, mode="nearest").reshape(SIZE[::-1])
        image = 0.7 * (1.0 + 0.03 * number) * image + 0.007 * noise.normal(size=image.shape)
        paths.append(folder / f"{number}.png")
        Image.fromarray(np.round(65535 * np.clip(image + 0.05, 0.0, 1.0)).astype(np.uint16)).save(paths[-1])
    Image.fromarray(np.full(SIZE[::-1], round(0.05 * 65535), dtype=np.uint16)).save(folder / "off.png")
    np.savetxt(folder / "poses.csv", LED_MM, delimiter=",", header="x_mm,y_mm,z_mm", comments="")
    return paths


@pytest.fixture(scope="module")
def lens() -> lf.Lens:
    return lf.design(SPEC, accuracy=FEW).lens


@pytest.fixture(scope="module")
def shots(lens: lf.Lens, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("shots")
    pictures_of(lens, folder)
    return folder


def options(folder: Path, **changes):
    corners = CORNERS + CORNER_PX * np.random.default_rng(2).normal(size=CORNERS.shape)
    given = {
        "pictures": [folder / f"{number}.png" for number in range(len(LED_MM))],
        "poses": folder / "poses.csv",
        "off": folder / "off.png",
        "corners": [tuple(corner) for corner in corners],
        "rays": 2**18,
        "pixels": 64,
    }
    return given | changes


def test_hidden_errors_are_found_within_their_standard_errors(lens: lf.Lens, shots: Path) -> None:
    made = lf.infer(lens, **options(shots))
    true = HIDDEN | DECENTRE_UM | {"LED x": 15.0, "LED y": -12.0}
    pulls = {
        error.name: (error.value.value - true.get(error.name, 0.0)) / error.value.standard_error
        for error in made.errors
    }
    assert 0.5 < np.sqrt(np.mean(np.square(list(pulls.values())))) < 1.5, pulls
    assert max(map(abs, pulls.values())) < 3.5, pulls
    by_name = {error.name: error for error in made.errors}
    assert by_name["inner coma x"].value.value == pytest.approx(2.0, abs=1.5) and by_name["inner coma x"].is_seen
    assert by_name["LED x"].value.standard_error < 5.0 < by_name["LED x"].value.value
    assert "index" in made.not_seen and "LED x" not in made.not_seen
    assert made.chi_square == pytest.approx(1.0, abs=0.5)
    assert made.further.remaining < made.further.remaining_before
    largest = max(made.errors, key=lambda error: abs(error.value.value) / error.expected)
    assert made.over_expected == abs(largest.value.value) / largest.expected < 4.0
    assert all(criterion.holds for criterion in made.criteria)


def other(lens: lf.Lens, amount_mm: float) -> lf.Lens:
    """A lens whose outer face is another by noise in its weights."""
    basis = lens.outer.basis
    weights = lens.outer.weights_mm + amount_mm * np.random.default_rng(4).normal(size=basis.size)
    return lf.Lens.double(lens.inner, SrbfSurface(basis, weights, lens.outer.offset_mm), lens.spec, 0, FEW)


def test_errors_beyond_what_is_expected_are_told(lens: lf.Lens, shots: Path) -> None:
    made = lf.infer(other(lens, 0.01), **options(shots, rays=2**17))
    missed = {criterion.key: criterion for criterion in made.criteria if not criterion.holds}
    assert made.over_expected > 4.0 and "give --expected" in missed["inferred_errors"].remedy


def test_a_saturated_picture_is_told(lens: lf.Lens, shots: Path) -> None:
    levels = np.asarray(Image.open(shots / "2.png"), dtype=np.float64)
    bright = levels * 65535.0 / np.quantile(levels, 0.97)
    Image.fromarray(np.clip(bright, 0.0, 65535.0).astype(np.uint16)).save(shots / "bright.png")
    pictures = [shots / name for name in ("0.png", "1.png", "bright.png")]
    made = lf.infer(lens, **options(shots, pictures=pictures, rays=2**15))
    assert 0.03 < made.clipped < 0.2
    assert [criterion.key for criterion in made.criteria if not criterion.holds] == ["photo_clipped"]


REFUSED = {
    "a pose is missing": ({"poses": "two.csv"}, "2 rows, there are 3 pictures"),
    "pictures are mirrored": ({"corners": CORNERS[[1, 0, 3, 2]].tolist()}, "mirrored, left for right"),
    "the poses are in another order": ({"poses": "other.csv"}, "no low-order errors of this lens explain them"),
    "one picture": ({"pictures": ["0.png"]}, "must be 2 to 64"),
    "pixels that no memory holds": ({"pictures": ["0.png"] * 9, "pixels": 512}, "at most 482 with 9 pictures"),
}


@pytest.mark.parametrize("wrong", REFUSED)
def test_wrong_pictures_are_refused_in_one_line(lens: lf.Lens, shots: Path, wrong: str) -> None:
    np.savetxt(shots / "two.csv", LED_MM[:2], delimiter=",")
    np.savetxt(shots / "other.csv", LED_MM[[0, 2, 1]], delimiter=",")
    changes, message = REFUSED[wrong]
    given = {key: shots / value if key == "poses" else value for key, value in changes.items()}
    with pytest.raises(lf.InputError, match=message) as refused:
        lf.infer(lens, **options(shots, rays=2**15, **given))
    assert "\n" not in str(refused.value)


def test_pictures_of_another_lens_are_refused(lens: lf.Lens, shots: Path) -> None:
    """Another by a tenth of a millimetre of form, twenty times what is expected."""
    with pytest.raises(lf.InputError, match=r"no low-order errors of this lens explain them|the light is more like"):
        lf.infer(other(lens, 0.1), **options(shots, rays=2**15))


def test_slopes_are_those_of_pictures_by_many_rays(lens: lf.Lens) -> None:
    """Projected on the slopes by other rays, so that the noise of neither counts."""
    traced = TracedLens.of(lens, 4.0)
    unknowns = FormUnknowns.of(lens, traced, 5.0)
    receiver = receivers_of(lens.spec, 48)[0]
    model = PictureModel(traced, receiver, source_of(lens.spec), unknowns, [(0.2, -0.1, 0.05)], range(2), 2**16, 7)
    numbers = 0.3 * np.random.default_rng(1).normal(size=len(unknowns))
    first, second = model.slopes(numbers)
    many = replace(model, samples=range(2, 3), rays=2**18)
    for number in (0, 3, 13, 17, 19, 22, 24):
        step = np.eye(len(unknowns))[number]
        change = 0.5 * (many.pictures(numbers + step)[0] - many.pictures(numbers - step)[0])
        inside = np.s_[:, 6:-6, 6:-6]
        along = first[number][inside].ravel()
        assert along @ change[inside].ravel() == pytest.approx(along @ second[number][inside].ravel(), rel=0.1), number


def test_a_step_to_faces_that_are_none_is_told_as_pictures_of_something_else(
    lens: lf.Lens, shots: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    traced = PictureModel.pictures

    def pictures(model, numbers):
        if numbers.any():
            raise lf.InputError("inner surface: its radius falls to -5 mm")
        return traced(model, numbers)

    monkeypatch.setattr(PictureModel, "pictures", pictures)
    message = (
        r"no low-order errors of this lens explain them \(inner surface: its radius falls.*is the dark picture given"
    )
    with pytest.raises(lf.InputError, match=message):
        lf.infer(lens, **options(shots, rays=2**12))
