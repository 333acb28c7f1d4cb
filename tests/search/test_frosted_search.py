"""A search for a lens that scatters: from the polished one on, and never worse than that."""

from dataclasses import replace
from pathlib import Path

import pytest
from presets import FAR
from scenes import small_spec
from search_scenes import Stop

import lensforge as lf
from lensforge.search.checkpoint import delete_checkpoint
from lensforge.search.design_result import Progress
from lensforge.search.optimiser import search
from lensforge.search.searches_in_turn import search_in_turn, with_half_of_the_time
from lensforge.sources.build_source import build_source
from lensforge.spec.polished_faces import frosted_as, polished, scatters_about_the_light

FROST = {"kind": "gaussian", "sigma_deg": 3.0}
_SEARCH = {"lens__levels": [9], "optimise__steps_per_level": [12], "optimise__rays": 2048, "target__uniform_mm": None}
SPEC = small_spec(lens__outer__scatter=FROST, **_SEARCH)


def test_a_frosted_search_goes_on_from_the_polished_lens(tmp_path: Path) -> None:
    """Interrupted when frosted, it goes on to the same bits; its observer sees frosted lenses from the first step."""
    source = build_source(SPEC.source, facets=1)
    path = tmp_path / "search.bin"
    heard = list[Progress]()

    def stop(now: Progress) -> None:
        heard.append(now)
        if now.steps_done == 20:
            raise Stop

    with pytest.raises(Stop):
        search_in_turn(SPEC, source, accuracy=FAR, checkpoint=path, progress=stop)
    assert [now.steps_done for now in heard] == list(range(1, 21))
    assert [now.steps_total for now in heard] == [12] * 12 + [24] * 8
    assert {now.lens().spec.lens.outer.scatter for now in heard} == {SPEC.lens.outer.scatter}
    result = search_in_turn(SPEC, source, accuracy=FAR, checkpoint=path, resume=True)
    assert search_in_turn(SPEC, source, accuracy=FAR).lens.sha256 == result.lens.sha256
    assert (result.steps, [level.level for level in result.history], result.lens.spec) == (24, [0, 1], SPEC)
    delete_checkpoint(path)
    assert not list(tmp_path.iterdir())


def test_a_frosted_lens_is_better_than_the_polished_one_frosted_afterwards() -> None:
    """And than that of as many steps from the first faces on, which has the error of the frosted one."""
    source = build_source(SPEC.source, facets=1)
    clear = search(polished(SPEC), source, accuracy=FAR).lens
    at_once = search(SPEC.replace({"optimise.steps_per_level": [24]}), source, accuracy=FAR).lens
    frosted = search_in_turn(SPEC, source, accuracy=FAR).lens
    now, afterwards, before = (lf.evaluate(lens, rays=2**15) for lens in (frosted, replace(clear, spec=SPEC), at_once))
    for other in (afterwards, before):
        assert now.nmse.value < 0.93 * other.nmse.value
        assert now.efficiency.value > other.efficiency.value + 0.005


def test_an_opal_lens_is_searched_at_once_and_half_of_a_time_is_for_the_polished_lens() -> None:
    opal = {"kind": "lambertian", "share": 0.1}
    assert [scatters_about_the_light(small_spec(lens__outer__scatter=kind)) for kind in (opal, FROST)] == [False, True]
    assert not scatters_about_the_light(small_spec(lens__inner__scatter=FROST, lens__outer__scatter=opal))
    timed = small_spec(lens__levels="auto", optimise={"seconds": 60.0})
    assert (with_half_of_the_time(timed).optimise.seconds, with_half_of_the_time(SPEC)) == (30.0, SPEC)


def test_a_cover_is_polished_and_frosted_again_with_its_limit_on_luminance() -> None:
    seen = {"kind": "luminance", "eyes_deg": [(0.0, 0.0)], "spot_mm": 2.0, "at_most": 1e6, "unit": "cd_per_m2"}
    spot = {"kind": "points", "at_mm": [(0.0, 0.0)], "at_least": 0.1, "unit": "w_per_m2"}
    shell = {"kind": "sphere", "radius_mm": 30.0}
    frosted = {"fixed": {**shell, "radius_mm": 32.0}, "scatter": FROST}
    cover = {"name": "cover", "refractive_index": 1.5, "inner": {"fixed": shell}, "outer": frosted}
    spec = small_spec(bodies=[cover], limits=[spot, seen])
    clear = polished(spec)
    assert scatters_about_the_light(spec) and not scatters_about_the_light(clear)
    assert (clear.bodies[0].outer.scatter, clear.bodies[0].outer.fixed.radius_mm) == (None, 32.0)
    assert [limit.kind for limit in clear.limits] == ["points"]
    assert frosted_as(clear, spec) == spec
