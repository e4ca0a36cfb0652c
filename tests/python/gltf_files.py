"""Small glTF files, written by hand."""

import base64
import json
import struct
from typing import Any

import numpy as np

TYPES = {"f4": 5126, "u1": 5121, "u2": 5123, "u4": 5125, "i1": 5120, "i2": 5122}


def document(*arrays: np.ndarray, **entries: Any) -> tuple[dict[str, Any], bytes]:
    """Arrays, each an accessor of its own, and further entries of the document."""
    content, views, accessors = b"", [], []
    for array in arrays:
        content += bytes(-len(content) % 4)
        views.append({"buffer": 0, "byteOffset": len(content), "byteLength": array.nbytes})
        kind = "SCALAR" if array.ndim == 1 else f"VEC{array.shape[1]}"
        component = TYPES[array.dtype.str[1:]]
        accessors.append(
            {"bufferView": len(views) - 1, "componentType": component, "count": len(array), "type": kind}
        )
        content += array.tobytes()
    whole = {
        "asset": {"version": "2.0"},
        "bufferViews": views,
        "accessors": accessors,
        "buffers": [{"byteLength": len(content)}],
        "nodes": [{"mesh": 0}],
    }
    return whole | entries, content


def glb(entries: dict[str, Any], content: bytes) -> bytes:
    text = json.dumps(entries).encode()
    text += b" " * (-len(text) % 4)
    content += bytes(-len(content) % 4)
    length = 12 + 8 + len(text) + 8 + len(content)
    return (
        struct.pack("<4sII", b"glTF", 2, length)
        + struct.pack("<I4s", len(text), b"JSON")
        + text
        + struct.pack("<I4s", len(content), b"BIN\0")
        + content
    )


def gltf(entries: dict[str, Any], content: bytes) -> bytes:
    uri = "data:application/octet-stream;base64," + base64.b64encode(content).decode()
    return json.dumps(entries | {"buffers": [{"byteLength": len(content), "uri": uri}]}).encode()


def mesh(attributes: dict[str, int], **primitive: Any) -> list[dict[str, Any]]:
    return [{"primitives": [{"attributes": attributes} | primitive]}]
