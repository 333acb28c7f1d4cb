"""A stage as it is declared, and the verbs on a lens as it is made: ``build``, ``check``, ``photometry``, ``handover``.

Heavy libraries are loaded by the verb that first needs them: torch and numba to trace, the CAD kernel to build.
"""

import datetime
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeVar

from lensforge.cad.part import Part
from lensforge.kernels.parallel import kernel_threads
from lensforge.light.lens_light import judging_source, photometry_conditions
from lensforge.light.photometry_result import Photometry
from lensforge.report.results import Results
from lensforge.results import StageResult
from lensforge.results.arguments import count_of, number_of, require
from lensforge.runs.folder import RunFolder, opened
from lensforge.scene.lens import Lens
from lensforge.shop.check_result import Check
from lensforge.sources.photometric.ies import NEWEST, IesVersion, require_ies_version
from lensforge.spec import DrawingSection
from lensforge.spec.accuracy import preset_of
from lensforge.spec.part_section import read_drawing
from lensforge.spec.spec_section import date_of

if TYPE_CHECKING:
    from lensforge.shop.handover import Handover

Decides = Literal["light", "files", "cutting", ""]
_Result = TypeVar("_Result", bound=StageResult)


@dataclass(frozen=True)
class FolderStage(Generic[_Result]):
    """A stage of a result folder: the verb, what it takes from the folder, and what is written there.

    ``verb``: of the library. ``name``, ``help``, ``options``: of the command; each option is a keyword of the verb.
    ``decides``: part of the verdict by which the command ends well or not. ``inputs``: what the verb takes first, by
    the run and the options. ``settings``: keywords that the folder gives. ``after``: writes further files.
    ``counts``: what the ``progress`` of the verb counts, where it has one.
    """

    name: str
    verb: Callable[..., _Result]
    help: str
    options: tuple[str, ...] = ()
    decides: Decides = ""
    inputs: Callable[[Results, Mapping[str, Any]], tuple[object, ...]] = lambda run, _: (run.lens,)
    settings: Callable[[RunFolder, Mapping[str, Any]], Mapping[str, Any]] = lambda _folder, _options: {}
    after: Callable[[RunFolder, _Result], object] = lambda _folder, _result: None
    counts: str = ""

    def run(self, folder: Path, **options: Any) -> _Result:
        """Run the stage in a result folder, and return what it wrote; ``options``: keywords of the verb."""
        with opened(folder) as here:
            return self.run_in(here, **options)

    def run_in(self, here: RunFolder, **options: Any) -> _Result:
        """Run the stage in a folder that is open already.

        A result under other conditions than the lens's own, such as another source, goes beside the lens's own one.
        """
        inputs, settings = self.inputs(here.run, options), self.settings(here, options)
        result = here.write(self.verb(*inputs, **settings, **options))
        self.after(here, result)
        return result


def build(
    lens: Lens,
    *,
    schema: Literal["AP214", "AP242"] = "AP214",
    runout_deg: float | None = None,
    nodes: int | None = None,
    rings: int | None = None,
    date: datetime.date | str | None = None,
) -> Part:
    """Make the part: one solid as STEP, STL and 3MF, verified by reading them back.

    ``schema``: of the STEP. ``runout_deg``: adds the optical faces untrimmed, extended by this angle beyond the rim.
    ``nodes``: spline nodes across each optical face, ``rings``: rings of the mesh; by default as many as their
    tolerances need. ``date``: of the files, by default that of the spec. Raises :class:`InputError` for a lens whose
    surfaces enclose no body.
    """
    from lensforge.cad.part_export import build_part

    require(lens, Lens, "build")
    runout_deg = number_of("runout_deg", runout_deg)
    return build_part(
        lens,
        schema=schema,
        runout_deg=runout_deg,
        nodes=count_of("nodes", nodes),
        rings=count_of("rings", rings),
        date=date_of("date", date),
    )


def check(part: Part | Lens) -> Check:
    """Check whether ``part`` can be cut, and with which tools: best-fit spheres, curvature, cutter, wall, draft.

    Of a lens the part is checked that an export would make.
    """
    from lensforge.shop.check import check_lens, check_part

    return check_lens(part) if isinstance(part, Lens) else check_part(require(part, Part, "check"))


def photometry(
    lens: Lens,
    *,
    rays: int | None = None,
    lumens: float | None = None,
    threads: int | None = None,
    ies_version: IesVersion = NEWEST,
) -> Photometry:
    """Compute the far field of ``lens`` and make its IES, EULUMDAT, TM-33 and TM-25 files.

    ``lumens``: of the source; default: as spec or file of the source say, or relative to 1000. ``rays``: by default as
    many as the noise of the intensities asks for. Other lumens than the source's own, and any ``rays`` that are given,
    are other ``conditions`` than the lens's own. ``ies_version``: year of LM-63 that the IES file follows, 2019 or, for
    programs that read no newer one, 2002, 1995, 1991 or 1986.
    """
    from lensforge.light.photometry_export import measure_photometry

    require(lens, Lens, "photometry")
    version = require_ies_version(ies_version)
    rays, preset = count_of("rays", rays), preset_of(lens.accuracy)
    lumens, source = number_of("lumens", lumens), judging_source(lens.spec)
    with kernel_threads(count_of("threads", threads)):
        found = measure_photometry(lens, source, preset, rays=rays, lumens=lumens, ies_version=version)
    return found.model_copy(update={"conditions": photometry_conditions(lens, source, rays, lumens)})


def handover(
    run: Results,
    *,
    spacing_mm: float | None = None,
    error_nm: float = 10.0,
    interpolation: Literal["bicubic", "linear"] = "bicubic",
    offset_inner_mm: float = 0.0,
    offset_outer_mm: float = 0.0,
    drawing: DrawingSection | Path | str | None = None,
) -> "Handover":
    """Make the documents for the shop: drawing, verdicts, point tables, hashes; ``save(folder)`` writes them.

    ``drawing``: words of its title block and notes, such as another revision, or a TOML file that has them; None: those
    of the spec.

    ``spacing_mm``: of the dense tables; None: as wide as an ``interpolation`` error of ``error_nm`` along the normal
    allows. ``offset_inner_mm``, ``offset_outer_mm``: radius of a probe or tool whose centres they hold.

    Raises :class:`InputError` where the ball does not fit, or for too many points.
    """
    from lensforge.shop.dense_table import GridRequest
    from lensforge.shop.shop_files import make_handover

    require(run, Results, "handover")
    words = read_drawing(Path(drawing)) if isinstance(drawing, Path | str) else drawing
    request = GridRequest(spacing_mm, error_nm, interpolation, offset_inner_mm, offset_outer_mm)
    return make_handover(run, request, words)
