"""Commands on specs: ``new``, from a source, a target and a size; ``schema``, all fields; ``examples``, the shipped."""

import json
import re
import shlex
import sys
import tomllib
from collections.abc import Callable, Iterator, Sequence
from copy import deepcopy
from functools import reduce
from operator import attrgetter, getitem
from pathlib import Path
from typing import Any

import click
from click.shell_completion import CompletionItem

import lensforge
from lensforge.cli.options import with_force
from lensforge.errors import InputError
from lensforge.light.lens_light import source_of
from lensforge.optics.material import MATERIALS
from lensforge.results.files import replacing, require_writable
from lensforge.shop.findings import GOOD_DRAFT_DEG
from lensforge.sources.build_source import cavity_around
from lensforge.spec import LensSection, Spec, parse_spec
from lensforge.spec.derived_values import WHY
from lensforge.spec.new_spec import SOURCE_KINDS, SOURCES, TARGET_KINDS, TARGETS, new_text, source_in, target_in
from lensforge.spec.source_sections import RayfileSource
from lensforge.spec.spec_reference import SCHEMA_FILE, reference_page, spec_schema

Tables = dict[str, Any]  # of a spec, by their names

_MATERIAL = "PMMA"
_OF_USUAL_BASE_MM = 24.0  # largest radius of a lens whose cavity the base of 25.4 mm holds with room to spare
_CUTTER, _CUTTERS = "1", "radius of the shop's ball cutter in mm, mould, or none"


def _completed(kinds: Sequence[str]) -> Callable[[click.Context, click.Parameter, str], list[CompletionItem]]:
    """Completion of a kind, or of the name of a file."""

    def complete(_context: click.Context, _option: click.Parameter, begun: str) -> list[CompletionItem]:
        completions = [CompletionItem(f"{kind}:") for kind in kinds if f"{kind}:".startswith(begun)]
        return completions or [CompletionItem(begun, type="file")]

    return complete


@click.command()
@click.argument("spec", required=False, type=click.Path(path_type=Path))
@click.option("--source", metavar="SOURCE", help=f"The LED: {SOURCES}.", shell_complete=_completed(SOURCE_KINDS))
@click.option("--target", metavar="TARGET", help=f"The light: {TARGETS}.", shell_complete=_completed(TARGET_KINDS))
@click.option("--max-radius", type=click.FloatRange(1e-6, 1e9), help="Largest radius of the lens in mm.")
@click.option("--material", help=f"One of {', '.join(MATERIALS)}; default: {_MATERIAL}.")
@click.option("--cutter", metavar="CUTTER", help=f"What the shop needs: {_CUTTERS}; default: {_CUTTER}.")
@with_force
def new(
    spec: Path | None,
    source: str | None,
    target: str | None,
    max_radius: float | None,
    material: str | None,
    cutter: str | None,
    force: bool,
) -> None:
    """Write a commented SPEC.toml; what is not given is asked for in a terminal. Without SPEC.toml: to stdout."""
    if spec is not None and spec.exists():
        raise InputError(f"{spec}: is there already and stays as it is; give another name")
    sections = {
        "source": source_in(source) if source else _asked("--source", f"LED ({SOURCES})", source_in),
        "target": target_in(target) if target else _asked("--target", f"light ({TARGETS})", target_in),
    }
    radius = max_radius or _asked("--max-radius", "largest radius of the lens in mm", _radius)
    named = material or (_asked("--material", "material", str, _MATERIAL) if _at_terminal() else _MATERIAL)
    shop = cutter or (_asked("--cutter", _CUTTERS, str, _CUTTER) if _at_terminal() else _CUTTER)
    content = _content(_name(spec), sections, radius, named, _made_by(shop))
    folder = Path() if spec is None else spec.parent
    text = _checked_text(content, folder, force)
    if spec is None:
        click.echo(text, nl=False)
        return
    _write(spec, text)
    if not (folder / SCHEMA_FILE).exists():
        _write(folder / SCHEMA_FILE, _schema_text())
    click.echo(f"{spec}\tlensforge design {shlex.quote(str(spec))}")


def _asked(option: str, words: str, read: Callable[[str], Any], default: str | None = None) -> Any:
    """An answer of the person at the terminal, until ``read`` takes it. Raises :class:`InputError` without one."""
    if not _at_terminal():
        raise InputError(f"{option}: is missing; give the {words}")

    def checked(answer: str) -> Any:
        try:
            return read(answer)
        except InputError as error:
            raise click.UsageError(str(error)) from None

    return click.prompt(words[:1].upper() + words[1:], value_proc=checked, default=default, err=True)


def _at_terminal() -> bool:
    return sys.stdin is not None and sys.stdin.isatty()


def _radius(answer: str) -> float:
    return _millimetres(f"--max-radius {answer}", answer, "a number of mm above 0")


def _millimetres(given: str, answer: str, allowed: str) -> float:
    """Length (mm) in ``answer``. Raises :class:`InputError` that quotes ``given`` and says what is ``allowed``."""
    try:
        value = float(answer)
    except ValueError:
        value = 0.0
    if not 1e-6 <= value <= 1e9:
        raise InputError(f"{given}: must be {allowed}")
    return value


def _made_by(cutter: str) -> Tables:
    """Fields that let ``cutter`` make a lens, as the check would advise: a ``face`` of it, and tables of its spec."""
    if cutter == "none":
        return {}
    if cutter == "mould":
        return {"face": {"draft_deg": GOOD_DRAFT_DEG}, "manufacture": {"make": "insert"}}
    radius = _millimetres(f"--cutter {cutter}", cutter, f"the {_CUTTERS}")
    return {"face": {"concave_radius_mm": radius, "draft_deg": 0.0}, "manufacture": {"cutter_radius_mm": radius}}


def _name(spec: Path | None) -> str:
    name = "lens" if spec is None else spec.stem
    return "".join(each if each.isascii() and (each.isalnum() or each in "-_") else "_" for each in name)[:64] or "lens"


def _content(name: str, sections: Tables, radius_mm: float, material: str, made_by: Tables) -> Tables:
    if material not in MATERIALS:
        raise InputError(f"--material {material}: must be one of {', '.join(MATERIALS)}")
    faces = {role.name: {**made_by.get("face", {})} for role in LensSection.roles}
    content = {
        "name": name,
        "source": sections["source"],
        "lens": {"material": material, "levels": "auto", **faces},
        "constraints": {"max_radius_mm": radius_mm},
        "target": sections["target"],
        **({"manufacture": made_by["manufacture"]} if made_by else {}),
    }
    if radius_mm > _OF_USUAL_BASE_MM:
        content["base"] = {"diameter_mm": 1.8 * radius_mm, "height_mm": 0.125 * radius_mm}
    return content


def _checked_text(content: Tables, folder: Path, force: bool) -> str:
    """TOML of ``content`` with derived values, after the check of what is possible. Raises :class:`InputError`."""
    from lensforge.search.scene_check import SceneCheck

    resolved = deepcopy(content)
    if content["source"]["kind"] == "rayfile":
        measured = cavity_around(RayfileSource(**resolved["source"]))
        content["constraints"].update(measured)
        resolved["constraints"].update(measured)
    made: Spec = parse_spec(resolved, "new")
    scene = SceneCheck.of(made, source_of(made))
    scene.require_light(force=force)
    for words in scene.warnings():
        click.echo(f"lensforge: {words}", err=True)
    reasons = {}
    for name, why in WHY.items():
        section, _, field = name.rpartition(".")
        if section.removeprefix("lens.") not in (*content, *made.lens.names):
            continue  # a face of another kind of lens
        value, table = attrgetter(name)(made), reduce(getitem, section.split("."), content)
        if field not in table and value is not None:
            table[field], reasons[name] = value, why
    for section in ("source", "target"):
        if "file" in content[section]:
            content[section]["file"] = _relative(getattr(made, section).file.resolve(), folder)
    title = f"{made.source.title}, target {made.target.kind}" if made.target is not None else made.source.title
    possible = f"The target: {scene.targets[0].possible_words} through the largest lens."
    return new_text(content, reasons, title[:1].upper() + title[1:], possible)


def _relative(file: Path, folder: Path) -> str:
    """Name of ``file`` as a spec in ``folder`` has it."""
    try:
        return file.relative_to(folder.resolve()).as_posix()
    except ValueError:
        return str(file)


def _schema_text() -> str:
    return json.dumps(spec_schema(), indent=1, ensure_ascii=False) + "\n"


def _write(path: Path, text: str) -> None:
    require_writable(path)
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


_PACKAGE = Path(lensforge.__file__).parent
# The end of a sentence, not of "UN Regulation No. 7", nor of a journal's short name.
_END = re.compile(r"(?<!\bNo)(?<!\bJ)(?<!\bOpt)(?<!\bUniv)(?<!\bSci)\. ")
_PLACES = (_PACKAGE / "shipped", _PACKAGE.parent / "examples")  # of an installed package, and of a checkout


@click.command()
@click.option("--page", is_flag=True, help="Print the reference of all fields as Markdown instead (docs/spec.md).")
def schema(page: bool) -> None:
    """Print the JSON schema of a spec, by which an editor completes and checks it."""
    click.echo(reference_page() if page else _schema_text(), nl=False)


@click.command()
@click.argument("name", required=False)
def examples(name: str | None) -> None:
    """List the shipped specs, or copy the one called NAME here, with the files that it names."""
    folder = shipped_folder()
    paths = sorted(folder.rglob("*.toml"), key=lambda path: (path.parent, path.name))
    specs = {path.relative_to(folder).with_suffix("").as_posix(): path for path in paths}
    if name is None:
        for known, path in specs.items():
            click.echo(f"{known}\t{_first_comment(path)}")
        return
    stem = name.removesuffix(".toml")
    if stem not in specs:
        raise InputError(f"examples {name}: there is none of that name; known: {', '.join(specs)}")
    wanted = [specs[stem], *_named_files(specs[stem])]
    here = [path.name for path in wanted if Path(path.name).exists()]
    if here:
        raise InputError(f"{here[0]}: is there already and stays as it is; copy {stem} into another folder")
    for path in wanted:
        with replacing(Path(path.name)) as temporary:
            temporary.write_bytes(path.read_bytes())
    click.echo(f"{', '.join(path.name for path in wanted)}\tlensforge design {shlex.quote(wanted[0].name)}")


def shipped_folder() -> Path:
    """The folder of the shipped specs. Raises :class:`InputError` for an installation without them."""
    folder = next((place for place in _PLACES if (place / "quickstart.toml").is_file()), None)
    if folder is None:
        raise InputError("examples: this installation has none; install lensforge from its wheel or its sources")
    return folder


def _first_comment(path: Path) -> str:
    """The first sentence of the comment at the head of a spec."""
    lines = path.read_text(encoding="utf-8").split('name = "')[0].splitlines()
    words = " ".join(line.lstrip("# ") for line in lines)
    return _END.split(words)[0].rstrip(".")


def _named_files(spec: Path) -> list[Path]:
    """Files beside a shipped spec that it names; those of a vendor are not there."""
    texts = _texts(tomllib.loads(spec.read_text(encoding="utf-8")))
    return [spec.parent / text for text in texts if Path(text).name == text and (spec.parent / text).is_file()]


def _texts(value: object) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for entry in value.values():
            yield from _texts(entry)
    elif isinstance(value, list):
        for entry in value:
            yield from _texts(entry)
