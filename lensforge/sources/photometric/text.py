"""Text of a photometric file: its encoding, line ends and end marks, all of which vary by program and age."""

import re

_LINE_END = re.compile(r"\r*\n|\r")  # Unix, DOS (also with the carriage return doubled), old Macintosh
_END_OF_TEXT = "\x1a"  # Ctrl-Z, after which DOS reads nothing
_PADDING = "\0\x1a \t\n"
_SAMPLE = 512  # bytes that tell UTF-16 without a mark
_NUL_SHARE = 0.8  # at least, of every second byte in UTF-16 of mostly ASCII; other encodings have NULs as padding only


def text_of(content: bytes) -> tuple[str, tuple[str, ...]]:
    """Text of a file with "\\n" for line ends, up to its end mark; and warnings on anything that was left out.

    UTF-8 and UTF-16, with a byte-order mark or without, then Windows-1252, in which byte 85 hex is an ellipsis and
    not, as in Unicode, the end of a line.
    """
    text = _LINE_END.sub("\n", _decoded(content))
    text, mark, rest = text.partition(_END_OF_TEXT)
    left_out = rest.strip(_PADDING)
    warning = f"{len(left_out)} characters after its end mark (Ctrl-Z) are left out"
    return text.rstrip(_PADDING), (warning,) if mark and left_out else ()


def _decoded(content: bytes) -> str:
    for mark, encoding in ((b"\xef\xbb\xbf", "utf-8"), (b"\xff\xfe", "utf-16-le"), (b"\xfe\xff", "utf-16-be")):
        if content.startswith(mark):
            return content[len(mark) :].decode(encoding, "replace")
    head = content[:_SAMPLE]
    for encoding, zeros in (("utf-16-le", head[1::2]), ("utf-16-be", head[0::2])):
        if _NUL_SHARE * len(zeros) < zeros.count(0) > 0.5 * head.count(0):
            return content.decode(encoding, "replace")
    for encoding in ("utf-8", "cp1252"):
        try:
            return content.decode(encoding)
        except UnicodeDecodeError:
            continue
    return content.decode("latin-1").replace("\x85", "…")
