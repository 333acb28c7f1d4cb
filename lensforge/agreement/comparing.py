"""Comparison of what a record states with what its other numbers say; each contradiction is one phrase."""

from collections.abc import Iterator, Sequence
from math import isclose
from typing import Any

from lensforge.criteria import Criterion, Judged

# The same numbers, added in another order or by another release of NumPy, differ by rounding alone.
_ROUNDING = 1e-6
_ABSOLUTE = 1e-9  # sums of shares that should be 0 or 1


def differing(name: str, stated: float | None, derived: float | None, source: str) -> Iterator[str]:
    """A phrase where ``stated`` is not ``derived`` but for rounding; ``source``: the plural words for its origin."""
    if stated is None or derived is None:
        agrees = stated is None and derived is None
    else:
        agrees = isclose(stated, derived, rel_tol=_ROUNDING, abs_tol=_ABSOLUTE)
    if not agrees:
        yield f"{name} = {_shown(stated)}, but {source} say {_shown(derived)}"


def unlike(name: str, stated: object, wanted: object, source: str) -> Iterator[str]:
    """A phrase where ``stated`` is not ``wanted``: names, settings and counts."""
    if stated != wanted:
        yield f"{name} = {_shown(stated)}, but {source} {_shown(wanted)}"


def beyond(name: str, stated: float, least: float, most: float, source: str) -> Iterator[str]:
    """A phrase where ``stated`` is not from ``least`` to ``most``, but for rounding."""
    below = stated < least and not isclose(stated, least, rel_tol=_ROUNDING, abs_tol=_ABSOLUTE)
    above = stated > most and not isclose(stated, most, rel_tol=_ROUNDING, abs_tol=_ABSOLUTE)
    if below or above:
        yield f"{name} = {_shown(stated)}, but {source} allow {_shown(least)} to {_shown(most)}"


def judged(name: str, stated: Sequence[Judged], derived: Sequence[Judged]) -> Iterator[str]:
    """Phrases where the list ``stated`` is not ``derived``: an entry is missing, foreign, or says another thing."""
    here, there = [_title(each) for each in stated], [_title(each) for each in derived]
    if here != there:
        missing = [each for each in there if each not in here]
        foreign = [each for each in here if each not in there]
        what = f"{missing[0]!r} is missing" if missing else f"{(foreign or here)[0]!r} does not belong there"
        yield f"{name}: {what}"
        return
    for title, one, other in zip(here, stated, derived, strict=True):
        for field in type(one).model_fields:
            yield from unlike(f"{name}: {title}: {field}", getattr(one, field), getattr(other, field), "it must be")


def _title(entry: Judged) -> str:
    if isinstance(entry, Criterion):
        return entry.name
    return f"{getattr(entry, 'name', '')} of {getattr(entry, 'surface', '')}"


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    shown = repr(value)
    return shown if len(shown) <= 60 else f"{shown[:57]}..."
