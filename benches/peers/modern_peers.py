"""The modern methods as one can have them elsewhere: TEASER++ and CLIPPER, plain PyTorch and networkx.

SC2-PCR, TurboReg and MAC come as research code (CUDA, PCL, igraph); here they are written anew, dense,
as that code computes them. TEASER++ and CLIPPER have to be built from their repositories and found on
PYTHONPATH.
"""

from __future__ import annotations

import functools
import itertools
from typing import TYPE_CHECKING, Any

import numpy as np

from peers.answers import rigid
from peers.cases import INLIER_RESIDUAL

if TYPE_CHECKING:
    from peers.answers import Answer, Call, Make
    from peers.cases import Array, Case

TEASER_BOUND, TEASER_STEPS, TEASER_FACTOR, TEASER_COST = 2.5, 100, 1.4, 1e-6
CLIQUE_SECONDS = 100.0
CLIPPER_SIGMA, CLIPPER_EPSILON = 5.0 / 3.0, 5.0
SC2_DISTANCE, SC2_TOLERANCE, SC2_NMS, SC2_RATIO = 10.0, 5.0, 5.0, 0.2
SC2_FIRST, SC2_SECOND, POWER_STEPS, ROUNDS = 30, 20, 10, 20
TURBO_DISTANCE, TURBO_SHORTEST, TURBO_PIVOTS, TURBO_THIRDS = 1.0, 10.0, 2000, 2
MAC_SCALE, MAC_CUT, MAC_TOLERANCE, MAC_CLIQUES = 10.0, 0.99, 5.0, 200_000


def teaser(case: Case, _threads: int, *, exact: bool) -> Call:
    """Prune by the maximum clique, or the k-core, of the consistency graph, then solve by GNC."""
    import _teaserpp  # noqa: PLC0415 - each library only where its own peers run

    parameters = _teaserpp.RobustRegistrationSolver.Params()
    parameters.noise_bound = TEASER_BOUND
    parameters.cbar2 = 1
    parameters.estimate_scaling = False
    parameters.inlier_selection_mode = (
        _teaserpp.InlierSelectionMode.PMC_EXACT if exact else _teaserpp.InlierSelectionMode.KCORE_HEU
    )
    parameters.rotation_gnc_factor = TEASER_FACTOR
    parameters.rotation_max_iterations = TEASER_STEPS
    parameters.rotation_cost_threshold = TEASER_COST
    parameters.max_clique_time_limit = CLIQUE_SECONDS
    source, target = (np.ascontiguousarray(case[key].T, dtype=float) for key in ("src", "tgt"))

    def call() -> Answer:
        solver = _teaserpp.RobustRegistrationSolver(parameters)
        solver.solve(source, target)
        solution = solver.getSolution()
        return None, rigid(solution.rotation, solution.translation)

    return call


def clipper(case: Case, _threads: int) -> Call:
    """Relax the densest clique of the consistency graph."""
    import clipperpy  # noqa: PLC0415

    bounds = clipperpy.invariants.EuclideanDistanceParams()
    bounds.sigma, bounds.epsilon, bounds.mindist = CLIPPER_SIGMA, CLIPPER_EPSILON, 0.0
    source, target = (np.ascontiguousarray(case[key].T, dtype=float) for key in ("src", "tgt"))
    n = source.shape[1]
    rows = np.repeat(np.arange(n, dtype=np.int32)[:, None], 2, axis=1)

    def call() -> Answer:
        solver = clipperpy.CLIPPER(clipperpy.invariants.EuclideanDistance(bounds), clipperpy.Params())
        solver.score_pairwise_consistency(source, target, rows)
        solver.solve()
        mask = np.zeros(n, bool)
        mask[np.asarray(solver.get_selected_associations())[:, 0]] = True
        return mask, None

    return call


def sc2pcr(case: Case, threads: int) -> Call:
    """Second-order compatibility of seeds, dense, in PyTorch on the CPU."""
    import torch  # noqa: PLC0415

    torch.set_num_threads(threads)
    source, target = _tensors(torch, case)

    def call() -> Answer:
        starts = torch.cdist(source, source)
        difference = (starts - torch.cdist(target, target)).abs()
        soft = (1 - (difference / SC2_DISTANCE) ** 2).clamp(min=0)
        confidence = _leading(torch, soft)
        beaten = (confidence[None, :] > confidence[:, None]) & (starts < SC2_NMS)
        peaks = confidence * ~beaten.any(dim=1)
        seeds = torch.argsort(peaks, descending=True)[: int(len(source) * SC2_RATIO)]
        loose, tight = (difference < SC2_DISTANCE).float(), (difference < SC2_DISTANCE / 2).float()
        second = (tight[seeds] @ tight) * loose[seeds]
        poses = _seed_poses(torch, second, source, target)
        best = _most_inliers(torch, poses, source, target)
        return None, _refined(best.double().numpy(), case)

    return call


def turboreg(case: Case, threads: int) -> Call:
    """Triangles over the heaviest edges of an ordered second-order graph, dense, in PyTorch on the CPU."""
    import torch  # noqa: PLC0415

    torch.set_num_threads(threads)
    source, target = _tensors(torch, case)

    def call() -> Answer:
        starts, ends = torch.cdist(source, source), torch.cdist(target, target)
        hard = ((starts - ends).abs() < TURBO_DISTANCE).float()
        hard[starts + ends <= 2 * TURBO_SHORTEST] = 0
        ordered = torch.triu((hard @ hard) * hard, diagonal=1)
        pivots = torch.topk(ordered.flatten(), TURBO_PIVOTS).indices
        first, second = pivots // len(source), pivots % len(source)
        weight = ordered[first, second][:, None] + ordered[first] + ordered[second]
        weight *= (ordered[first] > 0) & (ordered[second] > 0)
        thirds = torch.topk(weight, TURBO_THIRDS, dim=1)
        whole = thirds.values > 0
        pairs = torch.stack([first, second], dim=1)[:, None].expand(-1, TURBO_THIRDS, -1)
        triples = torch.cat([pairs, thirds.indices[..., None]], dim=2)[whole]
        poses = _kabsch(torch, source[triples], target[triples], torch.ones(len(triples), 3))
        return None, _refined(_most_inliers(torch, poses, source, target).double().numpy(), case)

    return call


def mac(case: Case, _threads: int) -> Call:
    """Every maximal clique of the second-order graph, by networkx, up to a number of them."""
    import networkx as nx  # noqa: PLC0415

    source, target = case["src"].astype(float), case["tgt"].astype(float)

    def call() -> Answer:
        difference = _lengths(source) - _lengths(target)
        first = np.exp(-(difference**2) / (2 * MAC_SCALE**2))
        first[first < MAC_CUT] = 0
        np.fill_diagonal(first, 0)
        second = first * (first @ first)
        graph = nx.from_numpy_array(second > 0)
        cliques = itertools.islice(nx.find_cliques(graph), MAC_CLIQUES)
        best = _heaviest_of_each(second, [clique for clique in cliques if len(clique) > 2])
        poses = [_fit(source[clique], target[clique]) for clique in best]
        errors = [_mean_agreement(case, pose) for pose in poses]
        return None, poses[int(np.argmax(errors))] if poses else None

    return call


def _tensors(torch: Any, case: Case) -> tuple[Any, Any]:  # noqa: ANN401 - PyTorch is not there to be typed
    return tuple(torch.from_numpy(np.ascontiguousarray(case[key], np.float32)) for key in ("src", "tgt"))


def _leading(torch: Any, matrix: Any) -> Any:  # noqa: ANN401
    vector = torch.ones(*matrix.shape[:-1], 1)
    for _ in range(POWER_STEPS):
        vector = matrix @ vector
        vector = vector / (vector.norm(dim=-2, keepdim=True) + 1e-6)
    return vector[..., 0]


def _seed_poses(torch: Any, second: Any, source: Any, target: Any) -> Any:  # noqa: ANN401
    members = torch.topk(second, SC2_FIRST, dim=1).indices
    difference = _differences(torch, source[members], target[members])
    hard = (difference < SC2_DISTANCE).float()
    local = torch.topk((hard[:, :1] @ hard)[:, 0], SC2_SECOND, dim=1).indices
    members = members.gather(1, local)
    difference = _differences(torch, source[members], target[members])
    soft = (1 - (difference / SC2_DISTANCE) ** 2).clamp(min=0) * (1 - torch.eye(SC2_SECOND))
    weights = _leading(torch, soft)
    return _kabsch(torch, source[members], target[members], weights / (weights.sum(1, keepdim=True) + 1e-6))


def _differences(torch: Any, source: Any, target: Any) -> Any:  # noqa: ANN401
    return (torch.cdist(source, source) - torch.cdist(target, target)).abs()


def _kabsch(torch: Any, source: Any, target: Any, weights: Any) -> Any:  # noqa: ANN401
    total = weights.sum(1)[:, None] + 1e-6
    means = [(points * weights[..., None]).sum(1) / total for points in (source, target)]
    a, b = (points - mean[:, None] for points, mean in zip((source, target), means, strict=True))
    u, _, vt = torch.linalg.svd((a * weights[..., None]).transpose(1, 2) @ b)
    signs = torch.ones(len(source), 3)
    signs[:, 2] = torch.linalg.det(u @ vt)
    poses = torch.eye(4).repeat(len(source), 1, 1)
    poses[:, :3, :3] = (vt.transpose(1, 2) * signs[:, None]) @ u.transpose(1, 2)
    poses[:, :3, 3] = means[1] - (poses[:, :3, :3] @ means[0][..., None])[..., 0]
    return poses


def _most_inliers(torch: Any, poses: Any, source: Any, target: Any) -> Any:  # noqa: ANN401
    moved = torch.einsum("snm,km->skn", poses[:, :3, :3], source) + poses[:, None, :3, 3]
    inliers = ((moved - target[None]).norm(dim=-1) < SC2_TOLERANCE).sum(dim=1)
    return poses[inliers.argmax()]


def _refined(pose: Array, case: Case) -> Array:
    """Fit again and again to all inliers, the nearer the heavier."""
    source, target = case["src"].astype(float), case["tgt"].astype(float)
    count = 0
    for _ in range(ROUNDS):
        residual = np.linalg.norm(source @ pose[:3, :3].T + pose[:3, 3] - target, axis=1)
        inliers = residual < INLIER_RESIDUAL
        if inliers.sum() == count or inliers.sum() < 3:
            break
        count = inliers.sum()
        weights = 1 / (1 + (residual[inliers] / INLIER_RESIDUAL) ** 2)
        pose = _fit(source[inliers], target[inliers], weights)
    return pose


def _fit(source: Array, target: Array, weights: Array | None = None) -> Array:
    weights = np.ones(len(source)) if weights is None else weights
    means = [np.average(points, axis=0, weights=weights) for points in (source, target)]
    u, _, vt = np.linalg.svd(((source - means[0]) * weights[:, None]).T @ (target - means[1]))
    rotation = vt.T @ np.diag([1, 1, np.linalg.det(vt.T @ u.T)]) @ u.T
    return rigid(rotation, means[1] - rotation @ means[0])


def _lengths(points: Array) -> Array:
    return np.linalg.norm(points[:, None] - points[None], axis=2)


def _heaviest_of_each(weights: Array, cliques: list[list[int]]) -> list[list[int]]:
    """Return the cliques that are the heaviest of any of their members."""
    heaviest: dict[int, tuple[float, int]] = {}
    for index, clique in enumerate(cliques):
        weight = weights[np.ix_(clique, clique)].sum()
        for member in clique:
            if weight > heaviest.get(member, (0.0, -1))[0]:
                heaviest[member] = (weight, index)
    return [cliques[index] for index in sorted({index for _, index in heaviest.values()})]


def _mean_agreement(case: Case, pose: Array) -> float:
    residual = np.linalg.norm(case["src"] @ pose[:3, :3].T + pose[:3, 3] - case["tgt"], axis=1)
    return float(np.maximum(0, 1 - residual / MAC_TOLERANCE).sum())


PEERS: dict[str, Make] = {
    "teaserpp_clique": functools.partial(teaser, exact=True),
    "teaserpp_core": functools.partial(teaser, exact=False),
    "clipper": clipper,
    "torch_sc2pcr": sc2pcr,
    "torch_turboreg": turboreg,
    "networkx_mac": mac,
}
