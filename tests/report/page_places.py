"""Places of a page where a reader sees text, without pictures: cells of tables by row and column, cards, sentences."""

import re
from html.parser import HTMLParser

from shown_numbers import Place

_VOID = ("meta", "link", "wbr", "br", "img", "input")
_TEXTS = ("p", "li", "figcaption", "summary", "footer", "h1", "title", "pre", "button", "span", "strong")
_APART = {"note", "remedy", "badge", "mark", "word", "block"}  # beside a text, no part of it


class Node:
    """An element of the page: its tag, the kinds that it is styled as, and what it holds."""

    def __init__(self, tag, attributes, parent):
        self.tag, self.parent, self.content = tag, parent, []
        self.kinds = set((dict(attributes).get("class") or "").split())

    @property
    def text(self):
        """Text without what stands beside it."""
        return _folded("".join(map(_inline, self.content)))

    @property
    def beside(self):
        """Texts of notes, and of blocks of numbers."""
        return [each.text for each in self.all("span", "div") if {"note", "remedy", "block"} & each.kinds]

    def all(self, *tags):
        for each in self.content:
            if isinstance(each, Node):
                if each.tag in tags:
                    yield each
                yield from each.all(*tags)


def _inline(part):
    if isinstance(part, str):
        return part
    if part.tag in ("span", "div") and _APART & part.kinds:
        return ""
    return " " if part.tag == "br" else "".join(map(_inline, part.content))


class _Tree(HTMLParser):
    def __init__(self, markup):
        super().__init__()
        self.root = self.node = Node("", (), None)
        self.feed(markup)

    def handle_starttag(self, tag, attributes):
        node = Node(tag, attributes, self.node)
        self.node.content.append(node)
        if tag not in _VOID:
            self.node = node

    def handle_endtag(self, tag):
        node = self.node
        while node.parent is not None and node.tag != tag:
            node = node.parent
        if node.parent is not None:
            self.node = node.parent

    def handle_data(self, data):
        self.node.content.append(data)


def _folded(text):
    return re.sub(r"[ \n\t\u00a0]+", " ", text).strip()


def places_of(markup):
    """Every text of the page; its label begins with the headings, folds and titles of figures that it stands under."""
    return list(_walk(_Tree(markup).root, {}))


def _walk(node, headings):
    for each in node.content:
        if not isinstance(each, Node) or each.tag in ("svg", "style", "script"):
            continue
        if each.tag in ("h2", "h3"):
            if each.tag == "h2":
                headings.pop("h3", None)
            headings[each.tag] = each.text
            yield Place("heading", each.text)
        elif each.tag == "table":
            yield from _rows(each, headings)
        elif "card" in each.kinds:
            yield from _card(each, headings)
        elif each.tag in _TEXTS:
            names = "title" if "title" in each.kinds else each.tag
            yield Place(_label(headings, names), each.text)
            yield from (Place(_label(headings, names, "note"), note) for note in each.beside)
        else:
            yield from _walk(each, headings if each.tag in ("main", "body", "html") else headings | _title(each))


def _title(node):
    """The title of a fold or of a figure."""
    if node.tag == "details":
        return {"fold": next(node.all("summary")).text}
    found = [each.text for each in node.all("p") if "title" in each.kinds] if node.tag == "figure" else []
    return {"figure": found[0]} if found else {}


def _card(card, headings):
    label, value, note = card.all("div")
    yield Place(_label(headings, "card", label.text), value.text)
    yield Place(_label(headings, "card", label.text, "note"), note.text)


def _label(headings, *names):
    return " / ".join([*headings.values(), *names])


def _rows(table, headings):
    columns = None
    for row in table.all("tr"):
        cells = list(row.all("th", "td"))
        if columns is None and len(cells) > 1 and all(cell.tag == "th" for cell in cells):
            columns = [cell.text for cell in cells]
            yield Place(_label(headings, "columns"), ", ".join(columns))
        else:
            yield from _cells(cells, columns, headings)


def _cells(cells, columns, headings):
    """A place for each cell but that which names the row; where the table names no columns, one for all of them."""
    key = 1 if columns and columns[0] == "Verdict" else 0
    name = cells[key].text
    yield Place(_label(headings, name), name, names_row=True)
    yield from (Place(_label(headings, name, "note"), note) for note in cells[key].beside)
    if columns is None:
        yield Place(_label(headings, name), " ".join(cell.text for cell in cells[1:]).strip())
        return
    for column, cell in zip(columns, cells, strict=True):
        if cell is not cells[key]:
            yield Place(_label(headings, name, column), cell.text)
            yield from (Place(_label(headings, name, column, "note"), note) for note in cell.beside)
