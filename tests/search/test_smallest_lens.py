"""The smallest lens that holds its limits: sizes against closed forms, lenses against a scan by hand."""

import math
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from presets import FEW
from scenes import small_spec
from tir_lenses import SPOT, wall_not_measured

import lensforge as lf
from lensforge.errors import InputError
from lensforge.light.lens_light import searched_source
from lensforge.report.tradeoff_study import require_same_scene
from lensforge.search.checkpoint import MOST_SIZES, delete_checkpoint, of_later_size
from lensforge.search.design_result import ENOUGH, Design, Start, TriedSize, design_facts
from lensforge.search.smallest_lens import next_size
from lensforge.spec import Spec, parse_spec

STEP = 0.02
COARSE = FEW.replace("few_sizes", effort={"size_step": 0.08})
# Its LED is off the axis and leans, and is longer than wide; of two limits the second one decides.
CROOKED = {
    **SPOT,
    "source": {
        "kind": "rectangle", "width_mm": 0.7, "height_mm": 1.1, "position_mm": [0.2, -0.1, 0.0], "tilt_deg": [4, -3],
    },
    "optimise": {"aim": "size", "size": "radius", "steps_per_level": [3], "rays": 1024},
    "evaluate": {"rays": 2**15},
    "limits": [
        {"kind": "zone", "zone": {"kind": "disc", "diameter_deg": 50.0}, "at_least_share": 0.5},
        {"kind": "zone", "zone": {"kind": "disc", "diameter_deg": 20.0}, "at_least_share": 0.7},
    ],
}  # fmt: skip


def sizes_by(margin: Callable[[float], float | None], most_mm: float, step: float = STEP) -> list[TriedSize]:
    """The sizes that are tried where a lens within each has this margin; None: no lens has room."""
    tried: list[TriedSize] = []
    size_mm: float | None = most_mm
    while size_mm is not None and len(tried) < MOST_SIZES:
        value = margin(size_mm)
        own_mm = None if value is None else 0.999 * size_mm
        tried.append(
            TriedSize(within_mm=size_mm, holds=value is not None and value > 0.0, size_mm=own_mm, margin=value)
        )
        size_mm = next_size(tried, step)
    return tried


@pytest.mark.parametrize(
    ("margin", "most_mm", "least_mm"),
    [
        (lambda size: 0.3 * math.log(size / 7.31), 9.0, 7.31),
        (lambda size: 1.0 - (3.7 / size) ** 2, 15.0, 3.7),
        (lambda size: 0.05 * (1.0 - math.exp(-(size - 8.4) / 0.05)) if size > 8.0 else -1.0, 9.0, 8.4),
        (lambda size: 0.01 if size > 6.2 else -0.3, 9.0, 6.2),  # another start below
        (lambda size: 0.01 if size > 6.2 else None, 9.0, 6.2),  # no room below
        (lambda size: 0.3 * math.log(size / 8.99), 9.0, 8.99),
        (lambda size: 0.3 * math.log(size / 0.4), 9.0, 0.4),
    ],
    ids=["even", "étendue", "steep", "a jump", "no room", "at the largest", "far below"],
)
def test_the_least_size_is_found_to_the_stated_share(
    margin: Callable[[float], float | None], most_mm: float, least_mm: float
) -> None:
    tried = sizes_by(margin, most_mm)
    held = min(size.within_mm for size in tried if size.holds)
    failed = max(size.within_mm for size in tried if not size.holds)
    assert held > least_mm > failed, "both sides of the bound are tried"
    assert held / failed < 1.0 + STEP + 0.0015, "lenses are 0.001 smaller than what they are within"
    assert len(tried) <= 11


def test_light_that_even_the_largest_lens_lacks_ends_the_search_at_once() -> None:
    assert len(sizes_by(lambda _: -0.1, 9.0)) == 1


def crooked(**changes: Any) -> Spec:
    return parse_spec(CROOKED, "crooked").replace(changes)


@cache
def smallest() -> tuple[Design, list[str]]:
    """The smallest lens of the crooked scene, and what its observer heard."""
    heard: list[str] = []
    with wall_not_measured():
        design = lf.design(
            crooked(), accuracy=COARSE, warn=lambda _: None, progress=lambda step: heard.append(step.within)
        )
    return design, heard


def light_by_hand(radius_mm: float) -> lf.Light:
    """Light of the lens that a user finds who writes the radius into the spec."""
    spec = crooked(**{"optimise.aim": "share", "constraints.max_radius_mm": radius_mm})
    with wall_not_measured():
        return lf.evaluate(lf.design(spec, accuracy=COARSE, warn=lambda _: None).lens, seed=99)


def test_the_lens_holds_all_limits_and_one_a_step_smaller_does_not() -> None:
    """Against searches by hand within two radii."""
    design, _ = smallest()
    held = min((size for size in design.sizes if size.holds), key=lambda size: size.within_mm)
    failed = max((size for size in design.sizes if not size.holds), key=lambda size: size.within_mm)
    assert 1.0 < held.within_mm / failed.within_mm < 1.09
    assert failed.within_mm < design.max_radius_mm == held.size_mm == design.least_mm < held.within_mm
    assert design.lens.spec.constraints.max_radius_mm == held.within_mm < 8.0
    inside = light_by_hand(held.within_mm)
    assert [limit.state for limit in inside.limits] == ["pass", "pass"]
    assert inside.limits[1].value == pytest.approx(0.7 * (1.0 + held.margin), abs=5e-3)
    assert light_by_hand(failed.within_mm).limits[1].state == "fail"


def test_every_search_is_told_by_its_size_and_all_count() -> None:
    design, heard = smallest()
    within = list(dict.fromkeys(heard))
    with_room = [size for size in design.sizes if not size.why]
    assert within == [f"radius {size.within_mm:.4g} mm" for size in with_room] and len(with_room) < len(design.sizes)
    assert design.steps == 3 and len(heard) == 3 * len(within)


def test_the_record_keeps_the_sizes_and_states_the_least(tmp_path: Path) -> None:
    design, _ = smallest()
    design.lens.save(tmp_path / "lens.json")
    design.write(tmp_path)
    assert lf.load(tmp_path).design == design
    fact = next(fact for group in design_facts(design) for fact in group.facts if fact.key == "least_size")
    assert (fact.label, fact.value, fact.unit) == ("Least size", design.max_radius_mm, "mm")
    assert f"by {len(design.sizes)} searches" in fact.note


def test_its_scene_is_that_of_the_spec_but_for_the_size_that_was_sought() -> None:
    design, _ = smallest()
    require_same_scene(design.lens, crooked(), searched_source(crooked()), "tradeoff")
    other = crooked(**{"constraints.max_height_mm": 30.0})
    with pytest.raises(InputError, match=r"designed for another \[constraints\]"):
        require_same_scene(design.lens, other, searched_source(other), "tradeoff")


def test_without_room_for_the_limits_the_largest_lens_is_the_result() -> None:
    spec = crooked(limits=[{**CROOKED["limits"][1], "at_least_share": 0.91}])
    with wall_not_measured():
        design = lf.design(spec, accuracy=COARSE, warn=lambda _: None, force=True)
    assert [size.holds for size in design.sizes] == [False] and design.least_mm is None
    fact = next(fact for group in design_facts(design) for fact in group.facts if fact.key == "least_size")
    assert fact.note == "radius, by one search; no lens within 8 mm holds all limits"


def test_an_observer_that_has_enough_ends_all_searches() -> None:
    with wall_not_measured():
        design = lf.design(crooked(), accuracy=COARSE, warn=lambda _: None, progress=lambda _: ENOUGH)
    assert len(design.sizes) == 1


def test_checkpoints_of_all_sizes_are_deleted_together(tmp_path: Path) -> None:
    first = tmp_path / "checkpoint.bin"
    paths = [of_later_size(first, number) for number in range(MOST_SIZES)]
    assert len({*paths}) == MOST_SIZES and paths[0] == first
    for path in paths:
        path.write_bytes(b"")
    delete_checkpoint(first)
    assert not list(tmp_path.iterdir())


def kept_search(folder: Path, progress: Any = None) -> Design:
    """The search with its checkpoints in ``folder``, from which it goes on."""
    with wall_not_measured():
        return lf.design(
            crooked(), accuracy=COARSE, warn=lambda _: None, checkpoint=folder / "state.bin", progress=progress
        )


@cache
def interrupted_in_the_second() -> dict[str, bytes]:
    """Checkpoints by name of a search that was stopped in its second size that has room, after one step."""
    stops = list(dict.fromkeys(smallest()[1]))[1]
    with TemporaryDirectory() as folder:
        with pytest.raises(lf.Cancelled):
            kept_search(Path(folder), progress=lambda now: now.within != stops)
        return {path.name: path.read_bytes() for path in Path(folder).iterdir()}


def kept_in(folder: Path, states: Mapping[str, bytes]) -> list[str]:
    """Names of the checkpoints that are written into ``folder``, by age."""
    for name, content in states.items():
        (folder / name).write_bytes(content)
    return sorted(states, key=len)


def test_an_interrupted_search_ends_as_one_that_was_not(tmp_path: Path) -> None:
    """To the same bits, of every size that was tried; sizes that are done take no step again, the next one the rest."""
    design, heard = smallest()
    _, second, *later = dict.fromkeys(heard)
    number = next(number for number, size in enumerate(design.sizes) if second == f"radius {size.within_mm:.4g} mm")
    assert kept_in(tmp_path, interrupted_in_the_second()) == ["state.bin", f"state_size_{number}.bin"]
    again: list[tuple[str, int]] = []
    end = kept_search(tmp_path, progress=lambda now: again.append((now.within, now.steps_done)))
    assert end.lens.sha256 == design.lens.sha256
    assert end.sizes == design.sizes and end.history == design.history and end.steps == design.steps
    steps = [(within, 3 * place + step) for place, within in enumerate((second, *later), 1) for step in (1, 2, 3)]
    assert again == steps[1:], "the first step of the second is in its state"


def test_a_damaged_checkpoint_of_a_later_size_is_no_size_without_room(tmp_path: Path) -> None:
    *_, last = kept_in(tmp_path, interrupted_in_the_second())
    (tmp_path / last).write_bytes((tmp_path / last).read_bytes()[:-1])
    with pytest.raises(InputError, match=rf"{last}: damaged checkpoint; delete it"):
        kept_search(tmp_path)


def test_a_checkpoint_that_cannot_be_written_ends_the_search(tmp_path: Path) -> None:
    """From the second size on: a folder has its name."""

    def in_the_way(_: lf.Progress) -> None:
        for number in range(1, MOST_SIZES):
            of_later_size(tmp_path / "state.bin", number).mkdir(exist_ok=True)

    with pytest.raises(InputError, match=r"state_size_\d+\.bin: cannot be replaced"):
        kept_search(tmp_path, progress=in_the_way)


def test_of_several_starts_the_smallest_lens_is_the_best() -> None:
    light = lf.Metric(value=0.1)
    figures = {"seed": 0, "nmse": light, "efficiency": light, "seconds": 0.0, "missed": 0}
    small, large = (Start(merit=merit, size_mm=size, **figures) for merit, size in ((2.0, 7.0), (1.0, 7.1)))
    assert small.rank < large.rank


def test_a_height_that_is_not_given_begins_with_that_of_the_first_lens() -> None:
    """Of two faces; the second search has a bound, and heard of it."""
    heard: list[str] = []
    zone = {"kind": "zone", "zone": {"kind": "disc", "diameter_mm": 90.0}, "at_least_share": 0.05}
    optimise = {"aim": "size", "size": "height", "steps_per_level": [1], "rays": 256}
    spec = small_spec(optimise=optimise, limits=[zone], lens__levels=[9], evaluate={"rays": 2**12})

    def until_the_second(now: lf.Progress) -> object:
        heard.append(now.within)
        return ENOUGH if now.within else None

    design = lf.design(spec, accuracy=COARSE, warn=lambda _: None, progress=until_the_second, force=True)
    first, second = design.sizes
    assert first.within_mm == first.size_mm and second.within_mm == pytest.approx(0.8 * first.size_mm)
    assert heard == ["", f"height {second.within_mm:.4g} mm"]
    assert first.holds and (design.height_mm == second.size_mm) == second.holds


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"limits": ()}, r'optimise\.aim = "size" is for the smallest lens that holds limits, and there are none'),
        ({"optimise.robust": "yield"}, r'optimise\.robust = .yield. does not go with aim = "size"'),
        ({"optimise.size": "weight"}, r"optimise\.size"),
    ],
)
def test_what_the_smallest_lens_cannot_be_is_refused_in_one_line(changes: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        crooked(**changes)
