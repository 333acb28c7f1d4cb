"""The plot of a result as a file, or as HTML for a notebook."""

import base64
import io
from collections.abc import Callable
from typing import Any

PICTURES = (".png", ".svg", ".pdf")
_DATE = {"png": "Software", "svg": "Date", "pdf": "CreationDate"}  # what would change from one file to the next


def picture_html(draw: Callable[..., Any], description: str) -> str:
    """What ``draw`` draws on axes of its own, as HTML."""
    encoded = base64.b64encode(drawn(draw, "png")).decode()
    return f'<img alt="{description}" style="max-width:30em" src="data:image/png;base64,{encoded}">'


def drawn(draw: Callable[..., Any], kind: str) -> bytes:
    """What ``draw`` draws on axes of its own, as a file of that kind; the same result gives the same bytes."""
    from matplotlib.figure import Figure

    figure, file = Figure(figsize=(5.0, 4.0), layout="constrained"), io.BytesIO()
    draw(axes=figure.add_subplot())
    figure.savefig(file, format=kind, dpi=150, metadata={_DATE[kind]: None})
    return file.getvalue()
