"""Numbers as the screen shows them: rounded to their standard error, or to the digits that a person needs.

Every number on the screen is made by one of these functions from a number of a record.
"""

from lensforge.results import Metric

_PLAIN = 4  # significant digits of a number that has no statistical error


def measured(metric: Metric) -> str:
    """Value, standard error and unit; both numbers end at the last digit that the error carries."""
    return str(metric).replace(" °", "°")


def in_percent(metric: Metric) -> str:
    """A share in per cent, with its standard error."""
    error = None if metric.standard_error is None else 100.0 * metric.standard_error
    return measured(Metric(value=100.0 * metric.value, unit="%", standard_error=error))


def times(metric: Metric, factor: float, unit: str) -> str:
    """A metric in another unit, ``factor`` times as large."""
    error = None if metric.standard_error is None else factor * metric.standard_error
    return measured(Metric(value=factor * metric.value, unit=unit, standard_error=error))


def share(value: float) -> str:
    """A share without standard error, in per cent to one decimal."""
    return f"{100.0 * value:.1f} %"


def figure(value: float, unit: str = "", digits: int = _PLAIN) -> str:
    """A number without standard error to ``digits`` significant digits, all digits before its decimal point shown."""
    text = f"{value:,.0f}" if abs(value) >= 10.0**digits else f"{value:.{digits}g}"
    return f"{text}{'' if unit in ('', '°') else ' '}{unit}"


def count(number: int) -> str:
    """A whole number, in groups of three."""
    return f"{number:,}"
