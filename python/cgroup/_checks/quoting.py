"""Quote values and names in messages: short, on one line, printable."""

import reprlib

_LONGEST = 160


def show(value: object) -> str:
    """Return the representation of a value, truncated if it is long."""
    try:
        text = _REPR.repr(value)
    except Exception:  # noqa: BLE001 - the message is about another error
        text = f"<{type(value).__name__}>"
    return cut(escape(" ".join(text.split())))


def escape(text: str) -> str:
    """Return a text with unprintable characters escaped, such as newlines and lone surrogates."""
    if text.isprintable():
        return text
    parts = (one if one.isprintable() else one.encode("unicode_escape").decode("ascii") for one in text)
    return "".join(parts)


def cut(text: str) -> str:
    """Return a text, truncated if it is long."""
    return text if len(text) <= _LONGEST else text[: _LONGEST - 3] + "..."


_REPR = reprlib.Repr()
_REPR.maxother = _REPR.maxstring = _LONGEST
_REPR.maxlong = 40
