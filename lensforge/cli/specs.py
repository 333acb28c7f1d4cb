"""Commands on specs: ``new``, from a source, a target and a size; ``schema``, all fields; ``examples``, the shipped."""

import json
import shlex
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

from lensforge.cli.nearest_examples import nearest_examples
from lensforge.cli.options import Number, with_force
from lensforge.errors import InputError
from lensforge.optics.material import MATERIALS
from lensforge.report.new_scene import CUTTERS, USUAL, NewScene, millimetres
from lensforge.results.files import require_writable, write_file
from lensforge.spec.led_packages import led_packages
from lensforge.spec.lens_section import LensShape
from lensforge.spec.new_spec import (
    LIST_OF_PACKAGES,
    SOURCE_KINDS,
    SOURCES,
    TARGET_KINDS,
    TARGETS,
    line_in,
    listed_packages,
    receiver_beside,
    source_in,
    source_note,
    target_in,
    zoom_in,
)
from lensforge.spec.shipped_specs import first_sentence, named_files, shipped_specs
from lensforge.spec.spec_reference import SCHEMA_FILE, reference_page, spec_schema

if TYPE_CHECKING:  # torch, which the search needs, takes a second to load
    from lensforge.search.lens_advice import LensAdvice

_MATERIAL = "PMMA"
_BESIDE = Number(-90.0, 90.0)


_Completion = Callable[[click.Context, click.Parameter, str], list[CompletionItem]]


def _completed(kinds: Sequence[str], names: Callable[[], Iterable[str]] = tuple) -> _Completion:
    def complete(_context: click.Context, _option: click.Parameter, begun: str) -> list[CompletionItem]:
        answers = (*(f"{kind}:" for kind in kinds), *names())
        completions = [CompletionItem(answer) for answer in answers if answer.startswith(begun)]
        return completions or [CompletionItem(begun, type="file")]

    return complete


@click.command()
@click.argument("spec", required=False, type=click.Path(path_type=Path))
@click.option(
    "--source",
    metavar="SOURCE",
    help=f"The LED: {SOURCES}.",
    shell_complete=_completed(SOURCE_KINDS, led_packages),
)
@click.option("--target", metavar="TARGET", help=f"The light: {TARGETS}.", shell_complete=_completed(TARGET_KINDS))
@click.option(
    "--off-axis",
    "off_axis_deg",
    type=_BESIDE,
    metavar="DEG",
    help="Angle of the plane's centre from the axis, towards +x.",
)
@click.option(
    "--tilt", "tilt_deg", type=_BESIDE, metavar="DEG", help="Angle of the plane's normal from the axis; of a wall: 90."
)
@click.option("--max-radius", type=Number(1e-6, 1e9), help="Largest radius of the lens in mm.")
@click.option("--lens", type=click.Choice([*LensShape.kinds]), help="Kind; default: the one that suits the light.")
@click.option("--thin", is_flag=True, help="A low lens, whose exit has a groove: half as high, for 2 % of the light.")
@click.option("--material", help=f"One of {', '.join(MATERIALS)}; default: {_MATERIAL}.")
@click.option("--cutter", metavar="CUTTER", help=f"What the shop needs: {CUTTERS}; default: what the lens allows.")
@with_force
def new(
    spec: Path | None,
    source: str | None,
    target: str | None,
    max_radius: float | None,
    lens: str | None,
    thin: bool,
    material: str | None,
    cutter: str | None,
    force: bool,
    **beside: float | None,
) -> None:
    """Write a commented SPEC.toml; in a terminal it prompts for what is missing. Without SPEC.toml: to stdout."""
    if source == LIST_OF_PACKAGES:
        click.echo(listed_packages(), nl=False)
        return
    if spec is not None and spec.exists():
        raise InputError(f"{spec}: exists and is not overwritten; give another name")
    asked = target or _asked("--target", f"light ({TARGETS})", _target)
    wanted = target_in(asked)
    zoom = zoom_in(asked)
    led = source or _asked("--source", f"LED ({SOURCES})", _source)
    plane = {name: angle for name, angle in beside.items() if angle is not None}
    scene = NewScene.of(
        "lens" if spec is None else spec.stem,
        {"receivers": [receiver_beside(wanted, **plane)]} if plane else {"target": wanted},
        source_in(led),
        max_radius or _asked("--max-radius", "largest radius of the lens in mm", _radius),
        source_note(led),
    )
    if zoom is not None:
        scene = scene.zoomed(*zoom)
    scene = replace(scene, line_mm=line_in(asked))
    if thin:
        scene = replace(scene, thin=True)
        lens = lens or next(name for name, section in LensShape.kinds.items() if section.may_be_thin)
    kind, why = (lens, "") if lens else _suitable(scene.of_material(material or _MATERIAL).advice())
    scene.require_thin(kind)
    if not scene.takes_material(kind):
        if material is not None:
            raise InputError(f"--material {material}: no light enters a lens of kind {kind!r}; leave it out")
    elif material is None:
        material = _asked("--material", "material", str, _MATERIAL) if _at_terminal() else _MATERIAL
    shop = cutter or (_asked("--cutter", CUTTERS, str, USUAL) if _at_terminal() else USUAL)
    folder = Path() if spec is None else spec.parent
    made = scene.of_material(material)
    text = made.text(kind, shop, folder, nearest_examples(kind, scene.light), force=force, warn=_told)
    if spec is None:
        click.echo(text, nl=False)
    else:
        _write(spec, text)
        if not (folder / SCHEMA_FILE).exists():
            _write(folder / SCHEMA_FILE, _schema_text())
        click.echo(f"{spec}\tlensforge design {shlex.quote(str(spec))}")
        _told(text.split("\n")[1].removeprefix("# "))  # what it is for
    if why:
        click.echo(why, err=True)


def _told(message: str) -> None:
    click.echo(f"lensforge: {message}", err=True)


def _suitable(advice: "LensAdvice") -> tuple[str, str]:
    """The kind of lens that a person at the terminal chooses, or the one that suits the light, and why."""
    kinds = ", ".join(advice.options)

    def chosen(kind: str) -> str:
        if kind not in advice.options:
            raise InputError(f"--lens {kind}: must be one of {kinds}")
        return kind

    if _at_terminal():
        return _asked("--lens", f"kind of lens, one of {kinds} ({advice.phrase})", chosen, advice.advised), ""
    return advice.advised, f"lensforge: lens: {advice.phrase}; {advice.why}; --lens selects another"


def _asked(option: str, question: str, read: Callable[[str], Any], default: str | None = None) -> Any:
    """An answer of the person at the terminal, until ``read`` takes it. Raises :class:`InputError` without one."""
    if not _at_terminal():
        raise InputError(f"{option}: is missing; give the {question}")

    def checked(answer: str) -> Any:
        try:
            return read(answer)
        except InputError as error:
            raise click.UsageError(str(error)) from None

    return click.prompt(question[:1].upper() + question[1:], value_proc=checked, default=default, err=True)


def _at_terminal() -> bool:
    return sys.stdin is not None and sys.stdin.isatty()


def _source(answer: str) -> str:
    source_in(answer)
    return answer


def _target(answer: str) -> str:
    target_in(answer)
    return answer


def _radius(answer: str) -> float:
    return millimetres(f"--max-radius {answer}", answer, "a number of mm above 0")


def _schema_text() -> str:
    return json.dumps(spec_schema(), indent=1, ensure_ascii=False) + "\n"


def _write(path: Path, text: str) -> None:
    require_writable(path)
    write_file(path, text.encode())


@click.command()
@click.option("--page", is_flag=True, help="Print the reference of all fields as Markdown instead (docs/spec.md).")
def schema(page: bool) -> None:
    """Print the JSON schema of a spec, by which an editor completes and checks it."""
    click.echo(reference_page() if page else _schema_text(), nl=False)


@click.command()
@click.argument("name", required=False)
def examples(name: str | None) -> None:
    """List the shipped specs, or copy the one called NAME here, with the files that it names or that belong to it."""
    specs = shipped_specs()
    if name is None:
        for known, path in specs.items():
            click.echo(f"{known}\t{first_sentence(path)}")
        return
    stem = name.removesuffix(".toml")
    if stem not in specs:
        raise InputError(f"examples {name}: not found; known: {', '.join(specs)}")
    wanted = [specs[stem], *named_files(specs[stem])]
    copies = [path.relative_to(specs[stem].parent) for path in wanted]
    here = [copy for copy in copies if copy.exists()]
    if here:
        raise InputError(f"{here[0]}: exists and is not overwritten; copy {stem} into another folder")
    for copy, path in zip(copies, wanted, strict=True):
        copy.parent.mkdir(exist_ok=True)
        write_file(copy, path.read_bytes())
    click.echo(f"{', '.join(map(str, copies))}\tlensforge design {shlex.quote(copies[0].name)}")
