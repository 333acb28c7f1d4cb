"""Records in which no two numbers are alike, so that each number that is shown has one source only."""

from itertools import count

from lensforge.results import Record
from lensforge.results.record import values_of

# Numbers that others are counted by, and those that decide what a sentence says.
_KEPT = {"level", "parts", "pass_rate", "genus", "disagreements", "c_deg", "part", "scale", "file", "files"}


def told_apart(record):
    """``record`` with every number changed by a part of its own, down to 0.8 of it; zeros, maps and texts are kept."""
    return _changed(record, count(1))


def _changed(value, numbers):
    if isinstance(value, Record):
        fields = {name: each for name, each in values_of(value).items() if name not in _KEPT}
        return value.model_copy(update={name: _changed(each, numbers) for name, each in fields.items()})
    if isinstance(value, dict):
        return {key: _changed(each, numbers) for key, each in value.items()}
    if isinstance(value, tuple):
        return tuple(_changed(each, numbers) for each in value)
    if isinstance(value, bool) or not isinstance(value, int | float) or value == 0:
        return value
    part = 0.8 + 0.2 * (next(numbers) * 0.6180339887498949 % 1.0)  # the golden ratio: no two alike
    return max(1, round(value * part)) if isinstance(value, int) else value * part
