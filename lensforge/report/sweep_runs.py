"""The designs of a sweep, each in its own folder, here or on the workers of a cluster.

``sweep.json`` is written after every design, so that an interrupted sweep continues after the last finished one, and
within a design from its checkpoint.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lensforge.errors import InputError
from lensforge.light.evaluation_result import MetricName
from lensforge.light.lens_light import is_same_source
from lensforge.report import pipeline
from lensforge.report.compare import ComparedPictures
from lensforge.report.page import picture, template, write_page
from lensforge.report.results import Results
from lensforge.report.stored import load_kinds, load_results
from lensforge.report.sweep import Sweep, sweep_of
from lensforge.report.variation import AnyVariation, SourceVariation, Variant
from lensforge.results import Group
from lensforge.results.cluster import connected
from lensforge.results.figure_style import BLUE, GREEN, GREY, ORANGE, WIDE, in_report_style, new_figure
from lensforge.results.files import require_own, write_file
from lensforge.results.folder_lock import locked
from lensforge.scene.lens import load_lens
from lensforge.search.checkpoint import CHECKPOINT, is_checkpoint
from lensforge.spec import AnyAccuracy, Spec
from lensforge.spec.spec_files import section_sha256
from lensforge.surfaces.imported_face import LENS_FILE
from lensforge.version import __version__

Files = Mapping[str, bytes]
Made = tuple[Variant, str]  # a design that is in its folder, and the reason where there is none


def files_of_run(options: Mapping[str, Any], spec: Spec) -> Files | str:
    """Make one design in a folder of the worker: its files by their paths in it, or why it cannot be made.

    Lenses of several kinds have a folder each in it.
    """
    with TemporaryDirectory(prefix="lensforge_") as name:
        folder = Path(name) / spec.name
        try:
            pipeline.run(spec, folder, **options, warn=lambda _: None)
        except InputError as error:
            return str(error)
        files = (path for path in sorted(folder.rglob("*")) if path.is_file() and not path.name.startswith("."))
        return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def write_run(files: Files, folder: Path) -> None:
    """Write the files of a run into its folder, those last that name the hashes of others."""
    with locked(folder, create=True):
        for name in sorted(files, key=lambda name: (name.endswith("run.json"), name.endswith(".json"))):
            write_file(folder / name, files[name])


PAGE = "sweep.html"
TABLE = "sweep.csv"


# A run of every stage: of a spec, into a folder, and True to continue from the checkpoint there.
RunDesign = Callable[[Spec, Path, bool], object]


def run_sweep(
    spec: Spec,
    variation: AnyVariation,
    directory: Path,
    run_design: RunDesign,
    *,
    accuracy: AnyAccuracy = "standard",
    seed: int = 0,
    resume: bool = False,
    scheduler: str | None = None,
    announce: Callable[[str], None] = lambda _: None,
    **further: Any,
) -> Sweep:
    """Make every design of ``variation`` in ``directory``; write sweep.json, .csv and .html; return the sweep.

    ``accuracy`` and ``seed``: those that ``run_design`` uses. ``scheduler``: a Dask cluster, whose workers then make
    whole runs in its place, several at once, without checkpoints; ``further``: other keywords of these runs. With
    ``resume`` designs that sweep.json lists are kept, whatever the values are now. A design that misses a criterion, or
    that cannot be made, is listed with the reason, and the sweep continues. Raises :class:`InputError` before the first
    design for a value that the spec cannot have, for a sweep.json of another sweep, for a page of another program, and
    where another process writes in ``directory``; and where no design could be made.
    """
    variants = variation.variants(spec)
    require_own(directory / PAGE)
    with locked(directory, create=True):
        sweep = _finished(directory, spec, variation, accuracy, seed) if resume else None
        wanted = [variant for variant in variants if sweep is None or variant.value not in sweep.values]
        _require_other_folders(wanted, sweep)

        def tell(number: int, variant: Variant) -> None:
            announce(f"design {number} of {len(wanted)}: {variation.field} = {variant.text}")

        if scheduler is None:
            made = _one_by_one(wanted, directory, run_design, resume, tell)
            return _joined(spec, variation, made, directory, sweep)
        options = {**further, "accuracy": accuracy, "seed": seed}
        specs = [variant.spec for variant in wanted]
        with connected(scheduler) as workers:
            made = _written(wanted, directory, workers.map(files_of_run, options, specs), tell)
            return _joined(spec, variation, made, directory, sweep)


def _require_other_folders(wanted: Sequence[Variant], sweep: Sweep | None) -> None:
    """Raise :class:`InputError` where a design would replace one of another value that an earlier call finished."""
    finished = {} if sweep is None else {row.folder.casefold(): row for row in sweep.designs}
    for variant in wanted:
        row = finished.get(variant.folder)
        if row is not None:
            raise InputError(
                f"{row.folder}: holds the design of {row.value}, that of {variant.value} would go there, too; give "
                "another folder, or start again without resume"
            )


def resumable(directory: Path) -> bool:
    """True where an interrupted sweep in ``directory`` can be resumed: a design is finished, or was begun."""
    if (directory / f"{Sweep.stage}.json").is_file():
        return True
    return any(is_checkpoint(checkpoint) for checkpoint in directory.glob(f"*/{CHECKPOINT}"))


def _one_by_one(
    wanted: Sequence[Variant],
    directory: Path,
    run_design: RunDesign,
    resume: bool,
    tell: Callable[[int, Variant], None],
) -> Iterator[Made]:
    """Make every design here; each as soon as its folder is finished, or as it fails."""
    for number, variant in enumerate(wanted, start=1):
        tell(number, variant)
        folder = directory / variant.spec.name
        why = ""
        try:
            run_design(variant.spec, folder, resume and (folder / CHECKPOINT).exists())
        except InputError as error:
            why = str(error)
        yield variant, why


def _written(
    wanted: Sequence[Variant],
    directory: Path,
    answers: Iterator[tuple[int, Files | str]],
    tell: Callable[[int, Variant], None],
) -> Iterator[Made]:
    """Write the folder of each design as it comes from the workers of a cluster."""
    for done, (number, files) in enumerate(answers, start=1):
        if not isinstance(files, str):
            write_run(files, directory / wanted[number].spec.name)
        tell(done, wanted[number])
        yield wanted[number], files if isinstance(files, str) else ""


def _joined(spec: Spec, variation: AnyVariation, made: Iterator[Made], directory: Path, sweep: Sweep | None) -> Sweep:
    """The sweep with every design that is ``made``, written after each. Raises :class:`InputError` where none is."""
    failed: dict[str, str] = {}
    for variant, why in made:
        if why:
            failed[variant.text] = why
            continue
        part = sweep_of(spec, variation, [(variant, load_kinds(directory / variant.spec.name))])
        sweep = part if sweep is None else sweep.joined(part)
        sweep.write(directory)
    if sweep is None:
        raise InputError(next(iter(failed.values())))
    if not variation.is_numeric:  # workers end in any order
        order = [variant.value for variant in variation.variants(spec)]
        rows = sorted(sweep.designs, key=lambda row: order.index(row.value) if row.value in order else -1)
        sweep = sweep.changed(designs=tuple(rows))
    sweep = sweep.changed(failed=failed)
    sweep.write(directory)
    sweep.save(directory / TABLE)
    results = [load_results(directory / row.folder) for row in sweep.designs]
    write_page(sweep_page(sweep, results), directory / PAGE)
    return sweep


def _finished(directory: Path, spec: Spec, variation: AnyVariation, accuracy: AnyAccuracy, seed: int) -> Sweep | None:
    """The designs that an earlier call finished, None without any. Only its values may differ from this call's.

    Raises :class:`InputError` where anything else differs, the content of a file too, and where the folder of one of
    the designs holds another lens now.
    """
    path = directory / f"{Sweep.stage}.json"
    if not path.exists():
        return None
    sweep = Sweep.read(directory)
    for field, stored, wanted in (
        ("spec, or file that it names", sweep.spec_sha256, section_sha256(spec)),
        ("field", sweep.vary, variation.field),
        ("scaled fields", sweep.scale, variation.scaled),
        ("accuracy", sweep.accuracy, accuracy),
        ("seed", sweep.seed, seed),
        ("version of lensforge", sweep.version, __version__),
    ):
        if stored != wanted:
            raise InputError(f"{path}: a sweep with another {field}; start again without resume")
    leds = {led.name: led.source for led in variation.sources} if isinstance(variation, SourceVariation) else {}
    for row in sweep.designs:
        folder = directory / row.folder
        lens = load_lens(folder / LENS_FILE)
        if lens.sha256 != sweep.inputs[row.folder]:
            raise InputError(f"{folder}: not the design that {path.name} lists; start again without resume")
        led = leds.get(str(row.value))
        if led is not None and not is_same_source(lens.spec.source, led):
            raise InputError(f"{folder}: designed for another LED {row.value}; start again without resume")
    return sweep


_HEIGHT = 3.2
_AXES = {
    "constraints.max_radius_mm": "largest radius allowed, r_c (mm)",
    "constraints.min_thickness_mm": "minimum thickness, Δr (mm)",
    "target.distance_mm": "distance of the target (mm)",
    "source.side_mm": "side of the source (mm)",
    "manufacture.cutter_radius_mm": "radius of the ball (mm)",
    "manufacture.nose_radius_mm": "radius of the nose (mm)",
}


def sweep_page(sweep: Sweep, results: Sequence[Results]) -> str:
    """The page; ``results`` of each design, in the order of the sweep."""
    field = sweep.vary.split(".")[-1]
    names = [row.value if isinstance(row.value, str) else f"{field} = {row.value:g}" for row in sweep.designs]
    return template("sweep.html").render(
        sweep=sweep,
        plot=picture("sweep", sweep_figure(sweep), f"Error and efficiency against {_label(sweep)}"),
        designs=_of_kind(sweep, "design"),
        losses=_of_kind(sweep, "loss"),
        failed=_of_kind(sweep, "failed"),
        pictures=ComparedPictures(names, results),
        version=sweep.version,
    )


def _of_kind(sweep: Sweep, key: str) -> list[Group]:
    return [group for group in sweep.facts if group.key == key]


def _label(sweep: Sweep) -> str:
    return _AXES.get(sweep.vary, sweep.label)


@in_report_style
def sweep_figure(sweep: Sweep) -> Figure:
    """NMSE on the left axis, efficiency on the right one, with standard errors; uniformity where it is defined."""
    figure, left = new_figure(WIDE, _HEIGHT)
    right = left.twinx()
    right.spines["right"].set_visible(True)
    _draw(left, sweep, "nmse", "NMSE", BLUE, "o")
    _draw(right, sweep, "efficiency", "efficiency", ORANGE, "s")
    even = any(row.uniformity is not None for row in sweep.designs)
    if even:
        _draw(right, sweep, "uniformity", "uniformity", GREEN, "^")
    left.set(xlabel=_label(sweep), ylabel="NMSE")
    left.set_ylim(bottom=0.0)
    right.set_ylabel("efficiency, uniformity" if even else "efficiency")
    left.grid(True)
    figure.legend(loc="outside upper left", ncols=3)
    return figure


def _draw(axes: Axes, sweep: Sweep, metric: MetricName, label: str, colour: str, marker: str) -> None:
    x, y, noise = sweep.curve(metric)
    line = "none" if any(isinstance(value, str) for value in x) else "solid"
    axes.errorbar(
        x,
        y,
        noise,
        color=colour,
        linestyle=line,
        ecolor=GREY,
        elinewidth=0.8,
        marker=marker,
        markersize=4.0,
        label=label,
    )
