"""Clouds of ROS recordings: MCAP, ROS 2 bags and ROS 1 bags, one message at a time, by rosbags."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from cgroup._checks.foreign import cloud_parts
from cgroup._checks.quoting import escape
from cgroup._checks.values import as_path, as_word
from cgroup.errors import InputError
from cgroup.types import PointCloud

BAGS = (".mcap", ".db3", ".bag")
"""Suffixes of recordings that are files."""

_KIND = "sensor_msgs/msg/PointCloud2"
_SHOWN = 160  # characters of a reason


def is_bag(path: Path) -> bool:
    """Return whether a path is a recording, by its name, or its metadata if it is a folder."""
    return path.suffix.lower() in BAGS or (path / "metadata.yaml").is_file()


def read_bag(path: str | os.PathLike[str], topic: str | None = None) -> Iterator[tuple[float, PointCloud]]:
    """Read the clouds of a ROS recording one after another; extra ``cgroup[ros]``.

    Parameters
    ----------
    path : path-like
        An ``.mcap`` or ``.db3`` file, the folder of a ROS 2 bag, or a ``.bag`` of ROS 1.
    topic : str, optional
        Topic of ``sensor_msgs/PointCloud2``; needed if the recording has several.

    Yields
    ------
    tuple of (float, PointCloud)
        The time of each message's header in seconds, and its finite points, of which there may be none.
    """
    path = as_path("path", path)
    name = None if topic is None else as_word("topic", topic)
    try:
        from rosbags.highlevel import AnyReader  # noqa: PLC0415 - an extra
        from rosbags.typesys import Stores, get_typestore  # noqa: PLC0415
    except ModuleNotFoundError as missing:
        raise InputError(f"{path}: reading it needs {missing.name}; pip install 'cgroup[ros]'") from missing
    if not path.exists():
        raise InputError(f"{path}: no such file")
    where = ""
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as reader:
            messages = reader.messages(_find_topic(reader.connections, name))
            for row, (connection, _, content) in enumerate(messages, 1):
                where = f"message {row}: "
                message: Any = reader.deserialize(content, connection.msgtype)
                yield message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec, _cloud_of(message)
                where = f"message {row + 1}: "
    except InputError as error:
        raise InputError(f"{path}: {where}{error}") from error
    except Exception as error:  # of many kinds for damaged files, also for declared sizes beyond the memory
        reason = escape(" ".join(str(error).split())[:_SHOWN]) or type(error).__name__
        raise InputError(f"{path}: {where}not a readable recording, or cut off ({reason})") from error


def _find_topic(connections: list[Any], topic: str | None) -> list[Any]:
    clouds = [one for one in connections if one.msgtype == _KIND]
    topics = sorted({one.topic for one in clouds})
    found = [one for one in clouds if topic in (None, one.topic)]
    if len({one.topic for one in found}) != 1:
        shown = escape(", ".join(topics)[:_SHOWN])
        if not topics:
            raise InputError("no topic of sensor_msgs/PointCloud2")
        raise InputError(
            f"topic {escape(topic)!r} has no clouds, but {shown}"
            if topic
            else f"clouds of several topics; give one of {shown}"
        )
    return found


def _cloud_of(message: Any) -> PointCloud:  # noqa: ANN401 - of rosbags
    """Return the finite points of a message, by its fields, offsets, strides and byte order."""
    if message.height * message.width == 0:
        return PointCloud(np.empty((0, 3)))
    if (message.height - 1) * message.row_step + message.width * message.point_step > len(message.data) or (
        message.height > 1 and message.row_step < message.width * message.point_step
    ):
        raise InputError("more points than its data has bytes")
    parts = cloud_parts("its fields", message)
    if parts is None:
        raise InputError("its fields are no points")
    points = np.asarray(parts.points, dtype=np.float64)
    finite = np.isfinite(points).all(axis=1)
    return PointCloud(points[finite], dropped=len(points) - int(np.count_nonzero(finite)))
