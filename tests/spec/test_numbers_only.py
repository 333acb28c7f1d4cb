"""Numbers of a spec: no field takes true, false or a text for one, alone, in a list, or in a change."""

from collections.abc import Iterator
from typing import Any, get_args

import numpy as np
import pytest
from pydantic import ValidationError
from scenes import small_spec

import lensforge as lf
from lensforge.errors import InputError
from lensforge.results.arguments import count_of, number_of
from lensforge.results.validation import with_changes
from lensforge.spec.spec_fields import all_sections
from lensforge.spec.spec_section import numbers_of


def _types_in(annotation: Any) -> set[Any]:
    return {annotation} | {kind for part in get_args(annotation) for kind in _types_in(part)}


def _numeric_fields() -> Iterator[tuple[type[Any], str]]:
    for section in all_sections(lf.Spec):
        for name, field in section.model_fields.items():
            types = _types_in(field.annotation)
            if types & {int, float} and bool not in types:
                yield section, name


FIELDS = list(_numeric_fields())


def test_every_numeric_field_refuses_booleans_and_texts() -> None:
    """By itself, as ``changed`` checks it; a field that takes words takes no number in quotes."""
    assert len(FIELDS) > 250
    for section, name in FIELDS:
        for value in (True, np.True_, "1"):
            sample = section.model_construct()
            try:
                with_changes(sample, {name: value})
            except (ValidationError, TypeError):
                continue
            assert value == "1" and str in _types_in(section.model_fields[name].annotation), (section, name, value)


@pytest.mark.parametrize("wrong", [True, False, np.True_, "1", b"1"])
def test_sections_of_one_kind_and_of_several_and_changes_refuse_them(wrong: Any) -> None:
    refusals = [
        lambda: lf.SquareSource(side_mm=wrong),
        lambda: lf.RectangleTarget(width_mm=10.0, height_mm=10.0, distance_mm=50.0, uniform_mm=[5.0, wrong]),
        lambda: small_spec(constraints__max_radius_mm=wrong),
        lambda: small_spec(evaluate__rays=wrong),
        lambda: small_spec().replace({"lens.inner.offset_mm": wrong}),
        lambda: small_spec().source.changed(side_mm=wrong),
        lambda: small_spec().evaluate.changed(rays=wrong),
    ]
    for refusal in refusals:
        with pytest.raises(InputError, match=r"must be a (whole )?number"):
            refusal()


def test_numbers_of_numpy_and_whole_floats_stay_numbers() -> None:
    for number in (1, 1.0, np.float32(1.0), np.float64(1.0), np.int32(1)):
        assert lf.SquareSource(side_mm=number).side_mm == 1.0
    for count in (4096, 4096.0, np.int64(4096), np.float64(4096.0)):
        assert small_spec(evaluate__rays=count).evaluate.rays == 4096


@pytest.mark.parametrize("wrong", [True, np.True_, "1"])
def test_arguments_of_verbs_refuse_them(wrong: Any) -> None:
    for check in (count_of, number_of):
        with pytest.raises(InputError):
            check("rays", wrong)


def test_tables_of_numbers_hold_no_booleans() -> None:
    for wrong in ([[1.0, True]], [[True, False]], np.array([[True]]), [["1.0"]]):
        with pytest.raises(ValueError, match="not an array of numbers"):
            numbers_of(wrong)
