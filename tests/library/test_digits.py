"""Digits of printed numbers: as many as their standard errors carry."""

import pytest

from lensforge.cli.rounded import figure, in_percent, measured, times
from lensforge.report.numerals import number_with_error
from lensforge.results import Metric


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (0.0123456, 0.00123, "0.0123 ± 0.0012"),
        (0.85, 0.000999, "0.8500 ± 0.0010"),  # the error is rounded first
        (-1.224e-4, 3.21e-5, "-0.000122 ± 0.000032"),
        (1234.5, 123.0, "1230 ± 120"),
        (3e-6, 4e-4, "0.00000 ± 0.00040"),
        (1.2345e-10, 1.2e-11, "1.23e-10 ± 1.2e-11"),
        (1e-12, 3e-9, "0e+00 ± 3.0e-09"),
        (0.123456789, None, "0.123457"),
    ],
)
def test_a_value_ends_where_its_error_does(value, error, text):
    assert str(Metric(value=value, standard_error=error)) == text


def test_the_command_line_prints_no_digit_beyond_the_error():
    scale = Metric(value=1.0203456, standard_error=0.00123)
    assert measured(scale) == "1.0203 ± 0.0012"
    assert in_percent(scale) == "102.03 ± 0.12 %"
    assert times(scale, 683.0, "lx") == "696.90 ± 0.84 lx"


def test_what_has_no_error_is_printed_to_four_digits():
    assert figure(0.12345678901, "mm") == "0.1235 mm"
    assert figure(75696.56795739077, "mm³") == "75,697 mm³"
    assert figure(64.869, "°") == "64.87°"


def test_a_page_shows_an_error_by_one_digit_and_the_value_to_it():
    assert number_with_error(Metric(value=1.98456e-4, standard_error=6.1e-5), 4) == "0.0002 ± 6\u2009×\u200910⁻⁵"
    assert number_with_error(Metric(value=61.523, standard_error=0.52), 4) == "61.5 ± 0.5"
    assert number_with_error(Metric(value=61.523), 3) == "61.5"
