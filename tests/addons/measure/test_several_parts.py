"""Several parts of one mould: what they have in common, how they scatter by cavity, and what a correction leaves."""

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from measured_lenses import lens
from scipy.spatial.transform import Rotation
from second_cuts import CutAgain, cosine, machine_error, without_motion
from test_measured_page import same_where_known

import lensforge as lf
from lensforge.addons.measure.first_cut import FirstCut, Request
from lensforge.addons.measure.measured_points import PartPoints, measured_parts
from lensforge.addons.measure.measured_section import _parts_pictures
from lensforge.addons.measure.nominal_face import NominalFace
from lensforge.addons.measure.several_parts import common_cut
from lensforge.cli.cli import cli
from lensforge.errors import FileWarning, InputError
from lensforge.report import page
from lensforge.surfaces.srbf import fibonacci_hemisphere

PLAIN = lens()
LENS = replace(PLAIN, spec=PLAIN.spec.replace({"manufacture": {"form_tolerance_um": 30.0}}))
FACE = NominalFace.of(LENS, "inner")
CAVITIES = ("C1", "C2", "C2", "C7", "C1", "C7", "C7", "C1")
NOISE_MM = 3e-4
U = fibonacci_hemisphere(4000)


def forms(u: np.ndarray) -> np.ndarray:
    """Low forms, crooked against the axes."""
    x, y, z = Rotation.from_rotvec([0.0, 0.0, 0.4]).apply(u).T
    return np.stack([x * x - y * y, y * (3.0 * z * z - 1.0), 2.0 * x * y * z + x**3 - 3.0 * x * y * y])


def common(u: np.ndarray) -> np.ndarray:
    return machine_error(u, 6.0, wave_mm=4.0)


def along_normals(error: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """The part of an error (um) that is no motion, along the normals, at places even over the sphere."""
    return 1e3 * without_motion(LENS.inner, error)(U) * cosine(LENS.inner, U)


AREAS = LENS.inner.radius(U) ** 2 / cosine(LENS.inner, U)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.average(values**2, weights=AREAS)))


# Amounts of the forms (mm): of each cavity, which add to none, and of each part.
OF_CAVITY = dict(
    zip(("C1", "C2", "C7"), 1.5e-3 * np.array([[1.0, -0.5, 0.2], [0.3, 1.0, -0.7], [-1.3, -0.5, 0.5]]), strict=True)
)
OF_PART = 4e-4 * np.random.default_rng(11).normal(size=(len(CAVITIES), 3))
SCATTER_UM = 0.4 * np.sqrt(sum(rms(along_normals(lambda u, row=row: 1e-3 * forms(u)[row])) ** 2 for row in range(3)))


def part(number: int, cavity: str, amount: np.ndarray) -> PartPoints:
    """Points of a part that lies askew in the machine, at places of its own, and more of them on some parts."""
    rng = np.random.default_rng(100 + number)
    u = Rotation.from_rotvec([0.0, 0.0, rng.uniform(0.0, 6.0)]).apply(fibonacci_hemisphere(500 + 40 * number))
    points = u * (LENS.inner.radius(u) + common(u) + amount @ forms(u))[:, None]
    points += NOISE_MM * rng.normal(size=(len(u), 1)) * LENS.inner.normal(u)
    askew = Rotation.from_rotvec(rng.normal(0.0, 0.01, 3)).apply(points) + rng.normal(0.0, 0.05, 3)
    return PartPoints(askew, f"{cavity}_{number}.csv", cavity)


PARTS = [
    part(number, cavity, OF_CAVITY[cavity] + own)
    for number, (cavity, own) in enumerate(zip(CAVITIES, OF_PART, strict=True))
]


@pytest.fixture(scope="module")
def cut() -> FirstCut:
    return common_cut(PARTS, FACE, Request())


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A result folder with the files of all parts."""
    directory = tmp_path_factory.mktemp("several")
    LENS.save(directory / "lens.json")
    (directory / "parts").mkdir()
    for measured in PARTS:
        np.savetxt(directory / "parts" / measured.name, measured.cloud, delimiter=",")
    return directory


def test_the_series_is_that_of_the_parts(cut: FirstCut) -> None:
    """Truth: the common error, the amounts of each cavity, and a scatter that is known; errors are those stated."""
    series = cut.series
    assert series is not None and series.freedom == 5 and series.repeats
    assert abs(series.repeatability_um.value - SCATTER_UM) < 2.5 * series.repeatability_um.standard_error
    amounts = np.array([*OF_CAVITY.values()])
    apart = [along_normals(lambda u, amount=amount: amount @ forms(u)) for amount in amounts - amounts.mean(axis=0)]
    between = np.sqrt(sum(rms(values) ** 2 for values in apart) / 2.0)
    assert abs(series.between_um.value - between) < 2.5 * series.between_um.standard_error
    deviation = 1e3 * cut.likeliest.change.radius(U) * cosine(LENS.inner, U)
    error = rms(deviation - along_normals(lambda u: common(u) + amounts.mean(axis=0) @ forms(u)))
    weights = np.array([1.0 / (3.0 * CAVITIES.count(cavity)) for cavity in CAVITIES])
    assert series.common_error_um == pytest.approx(series.repeatability_um.value * np.linalg.norm(weights))
    assert error < 1.5 * series.common_error_um
    assert [(of.cavity, of.count) for of in series.cavities] == [("C1", 3), ("C2", 2), ("C7", 3)]
    for of, amount, away in zip(series.cavities, amounts, apart, strict=True):
        assert of.mean_um == pytest.approx(
            rms(along_normals(lambda u, a=amount: common(u) + a @ forms(u))), abs=SCATTER_UM
        )
        assert of.apart_um == pytest.approx(rms(away), abs=SCATTER_UM)
    for of, own, cavity in zip(series.parts, OF_PART, CAVITIES, strict=True):
        form = along_normals(lambda u, amount=OF_CAVITY[cavity] + own: common(u) + amount @ forms(u))
        assert of.cavity == cavity
        assert of.rms_um == pytest.approx(rms(form), rel=0.08)
        assert of.profile_um == pytest.approx(2.0 * np.abs(form).max(), rel=0.15)
    assert 1e3 * cut.noise_mm == pytest.approx(1e3 * NOISE_MM, rel=0.1)


def test_capability_is_by_the_profiles_of_the_parts(cut: FirstCut) -> None:
    series = cut.series
    profiles = {name: np.array([of.profile_um for of in series.parts if of.cavity == name]) for name in OF_CAVITY}
    pooled = np.sqrt(sum(((values - values.mean()) ** 2).sum() for values in profiles.values()) / 5.0)
    worst = max(profiles.values(), key=lambda values: values.mean())
    assert series.cpk.value == pytest.approx((30.0 - worst.mean()) / (3.0 * pooled))
    assert series.cp.value == pytest.approx(30.0 / (6.0 * series.repeatability_um.value))


def test_a_correction_leaves_no_more_than_the_error_of_the_mean(folder: Path) -> None:
    """The mould cuts again by the STEP, as the CAD kernel reads it; what is left of it lies within the stated error."""
    made = lf.correct(LENS, points=folder / "parts", surface="inner", rays=64)
    series = made.series
    amounts = np.mean([*OF_CAVITY.values()], axis=0)
    again = CutAgain(
        made.step, "inner", LENS.inner, without_motion(LENS.inner, lambda u: common(u) + amounts @ forms(u))
    )
    left = rms(1e3 * again.along_normals(U))
    assert left < 1.3 * series.common_error_um < series.repeatability_um.value / 2.0
    assert made.expected_um.rms == pytest.approx(left, rel=0.6)
    assert made.deviation_um.rms > 5.0 * left
    for of in series.cavities:
        amount = OF_CAVITY[of.cavity] - amounts
        assert of.left_um == pytest.approx(rms(along_normals(lambda u, a=amount: a @ forms(u))), abs=SCATTER_UM)


def test_the_command_reads_a_folder_and_its_record_is_read_again(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    few = folder / "few"
    few.mkdir()
    for of in PARTS[:3]:
        shutil.copy(folder / "parts" / of.name, few)
    done = CliRunner().invoke(cli, ["compare", str(folder), "--points", str(few), "--surface", "inner", "--rays", "64"])
    assert done.exit_code == 0, done.output
    told = done.stdout.replace("\u202f", " ")
    assert "of 2 cavities" in told and "Mean deviation, C2" in told
    assert "of all parts; a cavity has one alone, measure two of each, rms over the face, 2 degrees of freedom" in told
    content = json.loads((folder / "compare_inner_64rays.json").read_text(encoding="utf-8"))
    assert [of["count"] for of in content["series"]["cavities"]] == [1, 2]
    record = lf.load(folder).others["compare_inner_64rays"]
    assert record.point_count == sum(len(of.cloud) for of in PARTS[:3]) == len(record.points)
    figures = {}
    monkeypatch.setattr(page, "to_svg", lambda figure, name, title: figures.setdefault(name, figure) and "")
    assert len(_parts_pictures(record)) == 3
    farthest = max(record.series.cavities, key=lambda of: of.apart_um)
    for name, values in (("scatter-inner", record.series.scatter_map_um), ("cavity-0-inner", farthest.map_um)):
        (image,) = figures[name].axes[0].images
        same_where_known(np.ma.filled(image.get_array(), np.nan), values)


def test_a_part_of_another_lens_is_refused_by_its_name() -> None:
    u = fibonacci_hemisphere(500)
    far = PartPoints(u * (LENS.inner.radius(u) + 0.2 * forms(u)[0])[:, None], "C7_9.csv", "C7")
    with pytest.raises(InputError, match=r"^C7_9.csv: its form is .* from that of the nearest part, where others dif"):
        common_cut([*PARTS[:4], far], FACE, Request())
    half = replace(PARTS[0], cloud=np.concatenate([PARTS[0].cloud, 1.3 * PARTS[0].cloud[::2]]))
    share = r"^C1_0.csv: 6\d\.?\d*\u2009% of its points lie on the face, must be 90\u2009% at least: is it of another"
    with pytest.raises(InputError, match=share):
        common_cut([half, PARTS[1]], FACE, Request())


def test_mixed_up_labels_are_told() -> None:
    labels = ["C2", "C7", "C2", "C7", "C7"]  # C2_2 and C7_3 exchanged
    parts = [replace(PARTS[number], cloud=PARTS[number].cloud.copy()) for number in (1, 2, 3, 5, 6)]
    mixed = [replace(of, cavity=label) for of, label in zip(parts, labels, strict=True)]
    mixed[3].cloud[7] = 0.0
    with pytest.warns(FileWarning, match=r"^C7_5.csv: points: 1 at 0, 0, 0, as a machine writes what it did not reach"):
        cut = common_cut(mixed, FACE, Request())
    assert cut.series.exchanged == ("C2_2.csv", "C7_3.csv")


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (
            ["C1_1.csv"],
            r"parts: 1 files of points, must be from 2 to 200, .* for one part, which has no scatter and no Cp",
        ),
        (
            ["C1_1.csv", "2.csv"],
            r"parts: 2.csv states no cavity, 1 other files do; call all such as cavity3_part12.csv",
        ),
        (["C1_1.csv", "C1_2.csv"], r"parts: C1_1.csv and C1_2.csv hold the same points: are they one part\?"),
        (["C1_1.csv", "C1_2.txt"], r"C1_2.txt: has no row of numbers"),
    ],
)
def test_a_folder_that_is_no_series_is_refused_in_a_line(
    folder: Path, tmp_path: Path, names: list[str], message: str
) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / ".notes").write_text("hidden", encoding="utf-8")
    for name in names:
        if name.endswith(".txt"):
            (tmp_path / "parts" / name).write_text("nothing", encoding="utf-8")
        else:
            shutil.copy(folder / "parts" / PARTS[0].name, tmp_path / "parts" / name)
    with pytest.raises(InputError, match=message) as caught:
        lf.compare(LENS, points=tmp_path / "parts", surface="inner")
    assert "\n" not in str(caught.value)


def test_parts_without_a_cavity_are_of_one(folder: Path, tmp_path: Path) -> None:
    for number, of in enumerate(PARTS[:3]):
        shutil.copy(folder / "parts" / of.name, tmp_path / f"{number}.csv")
    assert [(of.name, of.cavity) for of in measured_parts(tmp_path, LENS, "inner")] == [
        ("0.csv", ""), ("1.csv", ""), ("2.csv", "")
    ]  # fmt: skip
