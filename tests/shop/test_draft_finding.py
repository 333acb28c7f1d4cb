"""Draft as a finding: at the vertical, with no undercut and with some."""

import pytest
from scenes import small_spec

from lensforge.shop.check_result import Draft, FaceResult
from lensforge.shop.findings import draft_finding


def face(least_deg: float, undercut: float) -> FaceResult:
    """A face with this draft and undercut; nothing else of it is looked at."""
    draft = Draft(min=least_deg, area_fraction_below_half=0.1, area_fraction_below_two=0.2)
    return FaceResult.model_construct(draft_deg=draft, undercut_fraction=undercut)


@pytest.mark.parametrize(
    ("least_deg", "undercut", "value", "words"),
    [
        (1.5, 0.0, 1.5, "the least draft of the outer face is 1.50 deg; a mould needs"),
        (0.0, 0.0, 0.0, "the least draft of the outer face is 0.00 deg"),
        (-1e-9, 0.0, 0.0, "the least draft of the outer face is 0.00 deg"),
        (-3.0, 0.02, -3.0, "2.00 % of the outer face is undercut, down to a draft of -3.00 deg"),
    ],
)
def test_a_vertical_rim_is_no_undercut(least_deg: float, undercut: float, value: float, words: str) -> None:
    found = draft_finding("outer", face(least_deg, undercut), small_spec())
    assert found.value == value
    assert found.reason.startswith(words)


def test_a_draft_that_the_spec_asks_for_is_the_limit_of_a_part_that_is_cut() -> None:
    asked = {"constraints__outer_draft_deg": 4.0}
    part = draft_finding("outer", face(3.5, 0.0), small_spec(manufacture__make="part", **asked))
    mould = draft_finding("outer", face(3.5, 0.0), small_spec(manufacture__make="insert", **asked))
    assert not part.holds and "the spec asks for 4 deg" in part.reason
    assert mould.holds and "a mould needs" in mould.reason
    enough = draft_finding("outer", face(4.0 - 1e-9, 0.0), small_spec(manufacture__make="part", **asked))
    assert enough.holds
