"""How far apart colours look, also to people who are colour-blind."""

import numpy as np

# Machado, Oliveira, Fernandes: A physiologically-based model for simulation of color vision deficiency (2009),
# severity 1, on linear RGB.
VISIONS = {
    "normal": np.eye(3),
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
    "tritanopia": np.array(
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]]
    ),
}

_XYZ_OF_RGB = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
_WHITE = _XYZ_OF_RGB.sum(axis=1)


def lab(colors: list[str], vision: str) -> np.ndarray:
    """(n,3) CIELAB coordinates of colours #RRGGBB as somebody sees them."""
    coded = np.array([[int(color[i : i + 2], 16) for i in (1, 3, 5)] for color in colors]) / 255
    linear = np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)
    ratio = np.clip(linear @ VISIONS[vision].T, 0, 1) @ _XYZ_OF_RGB.T / _WHITE
    x, y, z = np.where(ratio > 216 / 24389, np.cbrt(ratio), (24389 / 27 * ratio + 16) / 116).T
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=1)


def ciede2000(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Distances of CIELAB colours, (n,m); formulas as Sharma, Wu, Dalal (2005) number them."""
    (l1, a1, b1), (l2, a2, b2) = first.T[:, :, None], second.T[:, None, :]
    mean_ab = (np.hypot(a1, b1) + np.hypot(a2, b2)) / 2  # (3)
    gain = 1.5 - 0.5 * np.sqrt(mean_ab**7 / (mean_ab**7 + 25**7))  # (4), (5)
    c1, c2 = np.hypot(gain * a1, b1), np.hypot(gain * a2, b2)  # (6)
    h1, h2 = np.degrees(np.arctan2(b1, gain * a1)) % 360, np.degrees(np.arctan2(b2, gain * a2)) % 360  # (7)
    turn = np.where(c1 * c2 == 0, 0, (h2 - h1 + 180) % 360 - 180)  # (10)
    d_l, d_c, d_h = l2 - l1, c2 - c1, 2 * np.sqrt(c1 * c2) * np.sin(np.radians(turn) / 2)  # (8), (9), (11)
    l_, c, h = (l1 + l2) / 2, (c1 + c2) / 2, (h1 + turn / 2) % 360  # (12)-(14)
    t = (
        1
        - 0.17 * np.cos(np.radians(h - 30))
        + 0.24 * np.cos(np.radians(2 * h))
        + 0.32 * np.cos(np.radians(3 * h + 6))
        - 0.20 * np.cos(np.radians(4 * h - 63))
    )  # (15)
    turning = -np.sin(2 * np.radians(30 * np.exp(-(((h - 275) / 25) ** 2))))  # (16), (21)
    turning *= 2 * np.sqrt(c**7 / (c**7 + 25**7))  # (17)
    s_l = 1 + 0.015 * (l_ - 50) ** 2 / np.sqrt(20 + (l_ - 50) ** 2)  # (18)
    s_c, s_h = 1 + 0.045 * c, 1 + 0.015 * c * t  # (19), (20)
    x, y, z = d_l / s_l, d_c / s_c, d_h / s_h
    return np.sqrt(x**2 + y**2 + z**2 + turning * y * z)  # (22)
