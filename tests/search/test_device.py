"""A search whose rays are traced in torch on a device is the search by the kernels, to rounding."""

from pathlib import Path

import numpy as np
import pytest
import torch
from presets import FEW
from scenes import DEVICES, small_spec
from test_bodies import COVER, spec_with

from lensforge.errors import InputError
from lensforge.search.checkpoint import CHECKPOINT as FILE_NAME
from lensforge.search.merit import MeritFunction
from lensforge.search.optimiser import search
from lensforge.search.problem import parameters_of
from lensforge.sources.build_source import build_source

CPU = torch.device("cpu")


@pytest.mark.parametrize("device", DEVICES)
def test_a_design_ends_where_the_kernels_end(device: str) -> None:
    double = FEW.replace("double", single=False)
    spec = small_spec(optimise__steps_per_level=[2, 2], optimise__rays=256)
    source = build_source(spec.source)
    kernels, found = (search(spec, source, accuracy=double, device=d) for d in (None, torch.device(device)))
    for one, other in zip(found.history, kernels.history, strict=True):
        assert one.loss == pytest.approx(other.loss, rel=1e-8)
    assert np.allclose(found.lens.outer.weights_mm, kernels.lens.outer.weights_mm, rtol=1e-6, atol=1e-9)


def test_a_checkpoint_is_not_resumed_on_another_device(tmp_path: Path) -> None:
    spec = small_spec(optimise__steps_per_level=[2, 2], optimise__rays=256)
    source = build_source(spec.source)
    search(spec, source, accuracy="draft", checkpoint=tmp_path / FILE_NAME, device=CPU)
    search(spec, source, accuracy="draft", checkpoint=tmp_path / FILE_NAME, device=CPU, resume=True)
    with pytest.raises(InputError, match="start or device"):
        search(spec, source, accuracy="draft", checkpoint=tmp_path / FILE_NAME, resume=True)


@pytest.mark.parametrize("changes", [{"lens": {"kind": "tir"}, "bodies": []}, {"bodies": [COVER]}])
def test_a_device_refuses_what_it_does_not_trace(changes: dict[str, object]) -> None:
    spec = spec_with(**changes)
    with pytest.raises(InputError, match="only a lens of two faces"):
        MeritFunction.of(spec, build_source(spec.source), parameters_of(spec, 2.5), CPU)
