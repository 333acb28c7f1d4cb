"""Rays through the STEP file: the CAD kernel intersects the exported body face by face, without triangles.

Errors from the flat facets of the mesh must vanish here.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Int

from lensforge.optics.media import Media
from lensforge.proof.acceptance import BREP_RAYS
from lensforge.proof.cast_results import BrepCast, Gaps
from lensforge.proof.file_form import DesignedFile, FileForm
from lensforge.proof.optical_faces import USUAL_LENS, OpticalFaces
from lensforge.proof.part_comparison import Expected, compare, drawn, gap_quantiles
from lensforge.proof.sequential_cast import Passage, send_through_body
from lensforge.results import BodySize
from lensforge.results.child_pool import IN_TURN, ChildPool
from lensforge.sources.ray_bundle import RayBundle

if TYPE_CHECKING:
    from lensforge.proof.step_body import StepBody


@dataclass(frozen=True)
class StepCast:
    """Some rays' ``passage`` through a STEP file, the ``seconds`` that it took; ``size`` and ``form`` if asked.

    ``rows``: numbers of the rays.
    """

    rows: Int[np.ndarray, " k"]
    passage: Passage
    seconds: float
    size: BodySize | None
    form: FileForm | None


def cast_step(
    step: "bytes | StepBody",
    rays: RayBundle,
    media: Media,
    count: int = BREP_RAYS,
    *,
    optical: OpticalFaces = USUAL_LENS,
    sized: bool = False,
    designed: DesignedFile | None = None,
    second: ChildPool = IN_TURN,
) -> Callable[[], StepCast]:
    """Begin to cast ``count`` of ``rays``, drawn at random, through a STEP file; ``sized``: measure its body, too.

    ``designed``: what its form is compared with. ``optical``: the faces of a body that is not read yet. Runs in
    ``second``, if given; the returned function waits for it.
    """
    rows = drawn(count, len(rays))
    cast = second.call(_cast_and_measure, step, rays.take(rows), media, optical, sized, designed)
    return lambda: StepCast(rows, *cast.result())


def read_step(step: bytes, optical: OpticalFaces) -> "StepBody":
    """The body in the bytes of a STEP file; the CAD kernel is loaded here."""
    from lensforge.proof.step_body import StepBody

    return StepBody(step, optical)


def form_of_step(file: DesignedFile) -> FileForm:
    """Form of the body, or of the loose faces, in a STEP file."""
    from lensforge.proof.step_body import form_in_step

    return form_in_step(file)


def _cast_and_measure(
    step: "bytes | StepBody",
    rays: RayBundle,
    media: Media,
    optical: OpticalFaces,
    sized: bool,
    designed: DesignedFile | None,
) -> tuple[Passage, float, BodySize | None, FileForm | None]:
    body = read_step(step, optical) if isinstance(step, bytes) else step
    start = perf_counter()
    passage = send_through_body(body, rays, media)
    seconds = perf_counter() - start
    return passage, seconds, body.size() if sized else None, None if designed is None else body.form(designed)


def judge_brep(
    cast: StepCast, rays: RayBundle, expected: Sequence[Expected], mesh: Passage
) -> list[tuple[BrepCast, Gaps]]:
    """Landings of a cast through the STEP file on each screen against the design's and the mesh's; gaps (mm).

    ``rays``, ``expected`` and ``mesh`` hold all rays; the quantiles of the gaps are from the design.
    """
    rows = cast.rows
    judged = []
    some = rays.take(rows)
    for receiver in expected:
        landed = cast.passage.landed(receiver.screen)
        by_mesh = mesh.landed(receiver.screen)
        design = receiver.take(rows)
        names = by_mesh.fate_names[rows]
        met = None if receiver.met is None else by_mesh.met[rows]
        reference = Expected(
            receiver.screen, receiver.irradiance, by_mesh.landings[rows], by_mesh.flux[rows], names, met
        )
        agreements = [compare(some, landed, other) for other in (design, reference)]
        agreed = BrepCast(
            rays=len(rows), seconds=cast.seconds, against_design=agreements[0], against_mesh=agreements[1]
        )
        judged.append((agreed, gap_quantiles(landed, design)))
    return judged
