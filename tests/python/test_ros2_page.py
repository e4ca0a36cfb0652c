"""The node of docs/howto/ros2.md does what it says, on stand-ins for the classes of ROS 2."""

import re
import sys
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest

from cgroup.datasets import standin_pair
from cgroup.io import write_cloud
from cgroup.types import PointCloud

pytest.importorskip("scipy", reason="the node turns matrices into quaternions with scipy")
from scipy.spatial.transform import Rotation

PAGE = Path(__file__).parents[2] / "docs/howto/ros2.md"
PARAMETERS: dict[str, str] = {}


class Node:
    """rclpy's, as far as the page uses it."""

    def __init__(self, name):
        self.name, self.parameters, self.subscriptions, self.logger = name, {}, [], MagicMock()

    def declare_parameter(self, name, value):
        self.parameters[name] = PARAMETERS.get(name, value)

    def get_parameter(self, name):
        return SimpleNamespace(value=self.parameters[name])

    def create_subscription(self, kind, topic, callback, qos):
        self.subscriptions.append((kind, topic, callback, qos))

    def get_logger(self):
        return self.logger


class PointCloud2:
    """Points in bytes, with a field that is none of x, y, z."""

    def __init__(self, points, frame):
        layout = np.dtype([("x", "<f4"), ("y", "<f4"), ("intensity", "<f4"), ("z", "<f4")])
        table = np.zeros(len(points), layout)
        table["x"], table["y"], table["z"] = points.T
        self.data, self.layout = table.tobytes(), layout
        self.header = SimpleNamespace(stamp=SimpleNamespace(sec=7, nanosec=0), frame_id=frame)


def read_points_numpy(cloud, field_names=None, skip_nans=False):
    table = np.frombuffer(cloud.data, cloud.layout)
    points = np.stack([table[name] for name in field_names], axis=1)
    return points[np.isfinite(points).all(axis=1)] if skip_nans else points


@pytest.fixture
def node_class(monkeypatch):
    stand_ins = {
        "rclpy.node": {"Node": Node},
        "rclpy.qos": {"qos_profile_sensor_data": SimpleNamespace(depth=5)},
        "sensor_msgs.msg": {"PointCloud2": PointCloud2},
        "sensor_msgs_py.point_cloud2": {"read_points_numpy": read_points_numpy},
    }
    for name in (
        "rclpy",
        "geometry_msgs",
        "geometry_msgs.msg",
        "sensor_msgs",
        "sensor_msgs_py",
        "tf2_ros",
        *stand_ins,
    ):
        monkeypatch.setitem(sys.modules, name, MagicMock(**stand_ins.get(name, {})))
    (block,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)
    namespace = {"__name__": "localize"}
    exec(compile(block, PAGE.name, "exec"), namespace)
    return namespace["Localizer"]


def upright(pair):
    """Turn the target so that the z axis is the same direction in both clouds, as a map's is."""
    rotation = pair.T_target_source[:3, :3]
    return pair.target.points @ rotation, pair.T_target_source[:3, 3] @ rotation


def test_node_broadcasts_the_pose(node_class, tmp_path, monkeypatch):
    pair = standin_pair(seed=1, pixels=100)
    points, place = upright(pair)
    write_cloud(tmp_path / "map.ply", PointCloud(points))
    monkeypatch.setitem(PARAMETERS, "map", str(tmp_path / "map.ply"))
    node = node_class()
    ((kind, topic, callback, qos),) = node.subscriptions
    assert (kind, topic, qos.depth) == (PointCloud2, "points", 1)

    seen = np.concatenate([pair.source.points, np.full((3, 3), np.nan)])
    callback(PointCloud2(seen, "lidar"))
    node.broadcaster.sendTransform.assert_called_once()
    ((message,), _) = node.broadcaster.sendTransform.call_args
    assert (message.header.frame_id, message.child_frame_id) == ("map", "lidar")
    assert message.header.stamp.sec == 7
    to, turn = message.transform.translation, message.transform.rotation
    assert np.abs(np.array([to.x, to.y, to.z]) - place).max() < 1
    assert Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).magnitude() < np.radians(1)


def test_node_stays_silent_where_it_cannot_tell(node_class, tmp_path, monkeypatch):
    write_cloud(tmp_path / "map.ply", standin_pair(seed=1, pixels=100).target)
    monkeypatch.setitem(PARAMETERS, "map", str(tmp_path / "map.ply"))
    node = node_class()
    ((_, _, callback, _),) = node.subscriptions
    callback(PointCloud2(standin_pair(seed=2, pixels=100).source.points, "lidar"))
    callback(PointCloud2(np.zeros((0, 3)), "lidar"))
    node.broadcaster.sendTransform.assert_not_called()
    assert node.logger.warning.call_count == 2
