"""Draw docs/architecture.svg from the imports in lensforge/, and write the table of packages in docs/architecture.md.

python docs/make_architecture.py
"""

import ast
from functools import cache
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "lensforge"
TARGET = Path(__file__).parent / "architecture.svg"
PAGE = Path(__file__).parent / "architecture.md"
WIDTH, BOX_HEIGHT, ROW_HEIGHT, CHARACTER, PADDING, GAP = 1000, 26, 62, 7.4, 18, 16
Graph = dict[str, set[str]]


def _name(path: Path) -> str:
    """Package of a file: the folder, or the module beside the folders."""
    return path.relative_to(PACKAGE).with_suffix("").parts[0]


def imports() -> Graph:
    """Every package and module of the package, with those that it imports anywhere."""
    graph: Graph = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        found = graph.setdefault(_name(path), set())
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            module = node.module if isinstance(node, ast.ImportFrom) else None
            if module and module.startswith("lensforge."):
                found.add(module.split(".")[1])
    del graph["__init__"]
    return {name: found - {name} for name, found in graph.items()}


def packages(graph: Graph) -> Graph:
    """Only the folders, with those that they import, at once or by way of a module beside the folders."""
    folders = {name for name in graph if (PACKAGE / name).is_dir()}

    @cache
    def reached(name: str) -> frozenset[str]:
        direct = graph[name] & folders
        return frozenset(direct.union(*(reached(other) for other in graph[name] - folders)))

    return {name: set(reached(name)) - {name} for name in folders}


def reduced(graph: Graph) -> Graph:
    """The same order with the fewest arrows: none where a way through another package says it already."""

    @cache
    def below(name: str) -> frozenset[str]:
        return frozenset(graph[name].union(*(below(other) for other in graph[name])))

    return {name: {to for to in found if not any(to in below(other) for other in found - {to})}
            for name, found in graph.items()}  # fmt: skip


def floors(graph: Graph) -> list[list[str]]:
    """Packages by floor, the ground first: each as low as what it imports allows."""

    @cache
    def floor(name: str) -> int:
        return 1 + max((floor(other) for other in graph[name]), default=-1)

    rows: list[list[str]] = [[] for _ in range(1 + max(floor(name) for name in graph))]
    for name in sorted(graph):
        rows[floor(name)].append(name)
    return rows


def places(rows: list[list[str]], graph: Graph) -> dict[str, tuple[float, float, float]]:
    """Centre x, top y and width of each box; a row stands in the order of what lies below it."""
    found: dict[str, tuple[float, float, float]] = {}
    for number, row in enumerate(rows):
        centres = {name: [found[other][0] for other in graph[name]] for name in row}
        ordered = sorted(row, key=lambda name: (sum(centres[name]) / (len(centres[name]) or 1), name))
        widths = [PADDING + CHARACTER * len(name) for name in ordered]
        free = WIDTH - sum(widths)
        gap, left = free / (len(row) + 1), 0.0
        for name, width in zip(ordered, widths, strict=True):
            left += gap
            found[name] = (left + width / 2, ROW_HEIGHT * (len(rows) - 1 - number) + GAP, width)
            left += width
    return found


def drawing(graph: Graph) -> str:
    """The picture as SVG: boxes in rows, an arrow from each package down to what it imports."""
    few = reduced(graph)
    rows = floors(graph)
    at = places(rows, few)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {ROW_HEIGHT * len(rows)}" '
        'font-family="sans-serif" font-size="13">',
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
        '<path d="M0 0 8 4 0 8z" fill="#607d8b"/></marker></defs>',
        f'<rect width="{WIDTH}" height="{ROW_HEIGHT * len(rows)}" fill="white"/>',
    ]
    for name in sorted(few):
        for other in sorted(few[name]):
            (x, y, _), (to_x, to_y, _) = at[name], at[other]
            start, middle = y + BOX_HEIGHT, (y + BOX_HEIGHT + to_y) / 2
            lines.append(
                f'<path d="M{x:.1f} {start:.1f}C{x:.1f} {middle:.1f} {to_x:.1f} {middle:.1f} {to_x:.1f} {to_y:.1f}" '
                'fill="none" stroke="#90a4ae" marker-end="url(#tip)"/>'
            )
    for name, (x, y, width) in sorted(at.items()):
        lines += [
            f'<rect x="{x - width / 2:.1f}" y="{y:.1f}" width="{width:.1f}" height="{BOX_HEIGHT}" rx="4" '
            'fill="#e3f2fd" stroke="#1565c0"/>',
            f'<text x="{x:.1f}" y="{y + 18:.1f}" text-anchor="middle" fill="#0d2b45">{name}</text>',
        ]
    return "\n".join([*lines, "</svg>", ""])


def table(graph: Graph) -> str:
    """The packages from the top down, each with the first sentence of its docstring, as Markdown."""
    lines = ["| package | |", "|---|---|"]
    for row in reversed(floors(graph)):
        for name in row:
            text = ast.get_docstring(ast.parse((PACKAGE / name / "__init__.py").read_text(encoding="utf-8"))) or ""
            words = " ".join(text.split("\n\n")[0].split()).rstrip(".")
            lines.append(f"| `{name}` | {words} |")
    return "\n".join(lines)


def filled(text: str, graph: Graph) -> str:
    """The page with its table made anew."""
    before, after = "<!-- packages -->\n\n", "\n\n<!-- end of packages -->"
    head, rest = text.split(before.rstrip("\n"))
    return head + before + table(graph) + after + rest.split(after.strip("\n"))[1]


if __name__ == "__main__":
    found = packages(imports())
    TARGET.write_text(drawing(found), encoding="utf-8")
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8"), found), encoding="utf-8")
    print(TARGET, PAGE, sep="\n")
