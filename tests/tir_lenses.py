"""A small lens for total internal reflection: its spec, and the lens from which its search starts."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from presets import FEW

from lensforge.cad.wall import Span
from lensforge.scene.lens import Lens
from lensforge.search.design_result import Margins
from lensforge.search.feasibility import measure_constraints
from lensforge.search.profiles import ProfileParameters
from lensforge.spec import Spec, TirSection, parse_spec

TIR = tuple(role.name for role in TirSection.roles)
SPOT = {
    "source": {"kind": "square", "side_mm": 1.0},
    "lens": {"kind": "tir", "profile": 8},
    "constraints": {"max_radius_mm": 8.0},
    "target": {"kind": "disc", "diameter_deg": 20.0, "half_angle_deg": 30.0},
    "optimise": {"aim": "share", "steps_per_level": [25], "rays": 4096},
    "limits": [{"kind": "zone", "zone": {"kind": "disc", "diameter_deg": 20.0}, "at_least_share": 0.8}],
    "manufacture": {"required": False},  # as in scenes.py
}


def spot(**lens: Any) -> Spec:
    """Its spec, with fields of its lens."""
    steps = [25, *(10 for _ in lens.get("levels", ()))]
    optimise = {**SPOT["optimise"], "steps_per_level": steps}
    return parse_spec({**SPOT, "lens": {**SPOT["lens"], **lens}, "optimise": optimise}, "spot")


def spot_lens(spec: Spec | None = None, **changes: Any) -> Lens:
    """The lens from which the search starts; ``changes`` of sections of its spec."""
    spec = (spec or spot()).replace(**changes)
    return Lens(ProfileParameters.of(spec, 2.5).start_surfaces, spec, 0, FEW)


@contextmanager
def wall_not_measured() -> Iterator[None]:
    """The thinnest wall of a lens is 9 mm, and takes no second to find."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("lensforge.cad.wall.thinnest_of", lambda _: Span(9.0, np.zeros(3), np.ones(3)))
        yield


def margins_but_for_the_wall(lens: Lens) -> Margins:
    """Of a finished lens."""
    with wall_not_measured():
        return measure_constraints(lens)
