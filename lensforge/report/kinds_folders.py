"""Folders of the lenses of several kinds, beside the results of the first: each is a whole result folder of its own.

There the lens of a kind is built, checked and verified as any other. Its light is that of all lamps, its search that of
all lenses, so that both are the first one's.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import TypeVar

from lensforge.proof.casts import verify
from lensforge.report.folder import Run, opened
from lensforge.results import StageResult
from lensforge.scene.lens import Lens

_Result = TypeVar("_Result", bound=StageResult)


def write_kinds(first: Run, timed: Callable[[str], AbstractContextManager[None]]) -> None:
    """Write the folders of all kinds but that of ``first``; ``timed``: told of each by its name."""
    from lensforge.cad.part_export import build_part
    from lensforge.shop.check import check_part

    for lens in first.lens.kinds:
        if lens.kind == first.lens.kind:
            continue
        with timed(lens.kind), opened(first.folder / lens.kind, create=True) as there:
            there.write(_of_lens(first.design, lens).model_copy(update={"lens": lens}))
            light = there.write(_of_lens(first.light, lens))
            there.write(_of_lens(first.photometry, lens))
            part = there.write(build_part(lens))
            there.write(check_part(part))
            there.write(verify(part, light))
            there.write_report()


def _of_lens(result: _Result, lens: Lens) -> _Result:
    """``result``, which is the same for all kinds, as that of ``lens``."""
    same = result.model_copy(update={"inputs": {**result.inputs, "lens": lens.sha256}})
    vars(same).pop("sha256", None)  # that of the first kind
    return same
