"""Curves of bounded curvature between two poses, and their arcs over the cells of a grid.

The shortest curves are by Dubins (1957) and by Reeds and Shepp (1990): words of up to five
pieces: turns, 1 (left), -1 (right) or 0 (straight), and their lengths, negative in
reverse. In words all lengths are in turning radii. On a grid, positions are (x, y), column and row
in cells; headings turn from the columns' direction towards the rows' [rad].
"""

from __future__ import annotations

import math

import numpy as np

from locplan._support.compilation import njit
from locplan._support.kernels.arrays import Array, Numbers

STRAIGHT, DUBINS, REEDS_SHEPP = 0, 1, 2
PIECES = 5
QUARTER, TURN = math.pi / 2, 2 * math.pi
SLACK = 1e-9
"""Rounding error up to which a turn short of a whole circle, or backwards, counts as none [rad]."""
_BASE_WORDS = 8
_ALSO_REVERSED = (2, 5, 6)
"""Base words that differ when driven from the end to the start."""


@njit(nogil=True, cache=True)
def find_dubins_curve(
    x: float, y: float, heading: float, x1: float, y1: float, heading1: float
) -> tuple[Array, Array]:
    """Return the shortest curve forward from one pose to another: turns (5,), lengths (5,)."""
    turns, lengths = np.zeros(PIECES, np.int8), np.zeros(PIECES)
    shortest = np.inf
    for side in (1, -1):
        for side1 in (1, -1):
            # From the centre of the first circle to that of the last.
            across = x1 - side1 * math.sin(heading1) - x + side * math.sin(heading)
            along = y1 + side1 * math.cos(heading1) - y - side * math.cos(heading)
            distance, bearing = math.hypot(across, along), math.atan2(along, across)
            straight = distance if side == side1 else math.sqrt(max(0.0, distance**2 - 4))
            if side == side1 or distance >= 2:
                tilt = 0.0 if side == side1 else side * math.atan2(2.0, straight)
                first = _wrap_to_circle(side * (bearing + tilt - heading))
                last = _wrap_to_circle(side1 * (heading1 - bearing - tilt))
                if first + straight + last < shortest:
                    shortest = first + straight + last
                    turns[:3] = side, 0, side1
                    lengths[:3] = first, straight, last
            if side != side1 or distance > 4:
                continue
            for opening in (1, -1):
                # The middle circle touches both; its centre is aside of the line between them.
                middle_bearing = bearing + opening * math.acos(distance / 4)
                to_last = math.atan2(
                    along - 2 * math.sin(middle_bearing), across - 2 * math.cos(middle_bearing)
                )
                leave, enter = middle_bearing + side * QUARTER, to_last - side * QUARTER
                first = _wrap_to_circle(side * (leave - heading))
                middle = _wrap_to_circle(side * (leave - enter))
                last = _wrap_to_circle(side * (heading1 - enter))
                if first + middle + last < shortest:
                    shortest = first + middle + last
                    turns[:3] = side, -side, side
                    lengths[:3] = first, middle, last
    return turns, lengths


@njit(nogil=True, cache=True)
def find_reeds_shepp_curve(
    x: float, y: float, heading: float, x1: float, y1: float, heading1: float
) -> tuple[Array, Array]:
    """Return the shortest curve from one pose to another: turns and lengths (5,).

    It is one of the base words of the paper's sections 8.1-8.11 in their up to eight symmetric
    forms: driven in reverse, mirrored, and from the end to the start.
    """
    cos, sin = math.cos(heading), math.sin(heading)
    ahead = (x1 - x) * cos + (y1 - y) * sin
    left = (y1 - y) * cos - (x1 - x) * sin
    turn_angle = heading1 - heading
    turns, lengths = np.zeros(PIECES, np.int8), np.zeros(PIECES)
    sides, parts = np.zeros(PIECES, np.int8), np.zeros(PIECES)
    shortest = np.inf
    for number in range(_BASE_WORDS):
        for backward in range(2 if number in _ALSO_REVERSED else 1):
            for gear in (1, -1):
                for mirror in (1, -1):
                    to_x, to_y = ahead, left
                    if backward:
                        to_x = ahead * math.cos(turn_angle) + left * math.sin(turn_angle)
                        to_y = ahead * math.sin(turn_angle) - left * math.cos(turn_angle)
                    sides[:], parts[:] = 0, 0.0
                    to_x, to_y, to_heading = gear * to_x, mirror * to_y, gear * mirror * turn_angle
                    if not _fill_word(number, to_x, to_y, to_heading, sides, parts):
                        continue
                    length = np.abs(parts).sum()
                    if length < shortest:
                        shortest = length
                        for n in range(PIECES):
                            of = n
                            if backward:
                                of = (2 if number == 2 else 3) - n
                            turns[n] = mirror * sides[of] if of >= 0 else 0
                            lengths[n] = gear * parts[of] if of >= 0 else 0.0
    return turns, lengths


@njit(nogil=True, cache=True)
def _fill_word(
    word_number: int, x: float, y: float, heading: float, sides: Array, piece_lengths: Array
) -> bool:
    """Fill in base word `word_number` from the origin to a pose; return False without a fit."""
    # The last circle's centre from the first one's, if both turn left, and if the last turns right.
    same = x - math.sin(heading), y - 1 + math.cos(heading)
    opposite = x + math.sin(heading), y - 1 - math.cos(heading)
    if word_number < 2:
        return _fill_straight_word(word_number, same, opposite, heading, sides, piece_lengths)
    if word_number < 5:
        return _fill_turning_word(word_number, same, opposite, heading, sides, piece_lengths)
    return _fill_quarter_word(word_number, same, opposite, heading, sides, piece_lengths)


@njit(nogil=True, cache=True)
def _fill_straight_word(
    word_number: int,
    same: Numbers,
    opposite: Numbers,
    heading: float,
    sides: Array,
    piece_lengths: Array,
) -> bool:
    """Fill in a word of two turns around a straight: number 0 or 1."""
    if word_number == 0:  # 8.1: left, straight, left
        bearing = math.atan2(same[1], same[0])
        first, last = _wrap_to_half_circles(bearing), _wrap_to_half_circles(heading - bearing)
        sides[:3] = 1, 0, 1
        piece_lengths[:3] = first, math.hypot(*same), last
        return first >= -SLACK and last >= -SLACK
    across, towards = math.hypot(*opposite), math.atan2(opposite[1], opposite[0])
    if across < 2:  # 8.2: left, straight, right
        return False
    straight = math.sqrt(across**2 - 4)
    first = _wrap_to_half_circles(towards + math.atan2(2.0, straight))
    last = _wrap_to_half_circles(first - heading)
    sides[:3] = 1, 0, -1
    piece_lengths[:3] = first, straight, last
    return first >= -SLACK and last >= -SLACK


@njit(nogil=True, cache=True)
def _fill_turning_word(
    word_number: int,
    same: Numbers,
    opposite: Numbers,
    heading: float,
    sides: Array,
    piece_lengths: Array,
) -> bool:
    """Fill in a word of turns alone: number 2, 3 or 4."""
    if word_number == 2:  # 8.3, 8.4: left, right in reverse, left
        distance, bearing = math.hypot(*same), math.atan2(same[1], same[0])
        if distance > 4:
            return False
        middle = -2 * math.asin(distance / 4)
        first = _wrap_to_half_circles(bearing + middle / 2 + math.pi)
        sides[:3] = 1, -1, 1
        piece_lengths[:3] = first, middle, _wrap_to_half_circles(heading - first + middle)
        return first >= -SLACK
    across = math.hypot(*opposite)
    sides[:4] = 1, -1, 1, -1
    if word_number == 3:  # 8.7: left, right, left and right in reverse, the middle two equal
        ratio = (2 + across) / 4
        if ratio > 1:
            return False
        middle = math.acos(ratio)
        first, last = _compute_outer_turns(middle, -middle, opposite, heading)
        piece_lengths[:4] = first, middle, -middle, last
        return first >= -SLACK and last <= SLACK
    ratio = (20 - across**2) / 16  # 8.8: left, right and left in reverse, right, likewise
    if not 0 <= ratio <= 1:
        return False
    middle = -math.acos(ratio)
    first, last = _compute_outer_turns(middle, middle, opposite, heading)
    piece_lengths[:4] = first, middle, middle, last
    return first >= -SLACK and last >= -SLACK


@njit(nogil=True, cache=True)
def _fill_quarter_word(
    word_number: int,
    same: Numbers,
    opposite: Numbers,
    heading: float,
    sides: Array,
    piece_lengths: Array,
) -> bool:
    """Fill in a word with quarters of a circle: number 5, 6 or 7."""
    distance, bearing = math.hypot(*same), math.atan2(same[1], same[0])
    across = math.hypot(*opposite)
    if (distance if word_number == 5 else across) < 2:
        return False
    if word_number == 5:  # 8.9: left, a quarter right in reverse, straight, left
        over = math.sqrt(distance**2 - 4)
        first = _wrap_to_half_circles(bearing + math.atan2(over, -2.0))
        last = _wrap_to_half_circles(heading - QUARTER - first)
        sides[:4] = 1, -1, 0, 1
        piece_lengths[:4] = first, -QUARTER, 2 - over, last
        return first >= -SLACK and over >= 2 - SLACK and last <= SLACK
    if word_number == 6:  # 8.10: left, a quarter right in reverse, straight, right
        first = math.atan2(opposite[0], -opposite[1])
        last = _wrap_to_half_circles(first + QUARTER - heading)
        sides[:4] = 1, -1, 0, -1
        piece_lengths[:4] = first, -QUARTER, 2 - across, last
        return first >= -SLACK and last <= SLACK
    # 8.11: left, quarters right and left around a straight in reverse, right
    straight = 4 - math.sqrt(across**2 - 4)
    if straight > 0:
        return False
    towards_y = (4 - straight) * opposite[0] - 2 * opposite[1]
    towards_x = -2 * opposite[0] + (straight - 4) * opposite[1]
    first = _wrap_to_half_circles(math.atan2(towards_y, towards_x))
    last = _wrap_to_half_circles(first - heading)
    sides[:] = 1, -1, 0, 1, -1
    piece_lengths[:] = first, -QUARTER, straight, -QUARTER, last
    return first >= -SLACK and last >= -SLACK


@njit(nogil=True, cache=True)
def _compute_outer_turns(second: float, third: float, opposite: Numbers, heading: float) -> Numbers:
    """Return the first and last of four turns, whose middle two are known."""
    x, y = opposite
    between = _wrap_to_half_circles(second - third)
    a = math.sin(second) - math.sin(between)
    b = math.cos(second) - math.cos(between) - 1
    first = math.atan2(y * a - x * b, x * a + y * b)
    if 2 * (math.cos(between) - math.cos(third) - math.cos(second)) + 3 < 0:
        first += math.pi
    first = _wrap_to_half_circles(first)
    return first, _wrap_to_half_circles(first - second + third - heading)


@njit(nogil=True, cache=True)
def _wrap_to_circle(angle: float) -> float:
    """Wrap an angle into 0..2 pi [rad]."""
    angle %= TURN
    return 0.0 if angle > TURN - SLACK else angle


@njit(nogil=True, cache=True)
def _wrap_to_half_circles(angle: float) -> float:
    """Wrap an angle into -pi..pi [rad]."""
    return angle - TURN * round(angle / TURN)


@njit(nogil=True, cache=True)
def advance_pose(
    x: float, y: float, heading: float, turn: int, length: float, radius: float
) -> tuple[float, float, float]:
    """Return the pose at the end of one piece of a curve."""
    if turn == 0:
        return x + length * math.cos(heading), y + length * math.sin(heading), heading
    heading1 = heading + turn * length / radius
    x1 = x + turn * radius * (math.sin(heading1) - math.sin(heading))
    y1 = y - turn * radius * (math.cos(heading1) - math.cos(heading))
    return x1, y1, heading1


@njit(nogil=True, cache=True)
def find_arc_crossings(
    center_x: float, center_y: float, radius: float, low: float, high: float
) -> Array:
    """Return the angles of an arc's ends and of its crossings of borders between cells, ascending.

    The angles are seen from its centre [rad]; some occur twice.
    """
    angles = np.empty(int(2 * (high - low) * radius) + 32)
    angles[0], count, at = low, 1, low
    quadrant = math.floor(low / QUARTER + 1e-12)
    while at < high:
        # Within a quadrant of the circle each coordinate only grows or only falls.
        until = min((quadrant + 1) * QUARTER, high)
        middle = (at + until) / 2
        x_way = -1 if math.sin(middle) > 0 else 1
        y_way = 1 if math.cos(middle) > 0 else -1
        x_line = _find_next_cell_border(center_x + radius * math.cos(at), x_way)
        y_line = _find_next_cell_border(center_y + radius * math.sin(at), y_way)
        x_at = _invert_sine_or_cosine((x_line - center_x) / radius, middle, False)
        y_at = _invert_sine_or_cosine((y_line - center_y) / radius, middle, True)
        while min(x_at, y_at) < until:
            if x_at < y_at:
                angles[count] = max(at, x_at)
                x_line += x_way
                x_at = _invert_sine_or_cosine((x_line - center_x) / radius, middle, False)
            else:
                angles[count] = max(at, y_at)
                y_line += y_way
                y_at = _invert_sine_or_cosine((y_line - center_y) / radius, middle, True)
            count += 1
        angles[count] = at = until
        count += 1
        quadrant += 1
    return angles[:count]


@njit(nogil=True, cache=True)
def compute_arc(
    x: float, y: float, heading: float, turn: int, length: float, radius: float
) -> tuple[float, float, float, float]:
    """Return the centre of a turn, and the least and greatest angle of its arc seen from there."""
    begin, sweep = heading - turn * QUARTER, turn * length / radius
    center_x, center_y = x - radius * math.cos(begin), y - radius * math.sin(begin)
    return center_x, center_y, min(begin, begin + sweep), max(begin, begin + sweep)


@njit(nogil=True, cache=True)
def refine_angles(angles: Array, max_gap: float) -> Array:
    """Insert angles where neighbours are more than `max_gap` apart."""
    count = 1
    for n in range(len(angles) - 1):
        count += max(1, math.ceil((angles[n + 1] - angles[n]) / max_gap))
    result = np.empty(count)
    result[0], at = angles[0], 1
    for n in range(len(angles) - 1):
        n_parts = max(1, math.ceil((angles[n + 1] - angles[n]) / max_gap))
        for part in range(n_parts):
            share = (part + 1) / n_parts
            result[at] = angles[n] + share * (angles[n + 1] - angles[n])
            at += 1
    return result


@njit(nogil=True, cache=True)
def _find_next_cell_border(position: float, direction: int) -> float:
    """Return the next border between cells along one axis."""
    return math.floor(position) + 1.0 if direction > 0 else math.ceil(position) - 1.0


@njit(nogil=True, cache=True)
def _invert_sine_or_cosine(ratio: float, near: float, of_sine: bool) -> float:
    """Return the angle with sine (or cosine) `ratio`, in the quadrant of `near` or later."""
    if abs(ratio) >= 1:
        return np.inf
    if of_sine:
        angle = math.asin(ratio) if math.cos(near) > 0 else math.pi - math.asin(ratio)
    else:
        angle = math.acos(ratio) if math.sin(near) > 0 else -math.acos(ratio)
    return angle + TURN * round((near - angle) / TURN)
