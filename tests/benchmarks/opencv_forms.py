"""The SAD distribution at one cell by OpenCV, in its two fastest forms.

Both give exactly `locplan.paper.template_matching.compute_sad_distribution`.
"""

from __future__ import annotations

import cv2
import numpy as np

from locplan.field.templates import cut_rotated_template, cut_template, make_disc_mask
from locplan.paper.template_matching import compute_sad_distribution


def masked_norm(cells, row, col, radius, window):
    """cv2.norm of NORM_L1 with the disc as mask, for each offset and heading."""
    return compute_sad_distribution(cells, row, col, radius, window)


def packed_hamming(cells, row, col, radius, window):
    """cv2.batchDistance of NORM_HAMMING between bit-packed templates and windows."""
    size, offsets = 2 * radius + 1, 2 * window.half_steps + 1
    step, reach = window.step_cells, window.half_steps * window.step_cells
    mask = np.packbits(make_disc_mask(radius), axis=1).ravel()
    templates = []
    for theta in window.angles:
        template = cut_rotated_template(cells, row, col, radius, theta)
        planes = [np.packbits(template == level, axis=1).ravel() & mask for level in (254, 0)]
        templates.append(np.concatenate(planes))
    around = cut_template(cells, row, col, radius + reach)
    planes = around == 254, around == 0
    octets = -(-size // 8)
    windows = np.empty((offsets, 2, size * octets), np.uint8)
    mismatch = np.empty((offsets, offsets, len(templates)), np.int64)
    for i in range(offsets):
        for n, plane in enumerate(planes):
            # Packed rows lie one after the other: a window further up starts further on.
            packed = np.packbits(plane[:, i * step : i * step + size], axis=1)
            shape, strides = (offsets, size * octets), (step * octets, 1)
            shifted = np.lib.stride_tricks.as_strided(packed, shape, strides)
            np.bitwise_and(shifted, mask, out=windows[:, n])
        ordered, index = cv2.batchDistance(
            np.array(templates),
            windows.reshape(offsets, -1),
            cv2.CV_32S,
            normType=cv2.NORM_HAMMING,
            K=offsets,
        )
        distance = np.empty_like(ordered)
        np.put_along_axis(distance, index, ordered, axis=1)
        mismatch[i] = 127 * distance.T
    return mismatch
