"""The pages that users read, and what stands in them: fenced blocks, spans of code, headings, links."""

import re
import shlex
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
FOLDERS = (ROOT / "docs", ROOT / "benchmarks")
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(page for at in FOLDERS for page in sorted(at.glob("*.md")))]
_FENCE = re.compile(r"^(`{3,}|:{3,})(.*?)\n(.*?)^\1 *$", flags=re.MULTILINE | re.DOTALL)


class Block(NamedTuple):
    """A fenced block: where it stands, its language ("" for none), and its text."""

    place: str
    language: str
    text: str


def name_of(page: Path) -> str:
    return str(page.relative_to(ROOT))


def blocks(*languages: str, pages: list[Path] = PAGES) -> list[Block]:
    """All blocks of these languages, of all pages."""
    all_blocks = []
    for page in pages:
        text = page.read_text(encoding="utf-8")
        for match in _FENCE.finditer(text):
            line = text.count("\n", 0, match.start()) + 1
            all_blocks.append(Block(f"{name_of(page)}:{line}", match[2].strip(), match[3]))
    return [block for block in all_blocks if block.language in languages]


def prose(page: Path) -> str:
    """A page without its fenced blocks."""
    return _FENCE.sub("", page.read_text(encoding="utf-8"))


def spans(page: Path) -> list[str]:
    """Text of every span of code in the prose, a bar of a table as it is shown."""
    return [span.replace("\\|", "|").replace("\n", " ") for span in re.findall(r"(?<!`)`([^`]+)`(?!`)", prose(page))]


def links(page: Path) -> list[tuple[str, str]]:
    """File and anchor of each link to another place of the repository."""
    targets = re.findall(r"\]\((?!\w+:)<?([^)\s>]+)>?\)", prose(page))
    return [(file, anchor) for file, _, anchor in (target.partition("#") for target in targets)]


def anchors(page: Path) -> set[str]:
    """Anchors of the headings of a page, as GitHub and the site make them."""
    names = set()
    for heading in re.findall(r"^#+ (.*)$", prose(page), flags=re.MULTILINE):
        anchor = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).replace("`", "").strip().lower()
        names.add(re.sub(r"[^\w\- ]", "", anchor).replace(" ", "-"))
    return names


def shell_commands(text: str, program: str) -> list[list[str]]:
    """Arguments of each call of ``program`` in lines of a shell, loops and comments taken apart."""
    commands = []
    for line in text.replace("\\\n", " ").splitlines():
        for part in re.split(r";|&&| \| ", re.sub(r"(^|\s)#.*", "", line)):
            if not re.search(rf"(^|[ /]){program}( |$)", part):
                continue  # no shell at all: a formula, a drawing
            tokens = shlex.split(part)
            names = [word.rpartition("/")[2] for word in tokens]
            if program in names:
                commands.append(tokens[names.index(program) + 1 :])
    return commands
