"""A face corrected by errors that pictures of its light tell, against the hidden ones; what they do not is left."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hidden_errors import FORMS, polynomials
from measured_lenses import lens
from measured_records import make_inference
from second_cuts import CutAgain, cosine

import lensforge as lf
from lensforge.addons.measure.first_cut import Request
from lensforge.addons.measure.inference_result import InferredError
from lensforge.addons.measure.inferred_form import inferred_cut
from lensforge.addons.measure.nominal_face import NominalFace
from lensforge.cli.cli import cli
from lensforge.errors import InputError
from lensforge.results import Metric
from lensforge.surfaces.srbf import fibonacci_hemisphere

LENS = lens()
PLACES = {
    "decentre x": 10.0,
    "decentre y": 10.0,
    "gap": 10.0,
    "tilt about x": 0.35,
    "tilt about y": 0.35,
    "LED x": 20.0,
}
EXPECTED = {**{f"{face} {form}": 2.0 for face in ("inner", "outer") for form in FORMS}, **PLACES}
SIZES = np.array([*EXPECTED.values()])
UNSEEN = "outer coma y"
U = fibonacci_hemisphere(3000)


def errors_along_normal(face: str, u: np.ndarray) -> dict[str, np.ndarray]:
    """Forms and motions of a face along its normal (um), by a unit of each error."""
    of = LENS.surfaces[face]
    points = of.radius(u)[:, None] * u
    normals = of.normal(u)
    about_x = points[:, 1] * normals[:, 2] - points[:, 2] * normals[:, 1]
    about_y = points[:, 2] * normals[:, 0] - points[:, 0] * normals[:, 2]
    moved = dict(zip(PLACES, (*normals.T, about_x, about_y), strict=False)) if face == "outer" else {}
    return {**{f"{face} {form}": shape for form, shape in polynomials(u).items()}, **moved}


def deviation_um(face: str, amounts: dict[str, float], u: np.ndarray) -> np.ndarray:
    """Deviation along the normal by errors of these amounts, each in its unit."""
    return sum(amounts[name] * field for name, field in errors_along_normal(face, u).items() if name in amounts)


def drawn(seed: int, spread: np.ndarray) -> dict[str, float]:
    """Errors of covariance ``spread`` spread^T in units of what is expected of them."""
    numbers = spread @ np.random.default_rng(seed).normal(size=len(SIZES))
    return dict(zip(EXPECTED, numbers * SIZES, strict=True))


def spread_of(unseen: float = 0.97) -> np.ndarray:
    """Root of a covariance: errors hang together, and one is hardly seen."""
    root = 0.06 * np.random.default_rng(3).normal(size=(len(SIZES),) * 2) / len(SIZES) ** 0.5 + 0.12 * np.eye(
        len(SIZES)
    )
    root[[*EXPECTED].index(UNSEEN)] *= unseen / np.linalg.norm(root[[*EXPECTED].index(UNSEEN)])
    return root


SPREAD = spread_of()
FOUND = {**drawn(5, np.eye(len(SIZES))), UNSEEN: 0.4}


def inference(of: lf.Lens = LENS, told: dict[str, float] = FOUND, spread: np.ndarray = SPREAD) -> lf.Inference:
    """What pictures tell: the errors ``told``, which are wrong by the covariance of ``spread``."""
    covariance = spread @ spread.T
    wrong = np.sqrt(np.diag(covariance))
    errors = (
        InferredError(
            name=name,
            value=Metric(value=told[name], unit="µm", standard_error=float(wrong[place] * SIZES[place])),
            expected=EXPECTED[name],
            remaining=float(min(wrong[place], 1.0)),
        )
        for place, name in enumerate(EXPECTED)
    )
    return make_inference(of, errors=tuple(errors), covariance=covariance)


AREAS = {face: of.radius(U) ** 2 / cosine(of, U) for face, of in LENS.surfaces.items()}


def rms(face: str, values: np.ndarray) -> float:
    return float(np.sqrt(np.average(values**2, weights=AREAS[face])))


@pytest.mark.parametrize("gain", [1.0, 0.6])
def test_the_expected_second_cut_is_that_of_lenses_that_the_pictures_may_be_of(gain: float) -> None:
    """Truth drawn anew: what is left of it has the stated rms, and the covariance of the errors counts."""
    made = inference()
    cut = inferred_cut(made, LENS, NominalFace.of(LENS, "outer"), Request(gain=gain))
    corrected = 1e3 * gain * cut.likeliest.change.radius(U) * cosine(LENS.outer, U)
    fields = errors_along_normal("outer", U)
    forms = [name for name in EXPECTED if name.startswith("outer")]
    wrong = [sum(numbers[name] * fields[name] for name in forms) for numbers in (drawn(s, SPREAD) for s in range(300))]
    kept = deviation_um("outer", {name: FOUND[name] for name in forms}, U) - corrected
    left = [rms("outer", kept + of_truth) for of_truth in wrong]
    stated = 1e3 * np.sqrt(cut.points.mean_square(cut.likeliest.values - gain * cut.again))
    assert stated == pytest.approx(np.sqrt(np.mean(np.square(left))), rel=0.06)
    of_errors = [rms("outer", of_truth) for of_truth in wrong]
    assert 1e3 * cut.noise_mm == pytest.approx(np.sqrt(np.mean(np.square(of_errors))), rel=0.06)
    assert cut.inferred.left == (UNSEEN,)


@pytest.mark.parametrize(
    ("registration", "moved"), [("rigid", ()), ("shift", ("tilt",)), ("none", ("tilt", "decentre", "gap"))]
)
def test_the_face_is_corrected_by_what_is_told_of_it(registration: str, moved: tuple[str, ...]) -> None:
    """With its place as far as that counts as form; the rest of the place is the stated pose."""
    cut = inferred_cut(inference(), LENS, NominalFace.of(LENS, "outer"), Request(registration=registration))
    told = {name: amount for name, amount in FOUND.items() if name not in PLACES or name.startswith(moved)}
    wanted = deviation_um("outer", {**told, UNSEEN: 0.0}, U)
    found = 1e3 * cut.likeliest.change.radius(U) * cosine(LENS.outer, U)
    assert rms("outer", found - wanted) < 0.01 * rms("outer", wanted)
    motion = cut.placed.motion
    assert motion.translation_mm[1] == pytest.approx(0.0 if "decentre" in moved else -1e-3 * FOUND["decentre y"])
    assert motion.rotation_rad[0] == pytest.approx(0.0 if "tilt" in moved else -1e-3 * FOUND["tilt about x"])
    inner = inferred_cut(inference(), LENS, NominalFace.of(LENS, "inner"), Request(registration=registration))
    assert not inner.placed.motion.translation_mm.any() and inner.inferred.left == ()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A result folder with the errors by pictures, and the inner face corrected by the command."""
    directory = tmp_path_factory.mktemp("inferred")
    LENS.save(directory / "lens.json")
    inference().write(directory)
    return directory


def test_the_second_cut_has_the_hidden_error_but_what_was_wrong_in_the_pictures(folder: Path) -> None:
    """The machine errs again by the hidden errors; the CAD kernel reads the file that the command wrote."""
    options = ("--inferred", folder / "infer.json", "--surface", "outer", "--registration", "none", "--rays", 64)
    done = CliRunner().invoke(cli, ["correct", *map(str, (folder, *options))])
    assert done.exit_code == 0, done.output
    told = done.stdout.replace("\u202f", " ")
    assert UNSEEN in told and "by 2 pictures" in told and "Left out by the filter" not in told
    made = lf.load(folder).others["correct_outer_64rays"]
    hidden = {name: FOUND[name] + wrong for name, wrong in drawn(8, SPREAD).items()}
    error = lambda u: 1e-3 * deviation_um("outer", hidden, u) / cosine(LENS.outer, u)  # noqa: E731
    left = 1e3 * CutAgain(
        (folder / "lens_corrected_outer_64rays.step").read_bytes(), "outer", LENS.outer, error
    ).along_normals(U)
    of_truth = deviation_um("outer", {n: v - (0.0 if n == UNSEEN else FOUND[n]) for n, v in hidden.items()}, U)
    assert rms("outer", left - of_truth) < 0.01 * made.deviation_um.rms
    assert rms("outer", left) == pytest.approx(made.expected_um.rms, rel=0.6)
    assert rms("outer", left) < 0.5 * made.deviation_um.rms
    assert made.inferred.pictures == 2 and made.point_count == 0
    assert made.inputs == {"lens": LENS.sha256, "infer": inference().sha256}


def test_nothing_told_another_lens_and_another_file_are_refused(folder: Path, tmp_path: Path) -> None:
    unseen = inference(spread=0.9 * np.eye(len(SIZES)))
    other = replace(LENS, spec=LENS.spec.replace({"name": "other"}))
    (tmp_path / "points.json").write_text("{}", encoding="utf-8")
    correct = partial(lf.correct, LENS, surface="inner")
    for message, wrong in (
        (
            r"the pictures tell no form error of the inner face; take a further one with the LED at 0, 0.25, 0 mm",
            {"inferred": unseen},
        ),
        (r"inferred: the errors of another lens; run `lensforge infer`", {"inferred": inference(other)}),
        (
            r"points.json: written before version 0.2.0, must be 'lensforge-infer-3'; run `le",
            {"inferred": tmp_path / "points.json"},
        ),
        (r"none.json: .*run `lensforge infer` first", {"inferred": tmp_path / "none.json"}),
        (r"poses.csv: no JSON file; give the infer.json", {"inferred": tmp_path / "poses.csv"}),
        (r"give one of two: points measured on the first cut, --points FILE", {}),
        (r"give one of two", {"inferred": unseen, "points": tmp_path / "points.json"}),
    ):
        with pytest.raises(InputError, match=message) as refused:
            correct(**wrong)
        assert "\n" not in str(refused.value)
