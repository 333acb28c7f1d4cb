"""Room for the cutter at the base: what it leaves of the base is what the plan allows."""

from dataclasses import replace

import pytest
from geometry_lenses import make_lens

from lensforge.cad import cutter_room
from lensforge.cad.cutter_room import base_with_room
from lensforge.cad.form_error import fit_lens
from lensforge.cad.patch import Patch
from lensforge.cad.plan import make_plan
from lensforge.scene.lens import Lens
from lensforge.spec import Spec

INNER_MM = 6.0
OUTER_MM = 13.7


def cut_lens(wall_mm: float, relative: float = 0.0, **base: object) -> Lens:
    """A lens that is cut by a ball of 1 mm."""
    lens = make_lens(INNER_MM, OUTER_MM, relative, seed=1, base=base)
    spec = lens.spec.replace({"manufacture.required": True, "constraints.min_thickness_mm": wall_mm})
    return replace(lens, spec=spec)


@pytest.mark.parametrize("diameter_mm", [25.4, 30.0])
def test_with_no_least_wall_the_step_leaves_some_of_the_base(diameter_mm: float) -> None:
    """The ball needs 1 mm below the rim; 0.9 mm of base, less a flange of 0.1 mm, must not be cut through."""
    sizes = {"diameter_mm": diameter_mm, "height_mm": 0.9, "flange_diameter_mm": 40.0, "flange_height_mm": 0.1}
    lens = cut_lens(1e-6, **sizes)
    base = base_with_room(lens)
    assert 0.0 <= base.step_mm <= 0.8 - 0.01
    assert (base.step_mm > 0.0) == (diameter_mm > 2.0 * OUTER_MM)
    make_plan(*fit_lens(lens), base)


@pytest.mark.parametrize("pocket_mm", [None, 13.0])
def test_room_that_ends_at_the_least_wall_is_no_error_of_the_plan(pocket_mm: float | None) -> None:
    """The rim of an uneven cavity, which a ball must leave: its bore takes all of the room that there is."""
    base = {"diameter_mm": 13.0} if pocket_mm is None else {"diameter_mm": 26.0, "pocket_diameter_mm": pocket_mm}
    lens = cut_lens(1e-6, 0.03, **base)
    cut_base = base_with_room(lens)
    assert cut_base.bore_setback_mm is not None
    make_plan(*fit_lens(lens), cut_base)


def test_the_step_s_wall_keeps_off_the_bore_that_the_spec_gives_be_it_0(monkeypatch: pytest.MonkeyPatch) -> None:
    openings = []

    def relief(_outer: Patch, _spec: Spec, opening_mm: float) -> dict[str, float]:
        openings.append(opening_mm)
        return {"relief_step_mm": 0.0, "relief_setback_mm": 0.0}

    monkeypatch.setattr(cutter_room, "_bore_setback", lambda *_: 0.5)
    monkeypatch.setattr(cutter_room, "_relief", relief)
    assert base_with_room(cut_lens(0.1, bore_setback_mm=0.0)).bore_setback_mm == 0.0
    assert base_with_room(cut_lens(0.1)).bore_setback_mm == 0.5
    assert openings == pytest.approx([INNER_MM, INNER_MM + 0.5])
