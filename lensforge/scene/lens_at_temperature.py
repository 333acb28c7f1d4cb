"""A lens at another temperature than its spec states: it has another index, and every length of it is another.

It grows about its seat, the bottom of its base, which stays where it is, as do source and receivers.
"""

from dataclasses import replace

from lensforge.errors import InputError
from lensforge.optics.material import HIGHEST_C, LOWEST_C
from lensforge.scene.lens import Lens


def at_temperature(lens: Lens, celsius: float) -> Lens:
    """``lens`` at work at ``celsius``; itself at the temperature that it has.

    Raises :class:`InputError` where its change is not known, where its states have temperatures of their own, and out
    of -100 to 400 C.
    """
    section = lens.spec.lens
    if not LOWEST_C <= celsius <= HIGHEST_C:
        raise InputError(f"temperature_c = {celsius:g}: must be {LOWEST_C:g} to {HIGHEST_C:g} (Celsius)")
    if any(state.temperature_c is not None for state in lens.spec.states):
        raise InputError(
            f"temperature_c = {celsius:g}: states of this lens have their own; give the name of one as state"
        )
    if celsius == section.temperature_law.reference_c and section.at_work_c is None:
        return lens
    try:
        return replace(lens, spec=lens.spec.changed(lens=section.at(celsius)))
    except ValueError as error:
        raise InputError(str(error)) from None
