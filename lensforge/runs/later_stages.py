"""The stages after a search, in a result folder: side by side where there are two cores, else one after another.

The CAD kernel computes on one core and holds Python's lock. So the part is made in a second process while this one
simulates the light, and is checked there while this one verifies it with the second one's help. Only this one writes.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from lensforge.cad.part import Part
from lensforge.light.evaluation_result import Light
from lensforge.light.photometry_result import Photometry
from lensforge.proof.proof_result import Proof
from lensforge.results.file_bounds import remembered
from lensforge.results.freed_memory import return_freed_memory
from lensforge.results.second_process import SecondProcess, second_process
from lensforge.runs import stages
from lensforge.runs.arguments import threads_of_torch
from lensforge.runs.cast_stages import verify, verify_with
from lensforge.runs.run_folder import write_result
from lensforge.scene.lens import load_lens
from lensforge.shop.check_result import Check
from lensforge.surfaces.imported_face import LENS_FILE

Announce = Callable[[str], None]
Ended = Callable[[str, float], None]


@dataclass(frozen=True)
class Told:
    """Functions that are told of the stages: ``begins`` gets a stage's name, ``ended`` its name and seconds."""

    begins: Announce
    ended: Ended

    @contextmanager
    def timed(self, name: str) -> Iterator[None]:
        """Tell of a stage that takes the time of the block."""
        self.begins(name)
        started = time.perf_counter()
        yield
        self.ended(name, time.perf_counter() - started)


@contextmanager
def process_for_later_stages() -> Iterator[SecondProcess]:
    """A second process where there are two cores, which loads the CAD kernel while this one searches."""
    import torch

    with second_process(torch.get_num_threads() > 1) as second:
        if second.runs:
            second.call(_load_cad_kernel)
        yield second


def _load_cad_kernel() -> None:
    import cadquery  # noqa: F401  two seconds

    import lensforge.cad.part_export  # noqa: F401


def run_later_stages(folder: Path, told: Told, second: SecondProcess) -> None:
    """Evaluate, export, check, verify and photometry of the lens in ``folder``; the same bits on one core or more."""
    import torch

    return_freed_memory()  # of the search: two processes are to need no more than one did
    if second.runs:
        with threads_of_torch(max(1, torch.get_num_threads() - 1)):
            _side_by_side(folder, second, told)
    else:
        _one_after_another(folder, told)


def _one_after_another(folder: Path, told: Told) -> None:
    lens = load_lens(folder / LENS_FILE)
    with told.timed(Light.stage):
        light = write_result(stages.evaluate(lens), folder)
    with told.timed(Part.stage):
        part = write_result(stages.build(lens), folder)
    with told.timed(Check.stage):
        write_result(stages.check(part), folder)
    with told.timed(Proof.stage):
        write_result(verify(part, light), folder)
    with told.timed(Photometry.stage):
        write_result(stages.photometry(lens), folder)


def _side_by_side(folder: Path, second: SecondProcess, told: Told) -> None:
    """Run the stages with a second process, which has the part to make and to check, and then a share of verify."""
    from lensforge.shop.check import check_lens

    lens = load_lens(folder / LENS_FILE)
    made = second.call(stages.build, lens)
    checked = second.call_after(made, lambda part: (lens, part.nodes), check_lens)
    told.begins(Part.stage)
    with told.timed(Light.stage):
        light = write_result(stages.evaluate(lens), folder)
    with told.timed(Photometry.stage):
        write_result(stages.photometry(lens), folder)
    return_freed_memory()
    part = made.result()
    for content in (part.step, part.stl, part.threemf):
        remembered(content)  # this program made them, if not this process
    write_result(part, folder)
    told.ended(Part.stage, part.seconds)
    told.begins(Check.stage)
    with told.timed(Proof.stage):
        proof = verify_with(second, part, light)
        check = write_result(checked.result(), folder)
        told.ended(Check.stage, check.seconds)
        write_result(proof, folder)
