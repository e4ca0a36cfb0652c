"""Pose graphs by dense Levenberg-Marquardt with Jacobians of finite differences, from the equations alone."""

import numpy as np


def exponential(twist):
    """Motion of a twist, by the power series of its 4x4 matrix, halved ten times and squared back."""
    (a, b, c), shift = twist[:3], twist[3:]
    generator = np.zeros((4, 4))
    generator[:3, :3] = [[0, -c, b], [c, 0, -a], [-b, a, 0]]
    generator[:3, 3] = shift
    generator /= 1024
    motion, term = np.eye(4), np.eye(4)
    for k in range(1, 12):
        term = term @ generator / k
        motion = motion + term
    return np.linalg.matrix_power(motion, 1024)


def logarithm(motion):
    """Twist of a motion, angle at most pi: the rotation vector by its axis, the translation by a linear system."""
    rotation = motion[:3, :3]
    values, vectors = np.linalg.eigh((rotation + rotation.T) / 2)
    axis = vectors[:, np.argmax(values)]
    skew = np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    sine, cosine = np.linalg.norm(skew) / 2, (np.trace(rotation) - 1) / 2
    angle = np.arctan2(sine, cosine)
    if skew @ axis < 0:
        axis = -axis
    turn = skew / 2 if angle < 1e-7 else axis * angle
    steps = np.stack([exponential(np.concatenate([turn, unit]))[:3, 3] for unit in np.eye(3)], axis=1)
    return np.concatenate([turn, np.linalg.solve(steps, motion[:3, 3])])


def errors(poses, edges, measurements):
    """e = log(Z^-1 T_i^-1 T_j) of each edge."""
    return np.array(
        [
            logarithm(np.linalg.inv(measured) @ np.linalg.inv(poses[i]) @ poses[j])
            for (i, j), measured in zip(edges, measurements, strict=True)
        ]
    ).reshape(-1, 6)


def cost(poses, edges, measurements, information):
    """Half the weighted squares."""
    return 0.5 * sum(e @ w @ e for e, w in zip(errors(poses, edges, measurements), information, strict=True))


def normal_matrix(poses, edges, measurements, information, held):
    """J' W J and J' W e of the twists of nodes that aren't held, by central differences."""
    free = [node for node in range(len(poses)) if node not in held]
    root = [np.linalg.cholesky(w).T for w in information]

    def residual(at):
        return np.concatenate([r @ e for r, e in zip(root, errors(at, edges, measurements), strict=True)])

    columns = []
    for node in free:
        for k in range(6):
            ends = []
            for sign in (1, -1):
                moved = np.array(poses)
                moved[node] = moved[node] @ exponential(sign * 1e-6 * np.eye(6)[k])
                ends.append(residual(moved))
            columns.append((ends[0] - ends[1]) / 2e-6)
    jacobian = np.stack(columns, axis=1)
    return free, jacobian.T @ jacobian, jacobian.T @ residual(poses)


def optimize(poses, edges, measurements, information, held):
    """Poses of a minimum near the given ones."""
    poses, damping = np.array(poses, dtype=float), 1e-4
    best = cost(poses, edges, measurements, information)
    for _ in range(60):
        free, matrix, slope = normal_matrix(poses, edges, measurements, information, held)
        step = -np.linalg.solve(matrix + damping * np.diag(np.diag(matrix)), slope).reshape(-1, 6)
        moved = poses.copy()
        for node, twist in zip(free, step, strict=True):
            moved[node] = moved[node] @ exponential(twist)
        reached = cost(moved, edges, measurements, information)
        if reached <= best:
            done = best - reached <= 1e-10 * best
            poses, best, damping = moved, reached, damping / 10
            if done:
                break
        else:
            damping *= 10
    return poses
