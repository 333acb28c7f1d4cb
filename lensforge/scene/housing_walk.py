"""The way of light from body to body of a ``[[scene]]``: until it lands, a body takes it, or its events are spent."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from lensforge.scene.exit_rays import ExitRays
from lensforge.scene.housing import Housing, Shadow

_OF_WAY = ("points", "directions", "flux")


class SceneLeg(NamedTuple):
    """Straight ways of ``rays``, with the ``rows`` that they had as they left the lens, and the ``shadow`` on them."""

    rows: Int[np.ndarray, " k"]
    rays: ExitRays
    shadow: Shadow

    @staticmethod
    def first(rays: ExitRays, shadow: Shadow) -> "SceneLeg":
        """The ways of all ``rays`` from the lens."""
        return SceneLeg(np.arange(len(rays.flux)), rays, shadow)


def legs_of(
    housing: Housing, rays: ExitRays, shadow: Shadow, shadow_on: Callable[[ExitRays], Shadow]
) -> tuple[SceneLeg, ...]:
    """Legs of ``rays``, NumPy arrays, from body to body, the first of all rays.

    ``shadow``: on that; ``shadow_on``: the shadow on rays that go on from bodies. What then meets a body, after its
    last event, is lost there.
    """
    legs = [SceneLeg.first(rays, shadow)]
    for event in range(1, housing.events + 1):
        before = legs[-1]
        goes_on, behind = housing.reflected(before.rays, before.shadow)
        if event > 1 and not len(goes_on):
            break
        shadow = shadow_on(behind)
        if event == housing.events:
            shadow = shadow._replace(again=shadow.met, onward=np.ones_like(shadow.onward))
        legs.append(SceneLeg(before.rows[goes_on], behind, shadow))
    return tuple(legs)


def last_of(legs: Sequence[SceneLeg]) -> SceneLeg:
    """The last leg of each ray, and its shadow: where it met a body first, and what goes on from all."""
    first, *further = legs
    ways = {name: getattr(first.rays, name).copy() for name in _OF_WAY}
    again = first.shadow.again.copy()
    onward = first.shadow.onward.copy()
    for leg in further:
        for name, values in ways.items():
            values[leg.rows] = getattr(leg.rays, name)
        again[leg.rows] = leg.shadow.again
        onward[leg.rows] *= leg.shadow.onward
    return SceneLeg(first.rows, replace(first.rays, **ways), first.shadow._replace(again=again, onward=onward))
