"""The search from hopeless starts: dark receivers, empty masks, clipped sources; refused, or finite numbers."""

import numpy as np
from extremes import fuzzed
from hypothesis import example, given
from hypothesis import strategies as st
from scenes import small_spec

from lensforge.errors import InputError
from lensforge.search.optimiser import search
from lensforge.sources.build_source import SquareEmitter


@fuzzed(5, by_day=2)
@given(
    index=st.sampled_from([1.0, 1.4936, 4.0]),
    side=st.sampled_from([0.0, 1e-9, 1.0, 5.9, 20.0]),
    receiver=st.sampled_from([1e-2, 1.0, 200.0, 1e7]),
    mask=st.sampled_from([1e-3, 0.5, 1.0]),
    pixels=st.sampled_from([4, 5, 16]),
    levels=st.sampled_from([[1], [2, 9]]),
    seed=st.integers(0, 2**20),
)
@example(index=1.4936, side=1.0, receiver=1e-2, mask=0.5, pixels=4, levels=[1], seed=0)  # all dark
@example(index=1.4936, side=0.0, receiver=1e-2, mask=0.5, pixels=4, levels=[1], seed=0)  # but no bound: searched
def test_a_search_from_anywhere_stays_finite(index, side, receiver, mask, pixels, levels, seed) -> None:
    spec = small_spec(
        source={"kind": "square", "side_mm": side},
        lens__refractive_index=index,
        lens__levels=levels,
        target__width_mm=0.8 * receiver,
        target__receiver_mm=receiver,
        target__uniform_mm=mask * receiver,
        optimise={"steps_per_level": [3] * len(levels), "rays": 64, "pixels": pixels},
    )
    found, refused = None, ""
    try:
        found = search(spec, SquareEmitter(side), accuracy="draft", seed=seed)
    except InputError as refusal:
        refused = str(refusal)
    if found is None:
        assert "of the light" in refused, "none in the lens, or a target that no lens can light"
        return
    assert np.isfinite([value for level in found.history for value in level.nmse + level.efficiency]).all()
    own = found.constraints.model_dump().values()
    margins = [each for value in own for each in (value.values() if isinstance(value, dict) else [value])]
    assert np.isfinite([value for value in margins if value is not None]).all()
