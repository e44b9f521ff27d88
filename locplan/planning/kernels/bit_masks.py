"""Bit masks of motions: a bit for each cell of a map, set if a motion from it is blocked."""

from __future__ import annotations

import numpy as np

from locplan._support.compilation import njit
from locplan._support.kernels.arrays import Array, Ints, Words

WORD = 64
"""Number of bits in a word."""


@njit(nogil=True, cache=True, error_model="numpy")
def widen_bits(bits: Words) -> Array:
    """Return masks whose bits are set if any of the next 1, 2, ... 64 bits is, (7, rows, words)."""
    rows, words = bits.shape
    result = np.zeros((7, rows, words), np.uint64)
    for row in range(rows):
        for word in range(words):
            result[0, row, word] = bits[row, word]
        for level in range(1, 7):
            step = np.uint64(1 << (level - 1))
            over = np.uint64(WORD) - step
            for word in range(words):
                next_word_mask = (
                    result[level - 1, row, word + 1] if word + 1 < words else np.uint64(0)
                )
                word_mask = result[level - 1, row, word]
                result[level, row, word] = (
                    word_mask | (word_mask >> step) | (next_word_mask << over)
                )
    return result


@njit(nogil=True, cache=True, error_model="numpy")
def mark_run_collisions(
    masks: Words, widened_bits: Words, runs: Ints, heading_and_slot: Ints, margin: int
) -> None:
    """Set the bits of cells if a motion from them meets a cell with a set bit.

    Parameters
    ----------
    masks : (headings, rows, words, slots) array
        The masks.
    widened_bits : (7, rows + 2 margin, words + 2 margin / 64) array
        The bits to meet, `widened`, with a margin [cells] that is a multiple of 64 around the map.
    runs : (n, 3) array
        Row, first column and number of the cells that the motion meets, from its beginning.
    heading_and_slot : (2,) array
        Heading and slot of the motion's mask.
    """
    rows, words = masks.shape[1], masks.shape[2]
    gathered = np.empty(words, np.uint64)
    for row in range(rows):
        for word in range(words):
            gathered[word] = 0
        for n in range(len(runs)):
            source_row, begin, left = runs[n, 0] + row + margin, runs[n, 1] + margin, runs[n, 2]
            while left > 0:
                level = 0
                while level < 6 and 2 << level <= left:
                    level += 1
                size = 1 << level
                line = widened_bits[level, source_row]
                for at in (begin, begin + min(size, left - size)):
                    first, shift = at // WORD, np.uint64(at % WORD)
                    if shift == 0:
                        for word in range(words):
                            gathered[word] |= line[word + first]
                    else:
                        over = np.uint64(WORD) - shift
                        for word in range(words):
                            low, high = line[word + first], line[word + first + 1]
                            gathered[word] |= (low >> shift) | (high << over)
                begin, left = begin + 2 * size, left - 2 * size
        for word in range(words):
            masks[heading_and_slot[0], row, word, heading_and_slot[1]] |= gathered[word]
