"""Recordings of ROS 2 with clouds, written by rosbags."""

from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_HUMBLE)
KIND = "sensor_msgs/msg/PointCloud2"


def cloud_message(
    points: np.ndarray, stamp: float = 0.0, *, big: bool = False, kind: str = "f4", **changed: Any
) -> Any:
    """Make a message with a gap before x, an intensity in between, and padding behind each point."""
    types, order = STORE.types, ">" if big else "<"
    size = np.dtype(kind).itemsize
    names, offsets = ["x", "y", "intensity", "z"], [4, 4 + size, 4 + 2 * size, 8 + 2 * size]
    formats = [order + kind, order + kind, order + "f4", order + kind]
    record = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": 24 + 3 * size})
    rows = np.zeros(len(points), record)
    for column, name in enumerate("xyz"):
        rows[name] = points[:, column]
    codes = {"f4": 7, "f8": 8}
    fields = [
        types["sensor_msgs/msg/PointField"](name, offset, codes[form[1:]], 1)
        for name, offset, form in zip(names, offsets, formats, strict=True)
    ]
    stamped = types["builtin_interfaces/msg/Time"](int(stamp), round((stamp % 1) * 1e9))
    parts = {
        "header": types["std_msgs/msg/Header"](stamped, "lidar"),
        "height": 1,
        "width": len(points),
        "fields": fields,
        "is_bigendian": big,
        "point_step": record.itemsize,
        "row_step": record.itemsize * len(points),
        "data": np.frombuffer(rows.tobytes(), np.uint8),
        "is_dense": False,
    }
    return types[KIND](**{**parts, **changed})


def write_bag(folder: Path, topics: dict[str, list[Any]], *, mcap: bool = True) -> Path:
    """Write messages by topic, and return the recording's file."""
    plugin = StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3
    with Writer(folder, version=9, storage_plugin=plugin) as writer:
        for topic, messages in topics.items():
            connection = writer.add_connection(topic, KIND, typestore=STORE)
            for row, message in enumerate(messages):
                writer.write(connection, row, STORE.serialize_cdr(message, KIND))
    return next(path for path in folder.iterdir() if path.suffix in (".mcap", ".db3"))
