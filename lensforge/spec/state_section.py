"""States of a lens: conditions under which one lens is to work, such as the spot and the flood of a zoom torch.

A state is a part of a spec, laid over the spec. So the spec of one state is an ordinary one, and all that takes a lens
with one condition takes it.
"""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any

from pydantic import Field

from lensforge.public import public
from lensforge.spec.emitter_section import Degrees, EmitterSection, Nanometres
from lensforge.spec.lens_material import Celsius
from lensforge.spec.light_limits import LightLimits
from lensforge.spec.receiver_fields import Receivers
from lensforge.spec.spec_section import Coordinate, RelativeWeight, Section, ShortName, check
from lensforge.spec.target_sections import TargetSection

_Share = Annotated[float, Field(ge=0.0, le=1.0)]
_STILL = (0.0, 0.0, 0.0)
_UPRIGHT = (0.0, 0.0)


@public
class StateSection(Section):
    """One of the states of a lens; what it leaves out is that of the spec."""

    name: ShortName = Field(description="Name of the state, in tables, pictures and files.")
    weight: RelativeWeight = Field(
        default=1.0, description="Weight of its light in the mean over all states, relative."
    )
    source: EmitterSection | None = Field(default=None, description="Another LED.")
    shift_mm: tuple[Coordinate, Coordinate, Coordinate] = Field(
        default=_STILL, description="Shift (x, y, z) of the LED against the lens, added to its `position_mm`."
    )
    tilt_deg: tuple[Degrees, Degrees] = Field(
        default=_UPRIGHT, description="Tilt of the LED about the x axis, then the y axis, added to its `tilt_deg`."
    )
    temperature_c: Celsius | None = Field(
        default=None, description="Temperature of the lens, at which its index and its size are others."
    )
    wavelength_nm: Nanometres | None = Field(
        default=None, description="Wavelength of all light of the LED, in place of its spectrum."
    )
    dimming: Annotated[tuple[_Share, ...], Field(min_length=1, max_length=10_000)] | None = Field(
        default=None,
        description="What each chip of the LED gives of its flux, 0 to 1, in their order, an array row by row from its "
        "corner at -x, -y; of a source without chips one number.",
    )
    target: TargetSection | None = Field(default=None, description="The light that is wanted in this state.")
    receivers: Receivers = Field(
        default=(), description="Surfaces that the light falls on in this state, in place of the spec's."
    )
    limits: LightLimits | None = Field(
        default=None, description="Limits on the light of this state, in place of the spec's."
    )

    @check
    def _light_is_given_once(self) -> None:
        if self.target is not None and self.receivers:
            raise ValueError("target and receivers: both are given; give one: what light is wanted, and where")

    def changes(self, led: EmitterSection) -> dict[str, Any]:
        """The sections of a spec that are others in this state; ``led``: the source of the spec.

        Raises ``ValueError`` for a dimming that does not go with its LED.
        """
        source = self.source or led
        if self.dimming is not None:
            source = source.dimmed(self.dimming)
        if self.wavelength_nm is not None:
            source = source.at_wavelength(self.wavelength_nm)
        changes: dict[str, Any] = {"source": self._placed(source)}
        if self.target is not None or self.receivers:
            changes |= {"target": self.target, "receivers": self.receivers}
        if self.limits is not None:
            changes["limits"] = self.limits
        return changes

    def _placed(self, led: EmitterSection) -> EmitterSection:
        """``led`` where it stands in this state."""
        moves = {"position_mm": self.shift_mm, "tilt_deg": self.tilt_deg}
        return led.changed(
            **{
                name: tuple(place + change for place, change in zip(getattr(led, name), by, strict=True))
                for name, by in moves.items()
                if any(by)
            }
        )


def require_every_chip_lit(states: Sequence[StateSection]) -> None:
    """Raise ``ValueError`` where all ``states`` dim the chips of the spec's own LED, and one chip is lit in none."""
    shares = [state.dimming for state in states if state.dimming is not None and state.source is None]
    if len(shares) < len(states):
        return
    dark = [number for number, of_chip in enumerate(zip(*shares, strict=False), start=1) if not any(of_chip)]
    if dark:
        raise ValueError(f"states: chip {dark[0]} is lit in none; light it in a state, or leave it out of the source")


def with_light_of_first(content: Mapping[str, Any]) -> Mapping[str, Any]:
    """``content`` of a spec; where it leaves out LED or target, those of the first of its states."""
    states = content.get("states") or content.get("sources")
    first = states[0] if isinstance(states, list | tuple) and states else None
    missing: dict[str, Any] = {}
    for names in (("source",), ("target", "receivers")):
        given = {name: value for name in names if (value := _value(first, name))}
        if given and not any(content.get(name) for name in names):
            missing |= given
    return {**content, **missing}


def _value(state: object, name: str) -> Any:
    return state.get(name) if isinstance(state, Mapping) else getattr(state, name, None)
