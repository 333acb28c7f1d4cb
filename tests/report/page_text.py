"""A page as a reader sees it: its text, tags, ids and references."""

import re
from html.parser import HTMLParser

from undrawn import undrawn

from lensforge.report.lens_page import render_report


def folded(text):
    return re.sub(r"\s+", " ", text).strip()


class Page(HTMLParser):
    """Text, tags and references of a page."""

    def __init__(self, markup):
        super().__init__()
        self.text, self.tags, self.references, self.ids, self.hidden = "", [], [], [], False
        self.feed(markup)
        self.text = folded(self.text)

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.hidden = tag in ("style", "script")
        self.text += " " if tag == "div" else ""
        for name, value in attributes:
            if name == "id":
                self.ids.append(value)
            if name in ("src", "href", "xlink:href"):
                self.references.append(value)

    def handle_endtag(self, tag):
        self.hidden = False
        self.text += " " if tag in ("td", "div", "p") else ""

    def handle_data(self, data):
        if not self.hidden:
            self.text += data


def undrawn_page_of(results, folder=None):
    """The report with empty pictures: its words and numbers."""
    with undrawn():
        return render_report(results, folder)


def text_of(results, folder=None):
    return Page(undrawn_page_of(results, folder)).text
