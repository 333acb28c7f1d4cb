"""A spec made of objects: the same lines of error as the command line, and it reads back equal from its file."""

from pathlib import Path

import numpy as np
import pytest
from scenes import small_spec

import lensforge as lf
from lensforge.spec import parse_spec

SPECS = sorted((Path(__file__).parents[2] / "examples").glob("*.toml"))


@pytest.mark.parametrize("path", SPECS, ids=lambda path: path.stem)
def test_every_shipped_spec_is_saved_and_read_back_equal(path: Path, tmp_path: Path) -> None:
    spec = lf.load_spec(path)
    spec.save(tmp_path / "again.toml")
    again = lf.load_spec(tmp_path / "again.toml")
    assert again == spec
    assert again.model_dump() == spec.model_dump()
    assert spec.replace(name="other").replace(name=spec.name) == spec


def test_arrays_come_back_to_the_bit(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    rows = np.column_stack([rng.normal(size=(50, 3)), np.abs(rng.normal(size=(50, 3))), rng.random(50)])
    values = rng.random((7, 9))
    target = lf.ArrayTarget(values, width_mm=90.0, distance_mm=100.0, receiver_mm=200.0)
    spec = small_spec().replace(source=lf.RaySource(rows, flux_w=2.0), target=target)
    spec.save(tmp_path / "small.toml")
    again = lf.load_spec(tmp_path / "small.toml")
    assert again == spec
    assert isinstance(again.source, lf.RaySource) and isinstance(again.target, lf.ArrayTarget)
    assert np.array_equal(again.source.positions_mm, rows[:, :3])
    assert np.array_equal(again.target.values, values)
    assert spec != spec.replace(target={"values": values + 1e-15})
    with pytest.raises(ValueError, match="read-only"):
        again.target.values[0, 0] = 1.0


def test_objects_and_tables_make_the_same_spec() -> None:
    table = small_spec()
    made = lf.Spec(
        name="small",
        source=lf.SquareSource(side_mm=1.0),
        lens=lf.LensSection(levels=(9, 25), inner_offset_mm=3.0, outer_offset_mm=6.0, symmetry="none"),
        constraints=lf.ConstraintsSection(
            cavity_height_mm=0.5, cavity_radius_mm=1.0, min_thickness_mm=1.0, max_radius_mm=7.0
        ),
        target=lf.FlatTopTarget(half_width_mm=80.0, distance_mm=100.0, receiver_mm=200.0, uniform_mm=100.0),
        optimise=lf.OptimiseSection(steps_per_level=(4, 4), rays=1024, pixels=16),
        evaluate=lf.EvaluateSection(rays=4096, pixels=16),
        base=lf.BaseSection(diameter_mm=16.0),
    )
    assert made == table and hash(made) == hash(table)


def test_a_change_keeps_what_was_given_and_no_more() -> None:
    spec = small_spec(lens__material="PC")
    assert spec.replace(lens={"material": "PMMA"}).lens.refractive_index == pytest.approx(1.4914, abs=2e-3)
    assert spec.replace({"constraints.max_radius_mm": 8.0}).constraints.max_radius_mm == 8.0
    assert spec.constraints.max_radius_mm == 7.0
    assert spec.replace(source=lf.DiscSource(diameter_mm=2.0)).source == lf.DiscSource(diameter_mm=2.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"target.distance_mm": "far"}, "target.distance_mm = 'far'"),
        ({"constraints.max_radius_mm": -1.0}, "constraints.max_radius_mm = -1.0"),
        ({"targets": {"distance_mm": 1.0}}, "targets"),
        ({"target.distance_mm": 5.0}, "inside the lens"),
        ({"source": 3}, "source = 3"),
    ],
)
def test_a_change_that_cannot_be_is_one_line(change: dict[str, object], message: str) -> None:
    with pytest.raises(lf.InputError) as refusal:
        small_spec().replace(change)
    assert message in str(refusal.value) and len(str(refusal.value).splitlines()) == 1


def test_a_spec_does_not_change() -> None:
    with pytest.raises(lf.InputError, match="make another with replace"):
        small_spec().name = "other"


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (np.zeros((3, 3)), "not 0 everywhere"),
        (-np.eye(3), "must be 0 or above"),
        ([[1.0, np.nan]], "not finite"),
        ([1.0, 2.0], "shape (2,), must be (n, n)"),
        ("picture.png", "no array of numbers"),
        ({"shape": [2, 2], "float64": "AAAA"}, "no array of numbers"),
    ],
)
def test_an_array_that_is_no_light_is_one_line(values: object, message: str) -> None:
    with pytest.raises(lf.InputError) as refusal:
        lf.ArrayTarget(values, width_mm=1.0, distance_mm=2.0, receiver_mm=3.0)  # type: ignore[arg-type]
    assert message in str(refusal.value) and len(str(refusal.value).splitlines()) == 1


def test_a_wrong_array_in_a_file_names_its_field() -> None:
    content = small_spec().model_dump(mode="json") | {"source": {"kind": "rays", "positions_mm": 3}}
    with pytest.raises(lf.InputError, match=r"file: source\.positions_mm"):
        parse_spec(content, "file")
