"""The verbs on parts that are to be made: ``sensitivity`` and ``tolerance``."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from lensforge import seeds
from lensforge.light.lens_light import judging_source, rays_of, unless_default
from lensforge.made.tolerance_result import MOST_PARTS, Sensitivity, Yield
from lensforge.public import public
from lensforge.results import Conditions
from lensforge.results.arguments import count_of, path_of, require, threads_of_torch, with_known_names
from lensforge.results.cluster import connected
from lensforge.scene.lens import Lens
from lensforge.spec.accuracy import preset_of
from lensforge.spec.spec_files import section_sha256
from lensforge.spec.tolerances_section import PartTolerances, TolerancesSection, read_tolerances

_LEAST_PARTS = 40  # two in each block by which the shares of the variance have their errors


@public
@with_known_names
def sensitivity(
    lens: Lens,
    *,
    rays: int | None = None,
    threads: int | None = None,
    progress: Callable[[int, int], object] | None = None,
) -> Sensitivity:
    """Compute the effect of each tolerance of the spec, alone and at its end, on the light of a lens.

    Args:
        lens: the lens.
        rays: number of rays of each case, from 1; None: the preset's.
        threads: number of threads, from 1; None: all cores.
        progress: called with the number of lenses traced and of all.
    Returns: A row for each tolerance; of several LEDs with each.
    Raises: :class:`InputError` for an argument that is not allowed.
    Example:
        >>> study = lf.sensitivity(lf.load("cad_out/quickstart").lens, rays=2**12)
        >>> study.save("sensitivity.png")
    """
    from lensforge.made.sensitivity import measure_sensitivity

    require(lens, Lens, "sensitivity")
    usual = preset_of(lens.accuracy).studies.sensitivity_rays
    count, conditions = rays_of(count_of("rays", rays), usual, judging_source(lens.spec))
    with threads_of_torch(threads):
        result = measure_sensitivity(lens, rays=count, progress=progress)
    return result.changed(conditions=conditions)


@public
@with_known_names
def tolerance(
    lens: Lens,
    *,
    parts: int = 1000,
    rays: int | None = None,
    seed: int = 0,
    tolerances: TolerancesSection | Path | str | None = None,
    budget: bool = True,
    checkpoint: Path | str | None = None,
    threads: int | None = None,
    scheduler: str | None = None,
    progress: Callable[[int, int], object] | None = None,
    announce: Callable[[str], None] | None = None,
) -> Yield:
    """Draw parts from the tolerances of a lens: the share that passes, the spread of the light, its causes.

    Args:
        lens: the lens.
        parts: number of parts, 40 to 100,000.
        rays: of each part, from 1; None: as many as keep its error below a tenth of the spread over the parts.
        seed: of the parts, from 0.
        tolerances: in the place of the spec's: a :class:`PartTolerances`, the name of a preset, or a TOML file.
        budget: also search for the largest amount of each tolerance.
        checkpoint: file of measured parts, with which an interrupted study goes on to the same bits.
        threads: number of threads, from 1; None: all cores.
        scheduler: address of a Dask cluster, "tcp://10.0.0.5:8786", or "local:4" for processes here; the same bits.
        progress: called with the number of parts measured and of all, in each stage; cancels by returning False.
        announce: called with a line on the cluster.
    Returns: The study: ``pass_rate``, the ``variance`` by cause, the ``table`` of all parts.
    Raises: :class:`InputError` for tolerances that the part cannot bear, and where no scheduler answers.
        :class:`Cancelled`: ``progress`` returned False.
    Example:
        >>> study = lf.tolerance(lf.load("cad_out/quickstart").lens, parts=40, rays=512, budget=False)
        >>> print(study.pass_rate)
        >>> study.save("parts.csv")
    """
    from lensforge.made.yield_study import measure_yield

    require(lens, Lens, "tolerance")
    if isinstance(tolerances, Path | str):
        tolerances = read_tolerances(str(tolerances), lens.spec.lens.roles)
    elif tolerances is not None:
        require(tolerances, TolerancesSection, "tolerance")
        faces = tolerances.faces if isinstance(tolerances, PartTolerances) else {}
        tolerances = PartTolerances.of(tolerances, faces, lens.spec.lens.roles)
    parts = count_of("parts", parts, least=_LEAST_PARTS, most=MOST_PARTS) or parts
    count = count_of("rays", rays)
    seed = count_of("seed", seed, least=0, most=seeds.MOST) or 0
    own_tolerances = tolerances if tolerances is not None and tolerances != lens.spec.part_tolerances else None
    drawn = lens if own_tolerances is None else replace(lens, spec=lens.spec.with_tolerances(own_tolerances))
    with threads_of_torch(threads), connected(scheduler) as workers:
        study = measure_yield(
            drawn,
            parts=parts,
            rays=count,
            seed=seed,
            with_budget=budget,
            workers=None if scheduler is None else workers,
            file=path_of("checkpoint", checkpoint),
            progress=progress,
            announce=announce,
        )
    conditions = Conditions.of(
        tolerances=None if own_tolerances is None else _name_of(own_tolerances),
        tolerances_sha256=None if own_tolerances is None else section_sha256(own_tolerances),
        seed=unless_default(seed, 0),
    )
    return study.changed(inputs={"lens": lens.sha256}, conditions=conditions)


def _name_of(tolerances: PartTolerances) -> str:
    """Name of a preset, or a unique name for any other section: no study replaces another."""
    if tolerances == PartTolerances(preset=tolerances.preset, roles=tolerances.roles):
        return tolerances.preset
    return f"own_{section_sha256(tolerances)[:8]}"
