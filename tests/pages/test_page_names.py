"""Names in the code spans of pages are of what there is: modules, classes, fields, sections and their words, files."""

import re
from pathlib import Path

import pytest
from page_sources import PAGES, ROOT, name_of, spans

FOLDERS = ("lensforge", "tests", "benchmarks", "docs", "examples", ".ci")
FILES = {"/" + name_of(path) for folder in FOLDERS for path in (ROOT / folder).rglob("*.*")} | {"/CONTRIBUTING.md"}
TEXTS = [(ROOT / name[1:]).read_text(encoding="utf-8") for name in FILES if re.match("/(?!tests).*py$", name)]
WORDS = set(re.findall(r"[^\W\d]\w*", " ".join([*TEXTS, *FILES, (ROOT / "Makefile").read_text(encoding="utf-8")])))
PARTS = re.split("^#+ ", (ROOT / "docs" / "spec.md").read_text(encoding="utf-8"), flags=re.MULTILINE)
SECTIONS = [(re.findall(r"`([\w.]+)`", part.partition("\n")[0]), re.findall(r"\n\| `(\w+)`", part)) for part in PARTS]
FIELDS = {f"{section}.{field}" for sections, fields in SECTIONS for section in sections for field in fields}
# Programs and places that are not ours, files that are written, and attributes that begin as a section does.
OTHERS = r"dask |helm |dfat |kubectl |python -ic|~/|cad_out/|\w*://|(receivers.k.*|sources.b.*|lens.surfaces)$"
WRITTEN = r"\b[\w*]+\.(json|npz|step|stl|3mf|ies|ldt|iesxml|tm25ray|csv|txt|pdf|dxf|glb|gldf|obj|npy|dat|ray)\b"


def is_known(word: str) -> bool:
    """True where something has the name, or it is that of a face, an edge or a corner before it."""
    of_face = re.sub(r"^(inner|outer|wall)_|^(edge|corner)_\d", "", word)
    return word in WORDS or of_face in WORDS or not re.match(r"[A-Za-z_]", of_face)


def missing(span: str) -> list[str]:
    """Names of a span that nothing has: words, files, and fields of sections."""
    ours = re.sub(WRITTEN, "", span)
    wrong = [word for word in re.findall(r"\b(?![A-Z\d_]+\b)[A-Za-z_]\w*", ours) if not is_known(word)]
    paths = re.findall(r"[\w./-]+\.(?:py|md)\b", ours)
    wrong += [path for path in paths if not any(name.endswith("/" + path) for name in FILES)]
    plain = re.sub(r"\.\d", "", ours.replace("lens.wall", "lens.exit").lstrip("["))
    dotted = re.match(r"[a-z]+(\.[\w.]+)(?![\w.(])|", plain)[0]
    gone = dotted not in FIELDS and dotted.partition(".")[0] in {name.partition(".")[0] for name in FIELDS}
    return [] if re.match(OTHERS, span) else [*wrong, *[dotted] * gone]


@pytest.mark.parametrize("page", [page for page in PAGES if page.stem not in ("terms",)], ids=name_of)
def test_what_a_page_names_is_there(page: Path) -> None:
    assert {span: reason for span in spans(page) if (reason := missing(span))} == {}


def test_a_name_that_is_gone_is_found() -> None:
    assert all(map(missing, ("toroid", "lf.GoneTarget", "light/gone.py", "constraints.tools", "[lens.gone]")))
