"""Places of a module where a change is no bug of a calculation: annotations, decorators, words, strict of zip."""

import ast

_Place = tuple[int, int]  # line, from 1, and column


def left_out(source: str) -> list[tuple[_Place, _Place]]:
    """Begin and end of each place in ``source`` where nothing is changed."""
    places = []
    for node in ast.walk(ast.parse(source)):
        places += [((each.lineno, each.col_offset), _end(each)) for each in _of(node)]
    return places


def within(place: _Place, places: list[tuple[_Place, _Place]]) -> bool:
    """True where ``place`` lies in one of ``places``."""
    return any(begin <= place < end for begin, end in places)


def _of(node: ast.AST) -> list[ast.expr | ast.stmt]:
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        returns = node.returns if isinstance(node, ast.FunctionDef) else None
        return [*node.decorator_list, *([returns] if returns else [])]
    if isinstance(node, ast.arg | ast.AnnAssign):
        return [node.annotation] if node.annotation else []
    if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
        return [node]
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "zip":
        return [each.value for each in node.keywords]  # strict: lengths are equal, and it changes nothing
    return [node] if isinstance(node, ast.JoinedStr) else []


def _end(node: ast.expr | ast.stmt) -> _Place:
    return node.end_lineno or node.lineno, node.end_col_offset or 0
