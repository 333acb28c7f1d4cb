"""What the shop is told by the spec: shrinkage, tolerance, author and date; each wrong value is one line."""

import datetime

import pytest
from scenes import small_spec

import lensforge as lf
from lensforge.errors import InputError
from lensforge.spec import load_spec


@pytest.mark.parametrize(
    ("fields", "line"),
    [
        ({"shrinkage": 0.005}, r'shrinkage = 0\.005 goes with make = "insert"'),
        ({"date": "31.3.2026"}, r"date = '31\.3\.2026': a date is written as year-month-day"),
        ({"date": "2026-02-30"}, r"date = '2026-02-30': a date is written as year-month-day"),
        ({"date": 20260331}, r"date = 20260331: a date is written as year-month-day"),
        ({"date": datetime.datetime(2026, 3, 31, 12, 0)}, r"date = .*: a date is written as year-month-day"),
        ({"author": "two\nlines"}, r"author = .*cannot be printed"),
    ],
)
def test_a_wrong_field_is_one_line(fields, line):
    with pytest.raises(InputError, match=line) as caught:
        lf.ManufactureSection(**fields)
    assert "\n" not in str(caught.value)


def test_a_date_of_toml_and_its_text_are_the_same(tmp_path):
    dated = small_spec().replace({"manufacture": {"date": "2026-03-31", "author": "A. Author"}})
    dated.save(tmp_path / "text.toml")
    text = (tmp_path / "text.toml").read_text(encoding="utf-8")
    assert 'date = "2026-03-31"' in text
    (tmp_path / "date.toml").write_text(text.replace('"2026-03-31"', "2026-03-31"), encoding="utf-8")
    assert load_spec(tmp_path / "date.toml") == load_spec(tmp_path / "text.toml") == dated
    assert dated.manufacture.date == "2026-03-31"
