"""Builds a tree over triangles on the host: binned surface-area heuristic, one vectorised pass a level."""

from typing import NamedTuple

import numpy as np

# Triangles of a leaf, at most.
LEAF_SIZE = 4
NUM_BINS = 16
# From this level on nodes are halved by count, so that no arrangement of triangles makes the tree deep.
MAX_HEURISTIC_LEVEL = 40
NUM_OCTANTS = 8


class Topology(NamedTuple):
    """A binary tree over triangles, numbered in depth-first order: no coordinates, so moving vertices keep it.

    Attributes:
        order: Triangles in the order of the leaves, (F,).
        first: Place in `order` where each node's leaf starts, (N + 1,); the next entry ends it. Equal for inner nodes.
        links: Next node to visit after a miss and after a hit of each node's box, (8, N, 2), for rays of each octant:
            nearer children come first. N means done.
        inner: Inner nodes, children before parents.
        second: Second child of each of `inner`; the first is the next number.
    """

    order: np.ndarray
    first: np.ndarray
    links: np.ndarray
    inner: np.ndarray
    second: np.ndarray


class _Level(NamedTuple):
    """Nodes of one depth, in order."""

    is_inner: np.ndarray
    middle: np.ndarray
    leaf_faces: np.ndarray
    leaf_counts: np.ndarray


def build_topology(lower: np.ndarray, upper: np.ndarray) -> Topology:
    """Group triangles so that the expected number of box and triangle tests of a random ray is small.

    Each level splits every node by the best of 15 planes across the widest axis of its centroids, by the surface-area
    heuristic (cost of a side = its surface × its triangles). Where all centroids are equal, or the level is deep, a
    node is halved by count: millions of copies of one triangle make a balanced tree.

    Args:
        lower: (F, 3) lower corners of the triangles' boxes.
        upper: (F, 3) upper corners.
    """
    # Only ratios matter below: with the scene scaled to size 1 no product can overflow.
    origin = lower.min(axis=0)
    scale = np.maximum((upper.max(axis=0) - origin).max(), np.finfo(lower.dtype).tiny)
    lower, upper = (lower - origin) / scale, (upper - origin) / scale
    return _number(_levels(0.5 * (lower + upper), np.concatenate([lower, -upper], axis=1)), len(lower))


def _levels(middle: np.ndarray, bounds: np.ndarray) -> list[_Level]:
    """All nodes, level by level; the children of a level's inner nodes follow each other on the next."""
    order = np.arange(len(middle), dtype=np.int32)
    counts = np.array([len(middle)])
    levels: list[_Level] = []
    while len(counts):
        starts = np.cumsum(counts) - counts
        inner = counts > LEAF_SIZE
        keep = np.repeat(inner, counts)
        # Mean centroid of each node, by which children are ordered for every octant.
        centre = np.add.reduceat(middle, starts) / counts[:, None]
        levels.append(_Level(inner, centre, order[~keep], counts[~inner]))
        if not keep.all():
            order, middle, bounds = order[keep], middle[keep], bounds[keep]
        counts = counts[inner]
        if not len(counts):
            break
        places, num_left = _split(middle, bounds, counts, len(levels) > MAX_HEURISTIC_LEVEL)
        order, middle, bounds = order[places], middle[places], bounds[places]
        counts = np.stack([num_left, counts - num_left], axis=1).reshape(-1)
    return levels


def _split(middle: np.ndarray, bounds: np.ndarray, counts: np.ndarray, by_count: bool) -> tuple[np.ndarray, np.ndarray]:
    """New order of the triangles of all nodes of a level, and how many of each node go to its first child."""
    starts = np.cumsum(counts) - counts
    num_nodes, halves = len(counts), counts // 2
    if by_count:
        return np.arange(len(middle)), halves
    low, high = np.minimum.reduceat(middle, starts), np.maximum.reduceat(middle, starts)
    each = np.arange(num_nodes)
    axis = np.argmax(high - low, axis=1)
    low, size = low[each, axis], (high - low)[each, axis]
    # A size too small to divide by counts as none: all centroids then fall into one bin.
    spread = size > 1e-30
    scale = np.where(spread, NUM_BINS / np.where(spread, size, 1), 0)
    node = np.repeat(each.astype(np.int32), counts)
    along = middle[np.arange(len(middle)), axis[node]]
    # One key for node and bin: a stable sort by it groups the triangles of all nodes of the level at once.
    key = node * NUM_BINS + np.minimum(((along - low[node]) * scale[node]).astype(np.int32), NUM_BINS - 1)
    num_keys = num_nodes * NUM_BINS
    # Sixteen-bit keys are sorted by counting, several times faster.
    places = np.argsort(key.astype(np.uint16) if num_keys <= 65536 else key, kind="stable")
    filled = np.bincount(key, minlength=num_keys)
    full = np.flatnonzero(filled)
    boxes = np.full((num_keys, 6), np.inf, bounds.dtype)
    boxes[full] = np.minimum.reduceat(bounds[places], (np.cumsum(filled) - filled)[full])
    boxes = boxes.reshape(num_nodes, NUM_BINS, 6)
    num_left = np.cumsum(filled.reshape(num_nodes, NUM_BINS), axis=1)[:, :-1]
    num_right = counts[:, None] - num_left
    # Boxes as (lower, −upper) join by one minimum: running minima from both ends give both sides of all 15 planes.
    left = _surface(np.minimum.accumulate(boxes, axis=1)[:, :-1])
    right = _surface(np.minimum.accumulate(boxes[:, ::-1], axis=1)[:, -2::-1])
    cost = np.where((num_left > 0) & (num_right > 0), left * num_left + right * num_right, np.inf)
    best = np.argmin(cost, axis=1)
    return places, np.where(np.isfinite(cost[each, best]), num_left[each, best], halves)


def _surface(boxes: np.ndarray) -> np.ndarray:
    """Half the surface of boxes given as (lower, −upper); 0 for an empty one."""
    size = np.maximum(-boxes[..., 3:] - boxes[..., :3], 0)
    return size[..., 0] * size[..., 1] + size[..., 1] * size[..., 2] + size[..., 2] * size[..., 0]


def _number(levels: list[_Level], num_faces: int) -> Topology:
    """Number nodes in depth-first order and link them for every octant of directions."""
    # From below: nodes and triangles in the subtree of every node.
    sizes: list[tuple[np.ndarray, np.ndarray]] = []
    for level in reversed(levels):
        nodes, faces = np.ones(len(level.is_inner), np.int64), np.zeros(len(level.is_inner), np.int64)
        faces[~level.is_inner] = level.leaf_counts
        if sizes:
            below = [size.reshape(-1, 2).sum(axis=1) for size in sizes[0]]
            nodes[level.is_inner] += below[0]
            faces[level.is_inner] = below[1]
        sizes.insert(0, (nodes, faces))
    num_nodes = int(sizes[0][0][0])
    order = np.empty(num_faces, np.int32)
    first = np.full(num_nodes + 1, num_faces, np.int32)
    links = np.empty((NUM_OCTANTS, num_nodes, 2), np.int32)
    links[:, 0, 0] = num_nodes
    inner, second = [], []
    # From above: a first child follows its parent, a second one the subtree of the first.
    place, start = np.zeros(1, np.int64), np.zeros(1, np.int64)
    for depth, level in enumerate(levels):
        first[place] = start
        leaves = ~level.is_inner
        spots = np.repeat(start[leaves] - (np.cumsum(level.leaf_counts) - level.leaf_counts), level.leaf_counts)
        order[spots + np.arange(len(spots))] = level.leaf_faces
        links[:, place[leaves], 1] = links[:, place[leaves], 0]
        parents, begin = place[level.is_inner], start[level.is_inner]
        if not len(parents):
            break
        nodes, faces = (size.reshape(-1, 2) for size in sizes[depth + 1])
        one, two = parents + 1, parents + 1 + nodes[:, 0]
        inner.append(parents)
        second.append(two)
        # From the first child to the second, along the axis on which they lie farthest apart.
        apart = levels[depth + 1].middle.reshape(-1, 2, 3)
        apart = apart[:, 1] - apart[:, 0]
        axis = np.argmax(np.abs(apart), axis=1)
        ascending = apart[np.arange(len(axis)), axis] >= 0
        for octant in range(NUM_OCTANTS):
            backwards = (octant >> axis) & 1 == 1
            near, far = np.where(ascending ^ backwards, one, two), np.where(ascending ^ backwards, two, one)
            table = links[octant]
            # On a hit go to the nearer child, on its miss to the farther one, and from there to where the parent's miss
            # goes.
            table[parents, 1] = near
            table[near, 0] = far
            table[far, 0] = table[parents, 0]
        place = np.stack([one, two], axis=1).reshape(-1)
        start = np.stack([begin, begin + faces[:, 0]], axis=1).reshape(-1)
    none = [np.zeros(0, np.int64)]
    bottom_up = [np.concatenate((none + part)[::-1]).astype(np.int32) for part in (inner, second)]
    return Topology(order, first, links, *bottom_up)
