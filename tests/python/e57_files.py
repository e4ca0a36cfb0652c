"""Small E57 files, written by hand: pages with checksums, packets of bits, and the XML that describes them."""

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np

PAGE, USED = 1024, 1020

FLOAT = 'type="Float"'
SINGLE = 'type="Float" precision="single"'


def crc32c(content: bytes) -> int:
    """Bit by bit, as it is defined."""
    value = 0xFFFFFFFF
    for byte in content:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (0x82F63B78 if value & 1 else 0)
    return value ^ 0xFFFFFFFF


def seal(content: bytes) -> bytes:
    """Give the pages of a file the checksums of what they hold."""
    used = [content[start : start + USED] for start in range(0, len(content) // PAGE * PAGE, PAGE)]
    return b"".join(page + struct.pack(">I", crc32c(page)) for page in used)


def scaled(bits: int, scale: float, offset: float, least: int = 0) -> str:
    """A field of so many bits."""
    most = least + 2**bits - 1
    return f'type="ScaledInteger" minimum="{least}" maximum="{most}" scale="{scale!r}" offset="{offset!r}"'


def integer(least: int, most: int) -> str:
    return f'type="Integer" minimum="{least}" maximum="{most}"'


def encode(kind: str, values: Sequence[float] | np.ndarray) -> bytes:
    """Write numbers as a stream of bits; those of integers as they are stored."""
    if "Float" in kind:
        return np.asarray(values, "<f4" if "single" in kind else "<f8").tobytes()
    words = dict(part.split("=") for part in kind.split() if "=" in part)
    least, most = (int(words.get(name, default).strip('"')) for name, default in LIMITS)
    bits = (most - least).bit_length()
    if bits == 0:
        return b""
    stream = sum((int(value) - least) << i * bits for i, value in enumerate(values))
    return stream.to_bytes((len(values) * bits + 7) // 8, "little")


LIMITS = (("minimum", str(-(2**63))), ("maximum", str(2**63 - 1)))


def packets(streams: Sequence[bytes], size: int) -> bytes:
    """Streams in pieces of at most `size` bytes, an empty packet between the pieces."""
    rounds = max(1, *(-(-len(stream) // size) for stream in streams))
    written = []
    for i in range(rounds):
        pieces = [stream[i * size : (i + 1) * size] for stream in streams]
        body = struct.pack(f"<{len(pieces)}H", *map(len, pieces)) + b"".join(pieces)
        body += bytes(-(6 + len(body)) % 4)
        written.append(struct.pack("<BBHH", 1, 0, 5 + len(body), len(pieces)) + body)
    return struct.pack("<BBH", 2, 0, 3).join(written)


def address(logical: int) -> int:
    return logical // USED * PAGE + logical % USED


def e57(*scans: tuple[dict[str, tuple[str, Any]], str], size: int = 40) -> bytes:
    """Write scans: of each its fields (name, kind, numbers as they are stored), and further XML such as a pose."""
    body, children = bytes(48), ""
    for fields, more in scans:
        sections = packets([encode(kind, values) for kind, values in fields.values()], size)
        start = len(body)
        head = struct.pack("<B7xQQQ", 1, 32 + len(sections), address(start + 32), 0)
        body += head + sections
        count = len(next(iter(fields.values()))[1])
        prototype = "".join(f"<{name} {kind}/>" for name, (kind, _) in fields.items())
        children += (
            f'<vectorChild type="Structure">{more}<points type="CompressedVector" fileOffset="{address(start)}" '
            f'recordCount="{count}"><prototype type="Structure">{prototype}</prototype></points></vectorChild>'
        )
    xml = (
        '<?xml version="1.0" encoding="UTF-8"?><e57Root type="Structure" xmlns="http://www.astm.org/COMMIT/E57/2010-e57-v1.0" '
        f'xmlns:nor="http://www.libe57.org/E57_NOR_surface_normals.txt"><data3D type="Vector">{children}</data3D></e57Root>'
    ).encode()
    start = len(body)
    body += xml
    body += bytes(-len(body) % USED)
    length = len(body) // USED * PAGE
    body = struct.pack("<8sIIQQQQ", b"ASTM-E57", 1, 0, length, address(start), len(xml), PAGE) + body[48:]
    return seal(b"".join(body[i : i + USED] + bytes(4) for i in range(0, len(body), USED)))


def pose(x: float, y: float, z: float, quaternion: Sequence[float] = (1, 0, 0, 0)) -> str:
    """A pose, whose quaternion is w x y z; parts that are 0 stand there empty, as libraries write them."""

    def parts(names: str, values: Sequence[float]) -> str:
        return "".join(
            f'<{name} type="Float">{value!r}</{name}>' if value else f'<{name} type="Float"/>'
            for name, value in zip(names, values, strict=True)
        )

    return (
        f'<pose type="Structure"><rotation type="Structure">{parts("wxyz", quaternion)}</rotation>'
        f'<translation type="Structure">{parts("xyz", (x, y, z))}</translation></pose>'
    )
