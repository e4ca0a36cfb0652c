"""
Keypoints
=========

Keypoints of both detectors, at their default radius, and limited to 200.
"""

from cgroup.datasets import standin_pair
from cgroup.plots import keypoints_figure
from cgroup.registration import detect

scan = standin_pair().source
keypoints = {
    "Harris 3D": detect(scan, detector="h3d"),
    "ISS": detect(scan, detector="iss"),
    "Harris 3D, keypoints=200": detect(scan, detector="h3d", keypoints=200),
    "ISS, keypoints=200": detect(scan, detector="iss", keypoints=200),
}
figure = keypoints_figure(scan.points, keypoints, title="Keypoints of a generated scan")
figure.savefig("keypoints.png")
for name, rows in keypoints.items():
    print(f"{name:25} {len(rows):5} of {len(scan)} points")
