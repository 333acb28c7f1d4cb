"""Text that may come from anywhere, made fit for a terminal."""


def warning_line(words: str) -> str:
    """A warning as one line."""
    return f"warning: {printable(' '.join(words.split()))}"


def printable(text: str) -> str:
    """``text`` with escapes for characters that steer a terminal: names in a file may come from anywhere."""
    return "".join(each if each.isprintable() or each == "\t" else ascii(each)[1:-1] for each in text)
