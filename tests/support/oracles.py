"""Plain-loop oracles: what the kernels compute, written as slowly and plainly as possible."""

from __future__ import annotations

import functools
import heapq
import itertools
import math

import numpy as np


def level_at(cells, row, col):
    if 0 <= row < cells.shape[0] and 0 <= col < cells.shape[1]:
        return int(cells[row, col])
    return 127


def similarities(template, levels):
    """Eq. 1-7, cell by cell."""
    pairs = [(int(t), int(m)) for t, m in zip(template.flat, levels.flat, strict=True)]
    mean_t = sum(t for t, _ in pairs) / len(pairs)
    mean_m = sum(m for _, m in pairs) / len(pairs)
    ssd = sad = cc = zcc = tt = mm = zt = zm = 0.0
    for t, m in pairs:
        ssd += (t - m) ** 2
        sad += abs(t - m)
        cc += t * m
        tt += t * t
        mm += m * m
        zcc += (t - mean_t) * (m - mean_m)
        zt += (t - mean_t) ** 2
        zm += (m - mean_m) ** 2

    def ratio(value, square):
        return value / math.sqrt(square) if square > 0 else math.nan

    return {
        "SSD": ssd,
        "SAD": sad,
        "NSSD": ratio(ssd, tt * mm),
        "NCC": ratio(cc, tt * mm),
        "ZNCC": ratio(zcc, zt * zm),
        "ZCC": zcc,
        "CC": cc,
    }


def mismatch_counts(cells, row, col, radius, step, half_steps, angles):
    """S / 127 for every offset, (dx, theta, dy)."""
    centre_row, centre_col = (cells.shape[0] - 1) / 2, (cells.shape[1] - 1) / 2
    offsets = range(-half_steps, half_steps + 1)
    result = np.zeros((len(offsets), len(angles), len(offsets)), np.int64)
    for k, theta in enumerate(angles):
        cos, sin = math.cos(theta), math.sin(theta)
        y, x = row - centre_row, col - centre_col
        turned_row = math.floor(sin * x + cos * y + centre_row + 0.5)
        turned_col = math.floor(cos * x - sin * y + centre_col + 0.5)
        for u in range(-radius, radius + 1):
            for v in range(-radius, radius + 1):
                if u * u + v * v > radius * radius:
                    continue
                y, x = turned_row + u - centre_row, turned_col + v - centre_col
                template = level_at(
                    cells,
                    math.floor(cos * y - sin * x + centre_row + 0.5),
                    math.floor(sin * y + cos * x + centre_col + 0.5),
                )
                for j, dy in enumerate(offsets):
                    for i, dx in enumerate(offsets):
                        level = level_at(cells, row + dy * step + u, col + dx * step + v)
                        result[i, k, j] += abs(template - level) // 127
    return result


def keep_lines(cells, row, col, radius, step, half_steps, angles, sizes, limit, shift):
    """Lines (theta, dx) with an offset in y whose bound by blocks is at most limit << shift.

    That must hold for blocks of each size; `sizes` are lists of (row, col, edge) in the disc's box.
    """
    centre_row, centre_col = (cells.shape[0] - 1) / 2, (cells.shape[1] - 1) / 2
    offsets, box = range(-half_steps, half_steps + 1), range(-radius, radius + 1)
    reach = range(-radius - half_steps * step, radius + half_steps * step + 1)
    around = np.array([[level_at(cells, row + u, col + v) for v in reach] for u in reach])

    @functools.cache
    def there(low, near, edge, level):
        return np.count_nonzero(around[low : low + edge, near : near + edge] == level)

    result = np.zeros((len(angles), len(offsets)), bool)
    for k, theta in enumerate(angles):
        cos, sin = math.cos(theta), math.sin(theta)
        y, x = row - centre_row, col - centre_col
        top = math.floor(sin * x + cos * y + centre_row + 0.5) - centre_row
        left = math.floor(cos * x - sin * y + centre_col + 0.5) - centre_col
        template = np.array(
            [
                [
                    level_at(
                        cells,
                        math.floor(cos * (top + u) - sin * (left + v) + centre_row + 0.5),
                        math.floor(sin * (top + u) + cos * (left + v) + centre_col + 0.5),
                    )
                    for v in box
                ]
                for u in box
            ]
        )
        lines = np.ones(len(offsets), bool)
        for blocks in sizes:
            bounds = np.zeros((len(offsets), len(offsets)), np.int64)
            for (first_row, first_col, edge), level in itertools.product(blocks, (254, 0)):
                part = template[first_row : first_row + edge, first_col : first_col + edge]
                here = np.count_nonzero(part == level)
                for i, j in itertools.product(range(len(offsets)), repeat=2):
                    behind = there(first_row + j * step, first_col + i * step, edge, level)
                    bounds[i, j] += abs(here - behind) >> shift
            lines &= bounds.min(axis=1) <= limit
        result[k] = lines
    return result


def block_counts(plane, edge, row, col):
    """Cells set in the square block that begins there; 0 if it ends beyond the plane."""
    if row + edge > plane.shape[1] or col + edge > plane.shape[0]:
        return 0
    return sum(int(plane[col + i, row + j]) for i in range(edge) for j in range(edge))


def cut_strips(cells, cos, sin, first_row, first_col, rows, cols):
    """Bytes of eight cells along a row of the turned map, (plane, col, row)."""
    centre_row, centre_col = (cells.shape[0] - 1) / 2, (cells.shape[1] - 1) / 2
    result = np.zeros((2, cols, rows), np.uint8)
    for i in range(cols):
        for j in range(rows):
            for bit in range(8):
                if i + bit >= cols:
                    continue
                y, x = first_row + j - centre_row, first_col + i + bit - centre_col
                level = level_at(
                    cells,
                    math.floor(cos * y - sin * x + centre_row + 0.5),
                    math.floor(sin * y + cos * x + centre_col + 0.5),
                )
                result[0, i, j] |= (level == 254) << bit
                result[1, i, j] |= (level == 0) << bit
    return result


def visible_part(cells, row, col, radius, theta, beams, behind):
    """Cells of the disc seen from a cell, turned by theta, (2r + 1, 2r + 1)."""
    reach = []
    for b in range(beams):
        angle = 2 * math.pi * b / beams
        first = 2 * radius
        for step in range(1, 2 * radius + 1):
            i = row + math.floor(math.sin(angle) * step / 2 + 0.5)
            j = col + math.floor(math.cos(angle) * step / 2 + 0.5)
            if (i, j) != (row, col) and level_at(cells, i, j) != 254:
                first = step
                break
        reach.append((first + 1) / 2 + behind)
    result = np.zeros((2 * radius + 1, 2 * radius + 1), bool)
    for u in range(-radius, radius + 1):
        for v in range(-radius, radius + 1):
            beam = math.floor((math.atan2(u, v) - theta) * beams / (2 * math.pi) + 0.5) % beams
            distance = math.hypot(u, v)
            result[u + radius, v + radius] = distance <= min(radius, reach[beam])
    return result


def weighted_covariance(counts, weight_of_count, kept, places):
    """Covariance of (dx, dy, theta) in steps about the weighted mean, of the lines kept."""
    half, half_angles = (len(places) - 1) // 2, (counts.shape[1] - 1) // 2
    poses, weights = [], []
    for i, x in enumerate(places):
        for k in range(counts.shape[1]):
            sides = {math.floor(x): 1 - x % 1, math.ceil(x): x % 1 or 1.0}
            for j, y in enumerate(places) if all(kept[k, side] for side in sides) else ():
                ends = {math.floor(y): 1 - y % 1, math.ceil(y): y % 1 or 1.0}
                terms = (p * q * counts[a, k, b] for a, p in sides.items() for b, q in ends.items())
                poses.append((i - half, j - half, k - half_angles))
                weights.append(weight_of_count[math.floor(sum(terms) + 0.5)])
    poses, weights = np.array(poses, float), np.array(weights) / math.fsum(weights)
    mean = np.array([math.fsum(weights * axis) for axis in poses.T])
    result = np.zeros((3, 3))
    for a in range(3):
        for b in range(3):
            result[a, b] = math.fsum(weights * (poses[:, a] - mean[a]) * (poses[:, b] - mean[b]))
    return result


def disc_sums(plane, radius, unit, rows, cols):
    """Cells set within the disc around every `unit` cells of one plane, (col, row)."""
    result = np.zeros((cols, rows), np.int64)
    for q in range(cols):
        for p in range(rows):
            for du in range(-radius, radius + 1):
                for dv in range(-radius, radius + 1):
                    if du * du + dv * dv <= radius * radius:
                        result[q, p] += plane[radius + q * unit + du, radius + p * unit + dv]
    return result


def cells_along(positions):
    """(row, col, length) of every cell crossed: cut at all lines, look at the middles."""
    result = []
    for (row0, col0), (row1, col1) in itertools.pairwise(positions):
        cuts = {0.0, 1.0}
        for a, b in ((row0, row1), (col0, col1)):
            if a != b:
                for line in range(math.floor(min(a, b)), math.ceil(max(a, b)) + 1):
                    cuts.add((line - a) / (b - a))
        cuts = sorted(t for t in cuts if 0 <= t <= 1)
        length = math.hypot(row1 - row0, col1 - col0)
        for low, high in itertools.pairwise(cuts):
            if (high - low) * length > 1e-9:
                middle = (low + high) / 2
                row = math.floor(row0 + middle * (row1 - row0))
                col = math.floor(col0 + middle * (col1 - col0))
                result.append((row, col, (high - low) * length))
    return result


def line_integral(density, row0, col0, row1, col1):
    """Sum of length times density over the cells of one line."""
    total = 0.0
    for row, col, length in cells_along([(row0, col0), (row1, col1)]):
        inside = 0 <= row < density.shape[0] and 0 <= col < density.shape[1]
        total += length * (density[row, col] if inside else math.inf)
    return total


def shortest_costs(density, start, corner_cutting):
    """Dijkstra with a heap from (row, col) over 8 neighbours, (H, W)."""
    rows, cols = density.shape
    cost = np.full(density.shape, np.inf)
    if not np.isfinite(density[start]):
        return cost
    cost[start] = 0.0
    heap = [(0.0, start)]

    def blocked(row, col):
        return not (0 <= row < rows and 0 <= col < cols) or density[row, col] == np.inf

    while heap:
        reached, (row, col) = heapq.heappop(heap)
        if reached > cost[row, col]:
            continue
        for drow in (-1, 0, 1):
            for dcol in (-1, 0, 1):
                there = row + drow, col + dcol
                if (drow, dcol) == (0, 0) or blocked(*there):
                    continue
                diagonal = drow != 0 and dcol != 0
                if (
                    diagonal
                    and not corner_cutting
                    and (blocked(row + drow, col) or blocked(row, col + dcol))
                ):
                    continue
                step = math.hypot(drow, dcol) * (density[row, col] + density[there]) / 2
                if reached + step < cost[there]:
                    cost[there] = reached + step
                    heapq.heappush(heap, (cost[there], there))
    return cost


def steps_back(density, cost, tolerance):
    """Bits of the steps that cost at most so much more than the cheapest way, cell by cell."""
    steps = np.zeros(density.shape, np.uint8)
    for row, col in np.ndindex(density.shape):
        around = [d for d in itertools.product((-1, 0, 1), repeat=2) if d != (0, 0)]
        for bit, (vertical, horizontal) in enumerate(around):
            at = row + vertical, col + horizontal
            if not (0 <= at[0] < density.shape[0] and 0 <= at[1] < density.shape[1]):
                continue
            corners = density[at[0], col], density[row, at[1]]
            if math.isinf(cost[row, col]) or (vertical and horizontal and math.inf in corners):
                continue
            step = (density[row, col] / 2 + density[at] / 2) * math.hypot(vertical, horizontal)
            if cost[at] + step <= cost[row, col] + tolerance:
                steps[row, col] |= 1 << bit
    return steps


def touches(row0, col0, row1, col1, row, col, margin=1e-5):
    """Whether a line comes into a cell's square, less a margin: clipped side by side."""
    enter, leave = 0.0, 1.0
    for start, delta, low in ((row0, row1 - row0, row), (col0, col1 - col0, col)):
        low, high = low + margin, low + 1 - margin
        if delta == 0:
            if not low < start < high:
                return False
            continue
        near, far = sorted(((low - start) / delta, (high - start) / delta))
        enter, leave = max(enter, near), min(leave, far)
    return enter < leave


def shortcut(density, positions, lookahead):
    """Least cost over a path's own positions, each within `lookahead` of the one before."""
    best = [0.0]
    for j in range(1, len(positions)):
        best.append(
            min(
                best[i] + line_integral(density, *positions[i], *positions[j])
                for i in range(max(0, j - lookahead), j)
            )
        )
    return best[-1]


def shift(density, positions, step, sweeps):
    """Inner positions moved sideways by a step, in turn, while that costs less."""
    shifted = [tuple(position) for position in positions]
    for _ in range(sweeps):
        before = list(shifted)
        for k in range(1, len(shifted) - 1):
            (row0, col0), (row, col), (row1, col1) = shifted[k - 1 : k + 2]
            along = math.hypot(row1 - row0, col1 - col0)
            if along == 0:
                continue
            aside = step * (col0 - col1) / along, step * (row1 - row0) / along
            tried = [(row + s * aside[0], col + s * aside[1]) for s in (0, -1, 1)]
            shifted[k] = min(
                tried,
                key=lambda at: (
                    line_integral(density, row0, col0, *at)
                    + line_integral(density, *at, row1, col1)
                ),
            )
        if shifted == before:
            break
    return shifted


def cheapest_moves(density, start, goal, reach):
    """Least cost from cell to cell over all moves to centres up to `reach` cells away."""
    moves = [
        move
        for move in itertools.product(range(-reach, reach + 1), repeat=2)
        if math.gcd(*move) == 1
    ]
    cost, heap = {start: 0.0}, [(0.0, start)]
    while heap:
        reached, cell = heapq.heappop(heap)
        if cell == goal:
            return reached
        if reached > cost[cell]:
            continue
        for move in moves:
            there = cell[0] + move[0], cell[1] + move[1]
            line = [v + 0.5 for v in (*cell, *there)]
            around = itertools.product(
                *(range(min(a, b) - 1, max(a, b) + 2) for a, b in zip(cell, there, strict=True))
            )
            blocked = any(
                level_of(density, row, col) == math.inf and touches(*line, row, col, margin=-1e-9)
                for row, col in around
            )
            step = math.inf if blocked else line_integral(density, *line)
            if reached + step < cost.get(there, math.inf):
                cost[there] = reached + step
                heapq.heappush(heap, (cost[there], there))
    return math.inf


def level_of(density, row, col):
    inside = 0 <= row < density.shape[0] and 0 <= col < density.shape[1]
    return density[row, col] if inside else math.inf


def pareto_front(layer, free, start, goal, corner_cutting):
    """All non-dominated (length, integral) from cell to cell, by correcting labels."""
    labels = {start: [(0.0, 0.0)]}
    queue = [(start, (0.0, 0.0))]
    while queue:
        (row, col), (length, integral) = queue.pop(0)
        if (length, integral) not in labels[row, col]:
            continue
        for drow, dcol in itertools.product((-1, 0, 1), repeat=2):
            there = row + drow, col + dcol
            if (drow, dcol) == (0, 0) or level_of(free, *there) != 1:
                continue
            beside = level_of(free, row + drow, col), level_of(free, row, col + dcol)
            if drow and dcol and not corner_cutting and beside != (1, 1):
                continue
            step = math.hypot(drow, dcol)
            new = length + step, integral + step * (layer[row, col] + layer[there]) / 2
            known = labels.setdefault(there, [])
            if any(a <= new[0] + 1e-9 and b <= new[1] + 1e-9 for a, b in known):
                continue
            known[:] = [(a, b) for a, b in known if a < new[0] - 1e-9 or b < new[1] - 1e-9]
            known.append(new)
            queue.append((there, new))
    return sorted(labels.get(goal, []))


def motion_cost(density, turns, lengths, radius, start, step=1e-4):
    """Integral along the pieces of a curve from (x, y, heading) in tiny steps; inf if blocked."""
    x, y, heading = start
    total = 0.0
    for turn, length in zip(turns, lengths, strict=True):
        count = math.ceil(abs(length) / step)
        for _ in range(count):
            ds = length / count
            half_turn = turn * ds / radius / 2
            x_mid = x + ds / 2 * math.cos(heading + half_turn / 2)
            y_mid = y + ds / 2 * math.sin(heading + half_turn / 2)
            row, col = math.floor(y_mid), math.floor(x_mid)
            inside = 0 <= row < density.shape[0] and 0 <= col < density.shape[1]
            if not inside or math.isinf(density[row, col]):
                return math.inf
            total += density[row, col] * abs(ds)
            x += ds * math.cos(heading + half_turn)
            y += ds * math.sin(heading + half_turn)
            heading += 2 * half_turn
    return total


def arc_crossings(center_x, center_y, radius, low, high, count=200_000):
    """How often an arc crosses a border between cells, and about where, in tiny steps."""
    angles, cell = [], None
    for n in range(count):
        angle = low + (high - low) * (n + 0.5) / count
        here = (
            math.floor(center_y + radius * math.sin(angle)),
            math.floor(center_x + radius * math.cos(angle)),
        )
        if cell is not None and here != cell:
            angles += [angle] * (abs(here[0] - cell[0]) + abs(here[1] - cell[1]))
        cell = here
    return angles


def enters(row, col, drow, dcol, cell_row, cell_col, margin):
    """Where a ray enters a cell's square, less a margin on each side; inf if it misses it."""
    enter, leave = 0.0, math.inf
    for start, delta, low in ((row, drow, cell_row), (col, dcol, cell_col)):
        low, high = low + margin, low + 1 - margin
        if delta == 0:
            if not low <= start <= high:
                return math.inf
            continue
        near, far = sorted(((low - start) / delta, (high - start) / delta))
        enter, leave = max(enter, near), min(leave, far)
    return enter if enter <= leave else math.inf


def cast(stops, row, col, drow, dcol, max_range, margin=0.0):
    """Range of a ray: the least entry into any cell that stops it, within the map's own square.

    With a negative margin cells that are only touched stop the ray, with a positive one not.
    """
    best = math.inf
    for cell_row, cell_col in np.argwhere(stops):
        best = min(best, enters(row, col, drow, dcol, cell_row, cell_col, margin))
    return best if best <= max_range else math.inf


def empty_squares(stops):
    """Grow a square from each cell until it holds a stop or leaves the map."""
    rows, cols = stops.shape
    result = np.zeros((4, rows + 2, cols + 2), np.uint8)
    for quadrant in range(4):
        for row in range(rows):
            for col in range(cols):
                for edge in range(1, 256):
                    top = row if quadrant & 2 else row - edge + 1
                    left = col if quadrant & 1 else col - edge + 1
                    inside = 0 <= top <= rows - edge and 0 <= left <= cols - edge
                    if not inside or stops[top : top + edge, left : left + edge].any():
                        break
                    result[quadrant, row + 1, col + 1] = edge
    return result


def information(
    stops, normals, resolution, row, col, heading, lidar, of_ranges, least_cosine=0.15, step=1e-5
):
    """Central differences of what the beams tell of the tangents of the surfaces that they hit.

    That is the range to the tangent, or how far the beam's end, as it was measured, departs from
    it when the robot moves.
    """
    total = np.zeros((3, 3))

    def turned(x, y, theta):
        return np.array(
            [math.cos(theta) * x - math.sin(theta) * y, math.sin(theta) * x + math.cos(theta) * y]
        )

    def origin(x, y, theta):
        return np.array([x, y]) + turned(lidar.forward, lidar.left, theta)

    pose = np.array([col * resolution, row * resolution, heading])
    for angle in lidar.angles:

        def direction(theta, angle=angle):
            return turned(1.0, 0.0, theta + lidar.yaw + angle)

        start, along = origin(*pose), direction(heading)
        first, best = None, lidar.max_range / resolution
        for cell in np.argwhere(stops):
            at = enters(
                start[1] / resolution, start[0] / resolution, along[1], along[0], *cell, 0.0
            )
            if at < best:
                first, best = cell, at
        if first is None or best == 0 or best * resolution < lidar.min_range:
            continue
        normal = np.array(normals[tuple(first)][::-1], float)
        if not normal.any():
            continue
        hit = start + best * resolution * along
        on_robot = turned(*(hit - pose[:2]), -heading)

        def told(moved, normal=normal, hit=hit, direction=direction, on_robot=on_robot):
            if of_ranges:
                return (normal @ (hit - origin(*moved))) / (normal @ direction(moved[2]))
            return normal @ (moved[:2] + turned(*on_robot, moved[2]) - hit)

        gradient = np.array(
            [
                (told(pose + step * axis) - told(pose - step * axis)) / (2 * step)
                for axis in np.eye(3)
            ]
        )
        if of_ranges:
            cosine = abs(normal @ along)
            gradient *= cosine / max(cosine, least_cosine)
        total += np.outer(gradient, gradient)
    return total


def radical_inverse(number):
    """The number's binary digits, mirrored at the point: van der Corput's sequence."""
    digits = reversed(f"{number:b}")
    return sum(int(digit) / 2**place for place, digit in zip(itertools.count(1), digits))


def moved_ends(cells, resolution, row, col, heading, sensor, angles, noise):
    """Ends of a simulated scan's beams, x and y from the robot [cells].

    Each is moved along its beam by ``noise[b][0]`` [m] and ``noise[b][1]`` of its range.
    """
    lever_x = (math.cos(heading) * sensor.mount_x - math.sin(heading) * sensor.mount_y) / resolution
    lever_y = (math.sin(heading) * sensor.mount_x + math.cos(heading) * sensor.mount_y) / resolution
    ends = []
    for angle, (shift, growth) in zip(angles, noise, strict=True):
        bearing = heading + sensor.mount_yaw + angle
        start, reach = (row + lever_y, col + lever_x), sensor.range / resolution
        at = middle_of_hit(cells, *start, bearing, reach, least=sensor.min_range / resolution)
        at += shift / resolution + growth * at
        ends.append((lever_x + at * math.cos(bearing), lever_y + at * math.sin(bearing)))
    return np.array(ends)


def walls(levels):
    """Occupied cells that do not lie among none but occupied ones, (row, col)."""
    around = np.pad(levels, 1, constant_values=127)
    return [
        (row, col)
        for row, col in np.ndindex(levels.shape)
        if levels[row, col] == 0 and around[row : row + 3, col : col + 3].any()
    ]


def squared_distance(walls, row, col):
    """To the centre of the nearest wall, from anywhere [cells^2]."""
    return min((row - r) ** 2 + (col - c) ** 2 for r, c in walls) if walls else math.inf


def loss(squared, resolution, sigma_hit, z_rand):
    """Log-likelihood that an endpoint loses by its distance [nat]."""
    near = math.exp(-squared * resolution**2 / (2 * sigma_hit**2))
    return -math.log((1 - z_rand) * near + z_rand)


def score(levels, row, col, ends, step, half_steps, angles, cost):
    """Sum of ``cost(squared distance)`` over the endpoints at every offset, (theta, dy, dx)."""
    near, offsets = walls(levels), range(-half_steps, half_steps + 1)
    result = np.zeros((len(angles), len(offsets), len(offsets)))
    for k, theta in enumerate(angles):
        cos, sin = math.cos(theta), math.sin(theta)
        for x, y in ends:
            if math.isnan(x):
                continue
            r = row + math.floor(sin * x + cos * y + 0.5)
            c = col + math.floor(cos * x - sin * y + 0.5)
            for j, dy in enumerate(offsets):
                for i, dx in enumerate(offsets):
                    result[k, j, i] += cost(squared_distance(near, r + dy * step, c + dx * step))
    return result


def recorded_posteriors(levels, cells, ends, step, half_steps, angles, cost, share, excess):
    """Mean, covariance, best offset in steps, entropy, ambiguity and mean loss of each scan.

    ``share`` of what a beam tells counts, and modes are connected up to `excess` more of it.
    """
    found = []
    for (row, col), scan in zip(cells, ends, strict=True):
        losses = score(levels, row, col, scan, step, half_steps, angles, cost)
        mode = central_mode(losses * share, excess)
        mean, covariance, entropy, ambiguity = moments(losses * share, mode)
        k, j, i = np.unravel_index(np.argmin(losses), losses.shape)
        best = (i - half_steps, j - half_steps, k - len(angles) // 2)
        returns = sum(not math.isnan(x) for x, _ in scan)
        found.append((mean, covariance, best, entropy, ambiguity, -losses.min() / max(returns, 1)))
    return found


def moments(losses, mode):
    """Mean and covariance of (dx, dy, theta) in steps, entropy [nat], mass outside the mode."""
    weights = np.exp(-(losses - losses.min()))
    weights /= math.fsum(weights.ravel())
    half = [size // 2 for size in losses.shape]
    poses = [(i - half[2], j - half[1], k - half[0]) for k, j, i in np.ndindex(losses.shape)]
    poses, weights = np.array(poses, float), weights.ravel()
    mean = np.array([math.fsum(weights * axis) for axis in poses.T])
    covariance = np.empty((3, 3))
    for a, b in np.ndindex(3, 3):
        covariance[a, b] = math.fsum(weights * (poses[:, a] - mean[a]) * (poses[:, b] - mean[b]))
    entropy = -math.fsum(w * math.log(w) for w in weights if w > 0)
    return mean, covariance, entropy, math.fsum(weights[~mode.ravel()])


def central_mode(losses, excess):
    """Offsets reached from zero by steps to 26 neighbours, and their neighbours, (theta, dy, dx).

    A step starts from what loses at most `excess` more than zero does.
    """
    centre = tuple(size // 2 for size in losses.shape)
    inside = np.zeros(losses.shape, bool)
    inside[centre] = True
    queue = [centre]
    while queue:
        at = queue.pop()
        if losses[at] > losses[centre] + excess:
            continue
        near = (
            range(max(n - 1, 0), min(n + 2, size)) for n, size in zip(at, losses.shape, strict=True)
        )
        for there in itertools.product(*near):
            if not inside[there]:
                inside[there] = True
                queue.append(there)
    return inside


def line_cost(density, resolution, origin, a, b):
    """Integral along a line between world positions [density x cells].

    Infinite where the line so much as touches a blocked cell, or one beyond the grid.
    """
    x, y, yaw = origin
    turn = complex(math.cos(yaw), -math.sin(yaw)) / resolution
    a, b = (turn * complex(at[0] - x, at[1] - y) for at in (a, b))
    line = a.imag, a.real, b.imag, b.real
    if not (0 <= a.imag < density.shape[0] and 0 <= a.real < density.shape[1]):
        return math.inf
    bordered = np.pad(density, 1, constant_values=math.inf)
    for row, col in np.argwhere(bordered == math.inf) - 1:
        if touches(*line, row, col, margin=-1e-9):
            return math.inf
    return line_integral(density, *line)


def line_costs(density, resolution, origin, xy, pairs):
    """The same for pairs of positions."""
    return [line_cost(density, resolution, origin, xy[i], xy[j]) for i, j in pairs]


def wrapped(angle):
    return (angle + math.pi) % (2 * math.pi) - math.pi


def beam_score(cells, resolution, x, y, amcl, reach):
    """What a beam that ends at x, y [m] adds to a particle's score: AMCL's likelihood fields."""
    row, col = math.floor(y / resolution), math.floor(x / resolution)
    distance = amcl.laser_likelihood_max_dist
    if 0 <= row < cells.shape[0] and 0 <= col < cells.shape[1]:
        for i, j in zip(*np.nonzero(cells == 0), strict=True):
            distance = min(distance, resolution * math.hypot(i - row, j - col))
    likelihood = amcl.z_hit * math.exp(-(distance**2) / (2 * amcl.sigma_hit**2))
    likelihood += amcl.z_rand / reach
    if amcl.laser_model_type == "likelihood_field_prob":
        return math.log(likelihood)
    return likelihood**3


def weigh(*about):
    """Weights of particles (3, n) after a scan whose beams end `ends` [cells] from the robot."""
    scaled = weights_of(*about)
    return scaled / scaled.sum()


def weights_of(cells, resolution, ends, poses, weights, amcl, reach):
    """The same, before they are scaled to add up to 1."""
    scaled = []
    for (x, y, heading), weight in zip(poses.T, weights, strict=True):
        score = 0.0
        for ahead, left in ends:
            if not math.isnan(ahead):
                end_x = x + resolution * (math.cos(heading) * ahead - math.sin(heading) * left)
                end_y = y + resolution * (math.sin(heading) * ahead + math.cos(heading) * left)
                aside = resolution / 2 if amcl.half_cell else 0.0
                score += beam_score(cells, resolution, end_x + aside, end_y + aside, amcl, reach)
        product = amcl.laser_model_type == "likelihood_field_prob"
        scaled.append(weight * (math.exp(score) if product else 1 + score))
    return np.array(scaled)


def move(random, poses, dx, dy, turn, heading, amcl):
    """sample_motion_odometry with AMCL's symmetry of forwards and backwards, or its omni model."""
    way = math.hypot(dx, dy)
    if amcl.robot_model_type == "nav2_amcl::OmniMotionModel":
        return glide(random, poses, way, math.atan2(dy, dx) - heading, turn, amcl)
    first = wrapped(math.atan2(dy, dx) - heading) if way >= 0.01 else 0.0
    second = wrapped(turn - first)
    sizes = [min(abs(a), abs(wrapped(a - math.pi))) for a in (first, second)]
    spreads = [math.sqrt(amcl.alpha1 * size**2 + amcl.alpha2 * way**2) for size in sizes]
    variance = amcl.alpha3 * way**2 + amcl.alpha4 * sizes[0] ** 2 + amcl.alpha4 * sizes[1] ** 2
    moved = []
    for x, y, facing in poses.T:
        own_first = first - spreads[0] * random.standard_normal()
        own_way = way - math.sqrt(variance) * random.standard_normal()
        own_second = second - spreads[1] * random.standard_normal()
        moved.append(
            (
                x + own_way * math.cos(facing + own_first),
                y + own_way * math.sin(facing + own_first),
                facing + own_first + own_second,
            )
        )
    return np.array(moved).T


def glide(random, poses, way, bearing, turn, amcl):
    """AMCL's omnidirectional model: noise along the way, of the turn, and to the side."""
    moved = []
    for x, y, facing in poses.T:
        along = (
            way
            + math.hypot(math.sqrt(amcl.alpha3) * way, math.sqrt(amcl.alpha4) * turn)
            * random.standard_normal()
        )
        own_turn = (
            turn
            + math.hypot(math.sqrt(amcl.alpha1) * turn, math.sqrt(amcl.alpha2) * way)
            * random.standard_normal()
        )
        aside = (
            math.hypot(math.sqrt(amcl.alpha4) * turn, math.sqrt(amcl.alpha5) * way)
            * random.standard_normal()
        )
        direction = facing + bearing
        moved.append(
            (
                x + along * math.cos(direction) + aside * math.sin(direction),
                y + along * math.sin(direction) - aside * math.cos(direction),
                facing + own_turn,
            )
        )
    return np.array(moved).T


def bins_of(poses):
    """The bin that each particle of (3, n) is in: 0.5 m, 0.5 m, 10 deg."""
    return [
        tuple(np.floor(np.array(pose) / (0.5, 0.5, math.pi / 18)).astype(int)) for pose in poses.T
    ]


def heaviest_cluster_mean(poses):
    """Mean of the largest group of particles whose bins touch."""
    bins = bins_of(poses)
    left, groups = set(bins), []
    while left:
        group = [left.pop()]
        for near in group:
            touching = {
                b for b in left if max(abs(p - q) for p, q in zip(b, near, strict=True)) <= 1
            }
            left -= touching
            group.extend(touching)
        groups.append([n for n, b in enumerate(bins) if b in group])
    x, y, heading = poses[:, max(groups, key=len)]
    return x.mean(), y.mean(), math.atan2(np.sin(heading).mean(), np.cos(heading).mean())


def kld_sample_size(bins, amcl):
    """Fox's bound on the number of particles, with AMCL's limits."""
    if bins <= 1:
        return amcl.max_particles
    share = 2 / (9 * (bins - 1))
    n = (bins - 1) / (2 * amcl.pf_err) * (1 - share + math.sqrt(share) * amcl.pf_z) ** 3
    return min(max(math.ceil(n), amcl.min_particles), amcl.max_particles)


def lost_share(averages, weight, amcl):
    """AMCL's share of random particles, after both averages have taken the mean weight."""
    if weight > 0:
        for n, alpha in enumerate((amcl.recovery_alpha_slow, amcl.recovery_alpha_fast)):
            averages[n] += (alpha if averages[n] else 1.0) * (weight - averages[n])
    return 0.0 if averages[0] == 0 else max(0.0, 1 - averages[1] / averages[0])


def resample(random, poses, weights, amcl, lost=0.0, free=(), resolution=1.0):
    """Particles drawn by their weights, or in free cells, until KLD sampling has enough."""
    drawn, bins = [], set()
    shares = np.cumsum(weights)
    while len(drawn) < amcl.max_particles:
        if lost > 0 and random.random() < lost:
            row, col = free[int(random.random() * len(free))]
            heading = math.pi * (2 * random.random() - 1)
            drawn.append(np.array([resolution * (col + 0.5), resolution * (row + 0.5), heading]))
        else:
            at = random.random() * shares[-1]
            drawn.append(poses[:, next(n for n, share in enumerate(shares) if share > at)])
        bins |= set(bins_of(drawn[-1][:, None]))
        if len(drawn) > kld_sample_size(len(bins), amcl):
            break
    return np.array(drawn).T


def measured_ends(random, cells, resolution, pose, sensor, angles, disturbances):
    """Ends of a real scan's beams, ahead and left of the robot [cells]."""
    row, col, heading = pose
    lever_x = (math.cos(heading) * sensor.mount_x - math.sin(heading) * sensor.mount_y) / resolution
    lever_y = (math.sin(heading) * sensor.mount_x + math.cos(heading) * sensor.mount_y) / resolution
    occluded = random.random() < disturbances.occlusion
    middle = angles[0] + random.random() * (angles[-1] - angles[0])
    before = (0.5 + 1.5 * random.random()) / resolution
    ends = []
    for angle in angles:
        noise, chance = random.standard_normal(), random.random()
        bearing = sensor.mount_yaw + angle
        at = middle_of_hit(
            cells, row + lever_y, col + lever_x, heading + bearing, sensor.range / resolution
        )
        at += noise * sensor.range_sigma / resolution
        if chance < disturbances.outliers:
            at = chance / disturbances.outliers * sensor.range / resolution
        if (
            occluded
            and abs(wrapped(angle - middle)) <= math.radians(disturbances.occlusion_deg) / 2
        ):
            at = min(at, before) if at == at else before
        ahead = sensor.mount_x / resolution + at * math.cos(bearing)
        left = sensor.mount_y / resolution + at * math.sin(bearing)
        returns = at > 0 and sensor.min_range / resolution <= at < sensor.range / resolution
        ends.append((ahead, left) if returns else (math.nan, math.nan))
    return np.array(ends)


def middle_of_hit(cells, row, col, bearing, reach, least=0.0):
    """Distance to the middle of a ray's way through the first occupied cell [cells], or NaN.

    A cell that is entered at less than `least` or beyond `reach` gives no return.
    """
    drow, dcol = math.sin(bearing), math.cos(bearing)
    hits = [
        (enters(row, col, drow, dcol, i, j, 0.0), i, j) for i, j in np.argwhere(cells == 0).tolist()
    ]
    entry, i, j = min(hits, default=(math.inf, 0, 0))
    if entry == 0 or not least <= entry <= reach:  # at 0 the lidar itself is within a wall
        return math.nan
    leave = min((i + (drow >= 0) - row) / drow, (j + (dcol >= 0) - col) / dcol)
    return (entry + leave) / 2


def odometry_along(random, truth, odometry):
    """What odometry makes of a drive."""
    scale = 1 + odometry.distance_bias * random.standard_normal()
    bend = math.radians(odometry.heading_bias_deg) * random.standard_normal()
    turn_scale = 1 + odometry.turn_bias * random.standard_normal()
    told = [truth[0]]
    for before, after in itertools.pairwise(truth):
        way = math.dist(before[:2], after[:2])
        turn = wrapped(after[2] - before[2])
        aside = math.atan2(after[1] - before[1], after[0] - before[0]) - before[2] if way else 0.0
        own_way = scale * way + odometry.distance_drift * math.sqrt(way) * random.standard_normal()
        spread = math.hypot(
            math.radians(odometry.heading_drift_deg) * math.sqrt(way),
            math.radians(odometry.turn_drift_deg) * math.sqrt(abs(turn)),
        )
        x, y, heading = told[-1]
        own_turn = turn_scale * turn + bend * way + random.standard_normal() * spread
        told.append(
            (
                x + own_way * math.cos(heading + aside),
                y + own_way * math.sin(heading + aside),
                heading + own_turn,
            )
        )
    return np.array(told)


def drive(random, truth, cells, world, resolution, robot, angles, own=None, log=None):
    """How far AMCL's pose is off along a drive, (n, 3).

    The filter has random numbers of its own if `own` is given. What it gets is kept in `log`: the
    odometry, and the index of each update with the scan and the covariance of the particles.
    """
    sensor, amcl, disturbances = robot.lidar, robot.filter, robot.disturbances
    world_random, random = random, random if own is None else own
    told = odometry_along(world_random, truth, robot.odometry)
    log = [] if log is None else log
    log.append(told)
    spread = np.array(
        [
            disturbances.start_sigma,
            disturbances.start_sigma,
            math.radians(disturbances.start_sigma_deg),
        ]
    )
    guess = truth[0] + spread * random.standard_normal(3)
    poses = np.array(
        [guess + spread * random.standard_normal(3) for _ in range(amcl.max_particles)]
    ).T
    weights, averages = np.full(poses.shape[1], 1 / poses.shape[1]), [0.0, 0.0]
    pose, at, last, updates, errors = heaviest_cluster_mean(poses), 0, 0, 0, []
    for n, true in enumerate(truth):
        dx, dy, _ = told[n] - told[last]
        turn = wrapped(told[n][2] - told[last][2])
        far = max(abs(dx), abs(dy)) > amcl.update_min_d or abs(turn) > amcl.update_min_a
        if far:
            poses = move(random, poses, dx, dy, turn, told[last][2], amcl)
        if far or n == 0:
            sensed = true[1] / resolution, true[0] / resolution, true[2]
            ends = measured_ends(
                world_random, world, resolution, sensed, sensor, angles, disturbances
            )
            scaled = weights_of(cells, resolution, ends, poses, weights, amcl, sensor.range)
            lost = lost_share(averages, scaled.mean(), amcl)
            weights = scaled / scaled.sum()
            last, updates = n, updates + 1
            if updates % amcl.resample_interval == 0:
                free = np.argwhere(cells == 254).tolist()
                poses = resample(random, poses, weights, amcl, lost, free, resolution)
                averages = [0.0, 0.0] if lost else averages
                weights = np.full(poses.shape[1], 1 / poses.shape[1])
                pose, at = heaviest_cluster_mean(poses), n
            log.append((n, ends, covariance_of(poses)))
        turned = pose[2] - told[at][2]
        x, y, heading = told[n] - told[at]
        errors.append(
            (
                pose[0] + math.cos(turned) * x - math.sin(turned) * y - true[0],
                pose[1] + math.sin(turned) * x + math.cos(turned) * y - true[1],
                wrapped(pose[2] + heading - true[2]),
            )
        )
    return np.array(errors)


def covariance_of(poses):
    """Covariance of particles as AMCL publishes it."""
    covariance = np.zeros((3, 3))
    covariance[:2, :2] = np.cov(poses[:2], bias=True)
    covariance[2, 2] = -2 * math.log(abs(np.exp(1j * poses[2]).mean()))
    return covariance


def within_object(outline, heading, x, y):
    """Whether a point from the object's centre lies within it."""
    if outline.is_round:
        return math.hypot(x, y) <= outline.half_length
    along = math.cos(heading) * x + math.sin(heading) * y
    across = math.cos(heading) * y - math.sin(heading) * x
    return abs(along) <= outline.half_length and abs(across) <= outline.half_width


def entry(outline, heading, x, y, dx, dy, reach, step=1e-3):
    """Range at which a ray from (x, y) enters an object at the origin, by small steps, or inf."""
    if within_object(outline, heading, x, y):
        return math.inf
    away, size = math.hypot(x, y), math.hypot(outline.half_length, outline.half_width)
    first, last = int((away - size) / step), int((away + size) / step) + 1
    for n in range(max(first, 1), min(last, int(reach / step)) + 1):  # it is nowhere else
        if within_object(outline, heading, x + n * step * dx, y + n * step * dy):
            low, high = (n - 1) * step, n * step
            for _ in range(40):
                middle = (low + high) / 2
                if within_object(outline, heading, x + middle * dx, y + middle * dy):
                    high = middle
                else:
                    low = middle
            return high
    return math.inf


def normal_at(outline, heading, x, y):
    """Unit normal of an object's surface at a point of it."""
    if outline.is_round:
        return x / math.hypot(x, y), y / math.hypot(x, y)
    along = math.cos(heading) * x + math.sin(heading) * y
    across = math.cos(heading) * y - math.sin(heading) * x
    to_end, to_side = outline.half_length - abs(along), outline.half_width - abs(across)
    turn = heading if to_end < to_side else heading + math.pi / 2
    return math.cos(turn), math.sin(turn)


def landmark_information(stops, normals, resolution, rays, n, outline, objects):
    """Sum of g g^T over the rays of a pose on a map with objects (x, y, heading), (3, 3)."""
    total = np.zeros((3, 3))
    x, y = rays.poses[n] + rays.levers[n]
    for b in range(rays.beams):
        bearing = rays.first[n] + b * rays.step
        dx, dy = math.cos(bearing), math.sin(bearing)
        best, normal = math.inf, None
        for cell in np.argwhere(stops):
            at = resolution * enters(y / resolution, x / resolution, dy, dx, *cell, 0.0)
            if at < best:
                best, normal = at, normals[tuple(cell)][::-1]
        for ox, oy, heading in objects:
            at = entry(outline, heading, x - ox, y - oy, dx, dy, rays.most + 1)
            if at < best:
                best = at
                normal = normal_at(outline, heading, x + at * dx - ox, y + at * dy - oy)
        if rays.least <= best <= rays.most:
            hx, hy = rays.levers[n] + best * np.array([dx, dy])
            gradient = np.array([normal[0], normal[1], hx * normal[1] - hy * normal[0]])
            total += np.outer(gradient, gradient) / (1 + rays.swing * best**2)
    return total


def covariances(information, poses, routes, motion):
    """Covariances (n, 3, 3) after each look around, along routes, by matrices as they are."""
    result = []
    for begin, end in itertools.pairwise(routes):
        p = np.diag([motion.start, motion.start, motion.start_turn])
        for n in range(begin, end):
            if n > begin:
                dx, dy = poses[n] - poses[n - 1]
                way = math.hypot(dx, dy)
                turned = np.array([[dx, -dy, 0], [dy, dx, 0], [0, 0, way]]) / way
                q = turned @ np.diag([motion.along, motion.across, motion.turn]) @ turned.T
                f = np.array([[1, 0, -dy], [0, 1, dx], [0, 0, 1]])
                p = f @ p @ f.T + q * way
            p = np.linalg.inv(np.linalg.inv(p) + information[n])
            result.append(p)
    return np.array(result)


def settle(loss, stands, refine, half_steps, step, half_turns, turn, pose):
    """A pose (x, y, heading) and its loss where no offset on a lattice about it has a lower one.

    `loss` and `stands` take a pose, `refine` gives one of lower loss next to it.
    """
    best = refine(pose)
    for _ in range(6):
        around = [
            (best[0] + i * step, best[1] + j * step, best[2] + k * turn)
            for k in range(-half_turns, half_turns + 1)
            for j in range(-half_steps, half_steps + 1)
            for i in range(-half_steps, half_steps + 1)
        ]
        around = [each for each in around if stands(each)]
        least = min(around, key=loss, default=best)
        if loss(least) >= loss(best):
            break
        best = refine(least)
    return best, loss(best)


def gap(code, other):
    """Distance of two codes on a circle of 256."""
    between = abs(int(code) - int(other))
    return min(between, 256 - between)


def shortlist(ranges, beams, scan, most, keep):
    """Scores and indices of the best pairs of a place and a turn, for codes (place, beam)."""
    places, turns = ranges.shape
    found = []
    for place in range(places):
        scores = [
            sum(
                min(gap(ranges[place, (b + turn) % turns], code), most)
                for b, code in zip(beams, scan, strict=True)
            )
            for turn in range(turns)
        ]
        for turn, score in enumerate(scores):
            if score < scores[turn - 1] and score <= scores[(turn + 1) % turns]:
                found.append((score, place * turns + turn))
    return sorted(found)[:keep]


def ranges_from(stops, resolution, poses, lidar):
    """Ranges of scans at poses (row, col, heading), cell by cell (n, beam) [m]."""
    result = np.full((len(poses), len(lidar.angles)), np.inf)
    for n, (row, col, heading) in enumerate(poses):
        x = lidar.forward * math.cos(heading) - lidar.left * math.sin(heading)
        y = lidar.forward * math.sin(heading) + lidar.left * math.cos(heading)
        at_row, at_col = row + y / resolution, col + x / resolution
        for b, angle in enumerate(lidar.angles):
            bearing = heading + lidar.yaw + angle
            hits = [
                (enters(at_row, at_col, math.sin(bearing), math.cos(bearing), *cell, 0.0), cell)
                for cell in np.argwhere(stops)
            ]
            near, cell = min(hits, key=lambda hit: hit[0])
            if lidar.min_range <= near * resolution <= lidar.max_range:
                drow, dcol = math.sin(bearing), math.cos(bearing)
                far_row = (cell[0] + (drow >= 0) - at_row) / drow
                far_col = (cell[1] + (dcol >= 0) - at_col) / dcol
                result[n, b] = resolution * (near + min(far_row, far_col)) / 2
    return result


def loss_at(losses, margin, ends, x, y, heading):
    """Sum of the losses [steps] of ends (2, k) at a pose, between cell centres, (H, W) losses."""
    total = 0.0
    rows, cols = losses.shape
    for ahead, left in ends.T:
        u = x + margin - 0.5 + math.cos(heading) * ahead - math.sin(heading) * left
        v = y + margin - 0.5 + math.sin(heading) * ahead + math.cos(heading) * left
        u, v = min(max(u, 0.0), cols - 1.01), min(max(v, 0.0), rows - 1.01)
        i, j = int(v), int(u)
        a, c = u - j, v - i
        below = losses[i, j] * (1 - a) + losses[i, j + 1] * a
        above = losses[i + 1, j] * (1 - a) + losses[i + 1, j + 1] * a
        total += below * (1 - c) + above * c
    return total


def apart(a, b):
    """Distance and turn between two poses."""
    turn = abs((a[2] - b[2] + math.pi) % (2 * math.pi) - math.pi)
    return math.hypot(a[0] - b[0], a[1] - b[1]), turn


def unlike(poses, order, distance, turn):
    """Indices, in order, of poses that are like none before that is kept."""
    kept = []
    for n in order:
        between = [apart(poses[n], poses[k]) for k in kept]
        if not any(d < distance and t < turn for d, t in between):
            kept.append(n)
    return kept


def refine(loss, fits, pose, steps, lever, rounds):
    """The pose that steps along the axes and turns lead to, each the first that lowers the loss."""
    pose, best = list(pose), loss(*pose)
    for step, _ in itertools.product(steps, range(rounds)):
        for axis in range(3) if step > 0 else ():
            for sign in (1, -1):
                tried = list(pose)
                tried[axis] += sign * (step if axis < 2 else step / lever)
                if (axis == 2 or fits(*tried[:2])) and loss(*tried) < best:
                    pose, best = tried, loss(*tried)
                    break
    return pose, best


def polish(loss, fits, pose, steps, lever, rounds):
    """The pose that steps in all 26 directions lead to, each of which is taken if it is lower."""
    pose, best = list(pose), loss(*pose)
    for step, _ in itertools.product(steps, range(rounds)):
        for turn, along, across in itertools.product((-1, 0, 1), repeat=3) if step > 0 else ():
            moves = across * step, along * step, turn * step / lever
            tried = [value + move for value, move in zip(pose, moves, strict=True)]
            if (turn, along, across) != (0, 0, 0) and fits(*tried[:2]) and loss(*tried) < best:
                pose, best = tried, loss(*tried)
    return pose, best


def best_pose(lower_bound, loss, fits, box, steps):
    """Pose of least loss of a lattice, by branch and bound, and its loss.

    The lattice has `steps` (of x, y and heading) in a box (3, 2); a box of poses is split in two
    along its longest edge in steps, unless `lower_bound(middle, half)` is above the best loss.
    """
    best, where, count = math.inf, None, itertools.count()
    sizes = [
        max(1, round((high - low) / step)) for (low, high), step in zip(box, steps, strict=True)
    ]
    waiting = [(0.0, next(count), [(0, size) for size in sizes])]
    while waiting:
        bound, _, part = heapq.heappop(waiting)
        if bound >= best:
            break
        if all(end - begin == 1 for begin, end in part):
            pose = [
                low + (begin + 0.5) * step
                for (low, _), step, (begin, _) in zip(box, steps, part, strict=True)
            ]
            if fits(*pose[:2]) and loss(*pose) < best:
                best, where = loss(*pose), pose
            continue
        widest = max(range(3), key=lambda axis: part[axis][1] - part[axis][0])
        begin, end = part[widest]
        for both in ((begin, (begin + end) // 2), ((begin + end) // 2, end)):
            half = [*part[:widest], both, *part[widest + 1 :]]
            middle = [
                low + (a + b) / 2 * step
                for (low, _), step, (a, b) in zip(box, steps, half, strict=True)
            ]
            width = [(b - a) / 2 * step for step, (a, b) in zip(steps, half, strict=True)]
            heapq.heappush(waiting, (max(bound, lower_bound(middle, width)), next(count), half))
    return where, best


def loss_tables(occupied, resolution, sigmas, z_rand, margin):
    """Losses at the centres of a cell and of its neighbours above, as bytes of a word."""
    cells = np.pad(occupied, 1)
    around = [np.roll(cells, step, (0, 1)) for step in itertools.product((-1, 0, 1), repeat=2)]
    walls = np.argwhere((cells & ~np.logical_and.reduce(around))[1:-1, 1:-1]) + margin
    height, width = (size + 2 * margin for size in occupied.shape)
    words = np.zeros((len(sigmas), height, width), np.uint32)
    for n, sigma in enumerate(sigmas):
        losses = np.full((height + 1, width + 1), 255)
        for row in range(height):
            for col in range(width):
                distance = resolution * math.sqrt(((walls - (row, col)) ** 2).sum(axis=1).min())
                likelihood = (1 - z_rand) * math.exp(-0.5 * (distance / sigma) ** 2) + z_rand
                losses[row, col] = round(255 * math.log(likelihood) / math.log(z_rand))
        for byte, (row, col) in enumerate(((0, 0), (0, 1), (1, 0), (1, 1))):
            part = losses[row : row + height, col : col + width].astype(np.uint32)
            words[n] |= part << np.uint32(8 * byte)
    return words


def rotated(covariances, yaw):
    """Covariances (..., d, d) of poses whose axes are turned counter-clockwise by `yaw` [rad]."""
    turn = np.eye(covariances.shape[-1])
    turn[0, :2] = math.cos(yaw), -math.sin(yaw)
    turn[1, :2] = math.sin(yaw), math.cos(yaw)
    return np.einsum("ij,...jk,lk->...il", turn, covariances, turn)


def margin_at(walls, resolution, shape, discs, pose):
    """Distance of an outline from the edges of walls, cells of (row, col) [m]."""
    x, y, heading = pose
    margins = []
    for ahead, left, radius in discs:
        row = (y + math.sin(heading) * ahead + math.cos(heading) * left) / resolution
        col = (x + math.cos(heading) * ahead - math.sin(heading) * left) / resolution
        if not (0 <= row < shape[0] and 0 <= col < shape[1]):
            return -math.inf
        gaps = (
            math.hypot(max(i - row, row - i - 1, 0), max(j - col, col - j - 1, 0)) for i, j in walls
        )
        margins.append(resolution * min(gaps) - radius)
    return min(margins)


def follow(random, path, stops, resolution, robot, discs, first, ticks):
    """True poses of a robot that knows them, tick by tick; `path` holds x, y and the gear there."""
    walls = np.argwhere(stops).tolist()

    def margin(pose):
        return margin_at(walls, resolution, stops.shape, discs, pose)

    odometry, speed = robot.odometry, robot.kinematics.speed
    sideways = robot.kinematics.drive == "omnidirectional"
    radius = robot.kinematics.turning_radius
    scale = 1 + odometry.distance_bias * random.standard_normal()
    bend = math.radians(odometry.heading_bias_deg) * random.standard_normal()
    turn_scale = 1 + odometry.turn_bias * random.standard_normal()
    truth, nearest = [tuple(first)], 0

    def after(pose, way, aside, turn):
        middle = pose[2] + turn / 2 + aside
        return (
            pose[0] + way * math.cos(middle),
            pose[1] + way * math.sin(middle),
            pose[2] + turn,
        )

    def is_clear(ahead, left, turn, reach):
        enough, pose = min(0.035, margin(truth[-1])) - 1e-9, truth[-1]
        for _ in range(10):
            pose = after(pose, math.hypot(ahead, left) / 10, math.atan2(left, ahead), turn / 10)
            if math.dist(pose[:2], truth[-1][:2]) > reach:
                break
            if margin(pose) < enough:
                return False
        return True

    def is_there():
        at_end = nearest + 30 >= len(path) - 1
        return at_end and math.dist(truth[-1][:2], path[-1]) <= robot.goal_tolerance

    def within(value, limit):
        return min(max(value, -limit), limit)

    gears = [gear for _, _, gear in path]
    path = [each[:2] for each in path]
    while not is_there() and len(truth) < ticks:
        x, y, heading = truth[-1]
        ends = [k for k in range(nearest, len(path)) if gears[k] != gears[nearest]]
        close = range(nearest, min([nearest + 30, len(path), *ends]))
        nearest = min(close, key=lambda k: math.dist(path[k], (x, y)))
        if nearest + 1 < len(path) and gears[nearest + 1] != gears[nearest]:
            nearest += 1
        gear, carrot = gears[nearest], nearest
        while (
            carrot < len(path) - 1
            and math.dist(path[carrot], (x, y)) < 0.6
            and gears[carrot + 1] == gear
        ):
            carrot += 1
        dx, dy = path[carrot][0] - x, path[carrot][1] - y
        away = math.hypot(dx, dy)
        aside = wrapped(math.atan2(dy, dx) - heading - (math.pi if gear < 0 else 0.0))
        curvature = 2 * math.sin(within(aside, math.pi / 2)) / max(away, 0.1)
        if sideways:
            curvature = 0.0
        if radius:
            curvature = within(curvature, 1 / radius)
        from_walls = margin_at(walls, resolution, stops.shape, [(0.0, 0.0, 0.0)], truth[-1])
        slow = min(speed, speed * from_walls / 0.6, speed / max(abs(curvature) * 0.9, 1e-9))
        pace = min(speed, max(slow, 0.25))
        if carrot == len(path) - 1:
            pace = min(pace, max(pace * away / 0.6, 0.05))
        if sideways:
            command = pace * math.cos(aside), pace * math.sin(aside), within(aside, 1)
        elif not radius and abs(aside) > math.pi / 4:
            command = 0.0, 0.0, math.copysign(min(1.0, 2 * abs(aside)), aside)
        else:
            command = gear * pace, 0.0, within(pace * curvature, 1.0)
        clear = is_clear(*command, away)
        assert clear, "standstills are not in here"
        ahead, left, turn = (each / 10 for each in command)
        way, aside = math.hypot(ahead, left), math.atan2(left, ahead)
        drift = odometry.distance_drift * math.sqrt(way) * random.standard_normal()
        noise = random.standard_normal() * math.hypot(
            math.radians(odometry.heading_drift_deg) * math.sqrt(way),
            math.radians(odometry.turn_drift_deg) * math.sqrt(abs(turn)),
        )
        true_turn = (turn - bend * way - noise) / turn_scale
        new = after(truth[-1], max(0.0, (way - drift) / scale), aside, true_turn)
        margins = [margin(each) for each in (truth[-1], new)]
        truth.append(truth[-1] if margins[1] < min(0.0, margins[0]) else new)
    return np.array(truth)


def density_of(error, deviation, kidnapped):
    """Body, skirt and slips of a move's error, and a robot that was put anywhere."""

    def normal(values, sigmas):
        scaled = [v / s for v, s in zip(values, sigmas, strict=True)]
        size = math.prod(sigmas) * (2 * math.pi) ** (len(sigmas) / 2)
        return math.exp(-0.5 * sum(v * v for v in scaled)) / size

    body = normal(error, deviation)
    skirt = normal(error, [2.5 * d for d in deviation])
    slips = [normal(error, (far, far, 0.4)) for far in (1.0, 3.0)]
    return 0.84 * body + 0.15 * skirt + 0.01 * sum(slips) / 2 + kidnapped


def distance_between(walls, x, y, resolution):
    """Distance from walls at a position, bilinear between cell centres, 2 m at most."""
    cells = [(r, c) for r in range(len(walls)) for c in range(len(walls[0])) if walls[r][c]]

    def at(row, col):
        if not (0 <= row < len(walls) and 0 <= col < len(walls[0])):
            return 2.0
        return min([2.0] + [resolution * math.hypot(row - r, col - c) for r, c in cells])

    u, v = x / resolution - 0.5, y / resolution - 0.5
    j, i = math.floor(u), math.floor(v)
    a, c = u - j, v - i
    low = (1 - a) * at(i, j) + a * at(i, j + 1)
    high = (1 - a) * at(i + 1, j) + a * at(i + 1, j + 1)
    return (1 - c) * low + c * high


def fit_of(walls, resolution, sigma, anywhere, ends, pose):
    """Mean log-likelihood of a scan's ends at a pose."""
    logs = []
    for ahead, left in ends:
        if not math.isnan(ahead):
            x = pose[0] + math.cos(pose[2]) * ahead - math.sin(pose[2]) * left
            y = pose[1] + math.sin(pose[2]) * ahead + math.cos(pose[2]) * left
            away = distance_between(walls, x, y, resolution)
            hit = (1 - anywhere) * math.exp(-0.5 * (away / sigma) ** 2)
            logs.append(math.log(hit + anywhere))
    return sum(logs) / len(logs)


def error_of(first, second, move):
    """The way between two poses minus a move."""
    dx, dy = second[0] - first[0], second[1] - first[1]
    turn = (second[2] - first[2] - move[2] + math.pi) % (2 * math.pi) - math.pi
    cos, sin = math.cos(first[2]), math.sin(first[2])
    return cos * dx + sin * dy - move[0], cos * dy - sin * dx - move[1], turn


def best_way(candidates, gains, moves, deviations, kidnapped):
    """The likeliest of all ways over candidates, by trying each."""
    many, count = gains.shape

    def likelihood(way):
        total = sum(gains[c, k] for k, c in enumerate(way))
        for k in range(1, count):
            poses = candidates[way[k - 1], k - 1], candidates[way[k], k]
            density = density_of(error_of(*poses, moves[k]), deviations[k], kidnapped)
            total += math.log(density)
        return total

    return max(itertools.product(range(many), repeat=count), key=likelihood)


def sample_backwards(random, clouds, moves, deviations, kidnapped, count):
    """Trajectories drawn from clouds of particles, one after the other from its end."""
    trajectories = []
    for _ in range(count):
        poses = [clouds[-1].T[random.integers(0, clouds.shape[2])]]
        for k in range(len(clouds) - 2, -1, -1):
            errors = [error_of(particle, poses[0], moves[k + 1]) for particle in clouds[k].T]
            shares = [density_of(error, deviations[k + 1], kidnapped) for error in errors]
            mark, chosen, so_far = random.random() * sum(shares), 0, shares[0]
            while so_far < mark:
                chosen += 1
                so_far += shares[chosen]
            poses.insert(0, clouds[k].T[chosen])
        trajectories.append(poses)
    return np.array(trajectories)


def whole_matrix(diagonal, beside):
    """The matrix that block-tridiagonal equations stand for."""
    count = len(diagonal)
    matrix = np.zeros((3 * count, 3 * count))
    for n in range(count):
        here = slice(3 * n, 3 * n + 3)
        matrix[here, here] = diagonal[n]
        if n:
            before = slice(3 * n - 3, 3 * n)
            matrix[here, before], matrix[before, here] = beside[n], beside[n].T
    return matrix


def surface_depths(cells, free, occupied, deep):
    """Faces between free and occupied cells, and those with much black behind them."""
    faces = deep_faces = 0
    for down, right in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        for row, col in np.argwhere(cells == occupied).tolist():
            before = (row - down, col - right)
            if min(before) >= 0 and np.all(np.less(before, cells.shape)) and cells[before] == free:
                faces += 1
                behind = [(row + n * down, col + n * right) for n in range(deep)]
                inside = [n for n in behind if min(n) >= 0 and np.all(np.less(n, cells.shape))]
                deep_faces += len(inside) == deep and all(cells[n] == occupied for n in inside)
    return faces, deep_faces


def hollowed(cells):
    """The cells with what is black on all sides unknown."""
    result = cells.copy()
    for row in range(1, cells.shape[0] - 1):
        for col in range(1, cells.shape[1] - 1):
            if (cells[row - 1 : row + 2, col - 1 : col + 2] == 0).all():
                result[row, col] = 127
    return result


def polygon_meets(polygon, row, col):
    """Whether a convex polygon (n, 2) of (col, row) meets a cell, by separating axes."""
    square = np.array([(col, row), (col + 1, row), (col + 1, row + 1), (col, row + 1)], float)
    axes = [np.array([1.0, 0.0]), np.array([0.0, 1.0])]
    for a, b in itertools.combinations(polygon, 2):  # the edges are among the chords
        axes.append(np.array([b[1] - a[1], a[0] - b[0]]))
    for axis in axes:
        length = math.hypot(*axis)
        if length < 1e-9:
            continue
        shadow, other = polygon @ axis / length, square @ axis / length
        if shadow.min() >= other.max() - 1e-9 or shadow.max() <= other.min() + 1e-9:
            return False
    return True


def swept_parts(outline, poses):
    """The corners of the outlines at both ends of each part of at most 2 degrees, by moves."""
    for n, (pose, after) in enumerate(itertools.pairwise(poses)):
        turn = math.remainder(after[2] - pose[2], 2 * math.pi)
        parts = max(1, math.ceil(abs(turn) / math.radians(2) - 1e-9))
        for part in range(parts):
            corners = []
            for share in (part / parts, (part + 1) / parts):
                heading = pose[2] + turn * share
                cos, sin = math.cos(heading), math.sin(heading)
                for x, y in outline / math.cos(turn / parts / 2):
                    along = pose[:2] + share * (after[:2] - pose[:2])
                    corners.append((along[0] + cos * x - sin * y, along[1] + sin * x + cos * y))
            yield n, np.array(corners)


def first_hit(occupied, outline, poses):
    """Index of the first move between poses that meets an occupied cell, or -1."""
    cells = np.argwhere(occupied)
    for n, corners in swept_parts(outline, poses):
        if any(polygon_meets(corners, row, col) for row, col in cells):
            return n
    return -1


def swept(outline, poses, reach):
    """Cells that an outline sweeps, around cell (0, 0)."""
    size = range(-reach, reach + 1)
    met = np.zeros((len(size), len(size)), bool)
    for _, corners in swept_parts(outline, poses):
        for row, col in itertools.product(size, repeat=2):
            met[row + reach, col + reach] |= polygon_meets(corners, row, col)
    return met


def costs_between_states(edges, starts):
    """Least cost from any start to each state, over edges {state: [(other, cost), ...]}."""
    cost = dict.fromkeys(starts, 0.0)
    waiting = [(0.0, state) for state in starts]
    heapq.heapify(waiting)
    while waiting:
        here, state = heapq.heappop(waiting)
        if here > cost[state]:
            continue
        for other, step in edges.get(state, ()):
            if here + step < cost.get(other, math.inf):
                cost[other] = here + step
                heapq.heappush(waiting, (here + step, other))
    return cost


def widened(plane, level):
    """Whether any of the next 2 ** level cells of the row is set, cell by cell."""
    return np.array(
        [[any(row[col : col + 2**level]) for col in range(len(row))] for row in plane.tolist()]
    )


def add_runs(plane, runs, shape):
    """Cells of the map from which any cell of the runs (row, first column, number) is set."""
    (rows, columns), margin = shape, (plane.shape[0] - shape[0]) // 2
    met = np.zeros(shape, bool)
    for row, col, (away, begin, count) in itertools.product(range(rows), range(columns), runs):
        first = col + begin + margin
        met[row, col] |= plane[row + away + margin, first : first + count].any()
    return met


def motions_between_cells(graph):
    """All free motions of a graph: (row, col), the motion, the other cell, and the cost."""
    ground, moves, _ = graph
    size = ground.rows, ground.columns
    for row, col, move in itertools.product(*map(range, size), range(len(moves.row))):
        there = row + int(moves.row[move]), col + int(moves.col[move])
        if not (0 <= there[0] < size[0] and 0 <= there[1] < size[1]):
            continue
        at = there if moves.at_end[move] else (row, col)
        word = ground.masks[moves.mask_heading[move], at[0], at[1] // 64, moves.slot[move]]
        if int(word) >> (at[1] % 64) & 1:
            continue
        cost = moves.extra[move]
        for k in range(moves.cells[move]):
            cell = row * ground.columns + col + moves.crossed[move, k]
            cost += moves.lengths[move, k] * ground.half[cell]
        yield (row, col), move, there, cost


def project(graph, goal):
    """Least cost from each cell to the goal's, of motions of any heading."""
    backward = {}
    for here, _, there, cost in motions_between_cells(graph):
        backward.setdefault(there, []).append((here, cost))
    return costs_between_states(backward, [goal])


def explore(graph, starts):
    """Least cost from any start to each state (row, col, heading, gear)."""
    moves, terms, edges = graph.moves, graph.terms, {}
    for here, move, there, cost in motions_between_cells(graph):
        for gear in range(terms.gears):
            keeps = moves.gear[move] == 2 or terms.gears == 1
            to_gear = gear if keeps else moves.gear[move]
            change = terms.gear_change if to_gear != gear else 0.0
            state = (*here, moves.source[move], gear)
            other = (*there, moves.target[move], to_gear)
            edges.setdefault(state, []).append((other, cost + change))
    return costs_between_states(edges, starts)


def own_costs(density, drive, poses, step=1e-3):
    """Cost of each line between poses in tiny steps; infinite where it cannot be driven."""
    result, gear = [], 0
    for pose, after in itertools.pairwise(poses.tolist()):
        apart = after[0] - pose[0], after[1] - pose[1]
        length, turn = math.hypot(*apart), math.remainder(after[2] - pose[2], 2 * math.pi)
        if length < 1e-6:
            result.append(drive.turn * abs(turn) if drive.turn > 0 or turn == 0 else math.inf)
            continue
        way = math.atan2(apart[1], apart[0])
        aslant = math.remainder(way - pose[2] - turn / 2, 2 * math.pi)
        now = 1 if abs(aslant) < 0.05 else -1 if math.pi - abs(aslant) < 0.05 else 0
        tight = drive.turn == 0 and abs(turn) * drive.radius > length * 1.001
        if tight or (now < 0 and drive.kind == 1) or (now == 0 and not drive.sideways):
            result.append(math.inf)
            continue
        cost = motion_cost(density, [0.0], [length], 1.0, (pose[0], pose[1], way), step)
        cost *= 1.0 if now > 0 else drive.reverse
        result.append(cost + drive.gear_change * (gear * now < 0))
        gear = now or gear
    return np.array(result)


def curve_cost(density, drive, turns, lengths, start, step=1e-3):
    """Cost of a curve with its turns and lengths, piece by piece, in tiny steps."""
    total, gear = 0.0, 0.0
    (x, y, heading), radius = start, drive.radius
    for turn, length in zip(turns, lengths, strict=True):
        if length == 0:
            continue
        if turn and drive.turn > 0:
            total += drive.turn * abs(length) / radius
        else:
            cost = motion_cost(density, [turn], [length], radius, (x, y, heading), step)
            total += cost * (1.0 if length > 0 else drive.reverse)
            total += drive.gear_change * (gear * length < 0)
            gear = length
        for _ in range(1000):
            half = turn * length / radius / 2000
            x += length / 1000 * math.cos(heading + half)
            y += length / 1000 * math.sin(heading + half)
            heading += 2 * half
    return total


def straightest(count, cost_of, own, lookahead):
    """Least cost of a chain of curves (`cost_of` two knots) and own edges over knots in order."""
    best = [0.0]
    for j in range(1, count):
        ways = [best[j - 1] + own[j - 1]]
        ways += [best[i] + cost_of(i, j) for i in range(max(0, j - lookahead), j)]
        best.append(min(ways))
    return best[-1]


def shift_knots(knots, own, cost_of, steps):
    """Knots shifted in turn wherever both curves beside them cost less, and these costs."""
    knots, own = [tuple(knot) for knot in knots.tolist()], list(own)
    for _ in range(4):
        before = list(knots)
        for k in range(1, len(knots) - 1):
            x, y, heading = knots[k]
            for aside, turn in itertools.product((-1, 0, 1), repeat=2):
                here = (
                    x - aside * steps[0] * math.sin(heading),
                    y + aside * steps[0] * math.cos(heading),
                    heading + turn * steps[1],
                )
                costs = cost_of(knots[k - 1], here), cost_of(here, knots[k + 1])
                if sum(costs) < (own[k - 1] + own[k]) * (1 - 1e-7):
                    knots[k], (own[k - 1], own[k]) = here, costs
        if knots == before:
            break
    return np.array(knots), np.array(own)


def passed_cells(origin, end, margin):
    """Cells of a beam up to a margin before its end, as `cells_along` has them."""
    origin, end = np.asarray(origin), np.asarray(end)
    length = np.hypot(*(end - origin))
    kept = max(0.0, 1 - margin / length) if length else 0.0
    way = np.array([origin, origin + kept * (end - origin)])
    return [(row, col) for row, col, _ in cells_along(way)]


def count_scans(stops, origins, ends, margin):
    """Numbers of the scans that pass each cell, and that end in it, up to cells that stop beams."""
    passed, hit = np.zeros(stops.shape, int), np.zeros(stops.shape, int)
    for origin, scan in zip(origins, ends, strict=True):
        on_way, at_end = set(), set()
        for end in scan[~np.isnan(scan[:, 0])]:
            way = [each for each in passed_cells(origin, end, margin) if _on(stops, each)]
            stopped = [n for n, each in enumerate(way) if stops[each]]
            on_way |= {*way[: stopped[0] if stopped else None]}
            last = tuple(np.floor(end).astype(int).tolist())
            at_end |= {last} if not stopped and _on(stops, last) else set()
        for cell in on_way:
            passed[cell] += 1
        for cell in at_end:
            hit[cell] += 1
    return passed, hit


def _on(mask, cell):
    return 0 <= cell[0] < mask.shape[0] and 0 <= cell[1] < mask.shape[1]
