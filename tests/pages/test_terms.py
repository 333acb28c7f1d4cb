"""The list of terms: labels of the last screen stand in it, none is stale, and the words that it bans are not used."""

import ast
import re
from collections.abc import Iterator
from functools import cache

from page_sources import ROOT

from lensforge.cli import conclusion
from lensforge.report.results import kinds_of_results
from lensforge.results.figure import figures_of
from lensforge.verbs import public_names

TERMS, BANNED = (ROOT / "docs" / "terms.md").read_text(encoding="utf-8").split("## Words not used")
RECORDS = {"terms", "validation", "changelog"}
PAGES = [ROOT / "README.md", *(path for path in ROOT.glob("docs/*.md") if path.stem not in RECORDS)]
BOLD = set(re.findall(r"\*\*(.+?)\*\*", TERMS)) - {"bold"}
SCREEN = {*conclusion._LIGHT, *conclusion._FAR_FIELD, *conclusion._LENS, *conclusion._FILES, "thinnest"}
PLAIN = {"rays", "level", "leak", "kept_start", "kept", "next", "plate_mass"}  # whose labels say all


@cache
def nodes() -> list[ast.AST]:
    files = sorted((ROOT / "lensforge").rglob("*.py"))
    return [node for path in files for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))]


def start(node: ast.expr) -> str:
    first = node.values[0] if isinstance(node, ast.JoinedStr) else node
    return str(first.value).partition("{")[0] if isinstance(first, ast.Constant) else ""


@cache
def labels() -> list[tuple[str, str]]:
    """Keys and labels of facts, each up to the name of a face, a plane or a tool."""
    kinds = ("Group", "Fact", "Row", "Fact.measured", "Fact.share")
    calls = (node for node in nodes() if isinstance(node, ast.Call) and ast.unparse(node.func) in kinds)
    pairs = ((start(call.args[0]), start(call.args[1])) for call in calls if len(call.args) > 1)
    figures = (figure for kind in kinds_of_results() for figure in figures_of(kind))
    declared = ((key.partition("{")[0], figure.label) for key, figure in figures if isinstance(figure.label, str))
    return [(key, label.partition("{")[0]) for key, label in (*pairs, *declared) if label.partition("{")[0]]


def of_label(term: str, label: str) -> bool:
    return term == label.rstrip(", ") or (label.endswith(" ") and term.startswith(label))


def test_labels_of_the_last_screen_are_terms_and_no_term_is_stale() -> None:
    told = {key: [label for known, label in labels() if known and key.startswith(known)] for key in SCREEN - PLAIN}
    assert {key for key in told if any(of_label(term, label) for term in BOLD for label in told[key])} == set(told)
    assert {term for term in BOLD if not any(of_label(term, label) for _, label in labels())} == set()


def texts() -> Iterator[tuple[str, str]]:
    """Pages, templates, what the program says, and the docstrings of public names."""
    for path in (*PAGES, *(ROOT / "lensforge").rglob("*.html")):
        yield path.name, path.read_text(encoding="utf-8")
    bodies = [node for node in nodes() if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and node.body]
    documented = {id(node.body[0].value): node for node in bodies if isinstance(node.body[0], ast.Expr)}
    for node in nodes():
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            of = documented.get(id(node))
            if of is None or getattr(of, "name", "") in public_names():
                yield getattr(of, "name", "a text"), node.value


def test_no_banned_word_is_in_use() -> None:
    terms = re.findall(r"`(.+?)`", BANNED)
    banned = re.compile("|".join(rf"\b{re.escape(word)}(?!\w)" for word in terms), re.IGNORECASE)
    uses = [f"{name}: {match[0]} in {text[max(0, match.start() - 40) : match.end() + 20]!r}"
             for name, text in texts() for match in banned.finditer(re.sub(r"\s+", " ", text))]  # fmt: skip
    assert len(terms) > 20 and uses == []
