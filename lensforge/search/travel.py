"""The travel of an LED between the states of a lens: room for it at every stop, and between them."""

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from lensforge.errors import InputError, remedy
from lensforge.light.lens_light import source_of
from lensforge.search.scene_check import source_clearance_warnings
from lensforge.spec import Spec
from lensforge.spec.emitter_section import EmitterSection
from lensforge.spec.source_sections import Placement

_STEPS = 32  # of a travel; by a shift alone its ends decide about a paraboloid, which is convex


def travelled(first: EmitterSection, last: EmitterSection, share: float) -> EmitterSection:
    """The LED after a ``share`` of its straight way from ``first`` to ``last``, turned in proportion."""
    places = {
        name: (1.0 - share) * np.array(getattr(first, name)) + share * np.array(getattr(last, name))
        for name in ("position_mm", "tilt_deg")
    }
    return first.changed(**{name: tuple(place.tolist()) for name, place in places.items()})


def require_clear_travel(spec: Spec) -> tuple[str, ...]:
    """Raise :class:`InputError` where the LED meets the lens between two states, of which both have room for it.

    As at a stop, nothing is said of a ray set; of ``sources`` one LED is built in, which does not travel. Returns a
    warning on solids that do not travel with the LED.
    """
    if not spec.states:
        return ()
    for (name, state), (other, last) in combinations(spec.by_state.items(), 2):
        with remedy(f"the LED is between the states {name!r} and {other!r}"):
            for source in _between(state.source, last.source):
                alone = state.changed(source=source)
                for warning in source_clearance_warnings(alone, source_of(alone)):
                    raise InputError(warning)
    moving = any(state.pose != spec.source.pose for state in spec.each_source)
    if not (moving and spec.constraints.keep_out):
        return ()
    return ("constraints.keep_out: its solids stay where they are; the file must hold what travels at every stop",)


def _between(first: EmitterSection, last: EmitterSection) -> Iterator[EmitterSection]:
    """The LED on its way, without its stops; none of a ray set, and where ``last`` is another LED."""
    is_same = last.changed(position_mm=first.position_mm, tilt_deg=first.tilt_deg) == first
    if is_same and not isinstance(first, Placement):
        yield from (travelled(first, last, step / _STEPS) for step in range(1, _STEPS))
