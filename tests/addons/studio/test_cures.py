"""The button beside a verdict makes the change that its reasons name."""

from types import SimpleNamespace
from typing import Any

import pytest

from lensforge.addons.studio.cures import cure_of
from lensforge.cad.part import Part
from lensforge.proof.remedies import FINER, form_of_mesh
from lensforge.results.fact import Change
from lensforge.results.figure import Criterion, marks_of


def run(remedy: str = "", accuracy: str = "draft", rings: int = 68, changes: tuple[Change, ...] = ()) -> Any:
    missed = SimpleNamespace(holds=not remedy, remedy=remedy, state="fail" if remedy else "pass")
    findings = [SimpleNamespace(changes=()), SimpleNamespace(changes=changes)]
    result = SimpleNamespace(triangulation=SimpleNamespace(rings=rings), judgements=lambda: {"verdicts": findings})
    lens = SimpleNamespace(accuracy=accuracy)
    met = SimpleNamespace(holds=True, remedy="")
    return SimpleNamespace(
        criteria=lambda: [("export", met), ("verify", missed)], find=lambda kind: result, lens=lens, missing=[]
    )


def declared_remedies() -> list[str]:
    """The remedies that a finer mesh is: those of an exported part, and of rays through its mesh."""
    fields = [
        mark.remedy
        for name in ("watertight", "genus_difference")
        for mark in marks_of(Part.model_fields[name], Criterion)
    ]
    volume = [mark.remedy for mark in Part.mesh_volume_change.fget.figure_marks if isinstance(mark, Criterion)]
    return [*fields, *volume, form_of_mesh(0, True, fine=True)]


@pytest.mark.parametrize(("before", "rings"), [(68, 136), (7000, 10_000)])
@pytest.mark.parametrize("remedy", declared_remedies())
def test_files_of_a_coarse_mesh_are_cured_by_more_rings(remedy: str, before: int, rings: int) -> None:
    cure = cure_of("CAD files", run(remedy, rings=before))
    assert cure is not None and (cure["do"], cure["content"]) == ("finer", {"rings": rings})


def test_other_verdicts_are_cured_by_what_their_reasons_name() -> None:
    for remedy in ("export again: the mesh is not closed", f"lens.step is right, so {FINER}"):
        again = cure_of("CAD files", run(remedy))
        assert again is not None and again["do"] == "part", "whose mesh is as fine as the light asks"
    smaller = (Change("manufacture.cutter_radius_mm", "0.736"), Change("manufacture.max_tilt_deg", "50"))
    tool = cure_of("Manufacture", run(changes=smaller))
    change = {"place": ["manufacture", "cutter_radius_mm"], "value": {"toml": "0.736"}}
    assert tool is not None and tool["change"] == change and "cutter_radius_mm = 0.736" in tool["words"]
    better = cure_of("Photometry", run(accuracy="standard"))
    assert better is not None and better["content"] == {"accuracy": "reference"}
    assert cure_of("Photometry", run(accuracy="reference")) is None
    assert cure_of("Manufacture", run("a smaller nose")) is None
