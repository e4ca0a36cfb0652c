"""Checksums of rows: whether they are still what was written."""

from __future__ import annotations

import hashlib
import struct
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

_NUMBER = struct.Struct("<cd")


def checksum(row: Sequence[object]) -> bytes:
    """Hash a row, the same before it is stored and after it is read again.

    Parameters
    ----------
    row : sequence of None, bool, int, float, str or bytes
        All columns but the checksum. SQLite turns whole numbers into real ones, NaN into NULL; both are the
        same here.

    Returns
    -------
    bytes
        BLAKE2b, 8 bytes.
    """
    parts: list[bytes] = []
    for value in row:
        if isinstance(value, str):
            text = value.encode("utf-8", "surrogateescape")
            parts += (b"t%d:" % len(text), text)
        elif isinstance(value, bytes):
            parts += (b"b%d:" % len(value), value)
        elif value is None or value != value:  # noqa: PLR0124 - NaN
            parts.append(b"n")
        else:
            parts.append(_NUMBER.pack(b"d", value))
    return hashlib.blake2b(b"".join(parts), digest_size=8).digest()


def is_whole(row: Sequence[object]) -> bool:
    """Tell whether a row, the last column of which is its checksum, is as it was written."""
    return row[-1] == checksum(row[:-1])


def decode_text(content: bytes) -> str:
    """Text of a column, also where it is damaged; for `sqlite3.Connection.text_factory`."""
    return content.decode("utf-8", "surrogateescape")
