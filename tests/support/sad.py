"""SAD without the shortcut of bounds, and the counts of its kernel."""

from __future__ import annotations

import numpy as np

from locplan.field import Sad
from locplan.field.kernels import sad as kernel
from locplan.field.templates import make_disc_mask


def count_mismatches(layout, *, visible=False, kept=None):
    """S / 127 at all cells of a layout, (n, dx, dy, theta); `kept` is (theta, n, dx)."""
    offsets, headings = 2 * layout.window.half_steps + 1, layout.window.angles.size
    kept = np.ones((headings, len(layout.part.rows), offsets), bool) if kept is None else kept
    result = np.full((kept.shape[1], offsets, offsets, headings), -1)
    weights = np.ones(2 * np.count_nonzero(make_disc_mask(layout.radius)) + 1)
    for group in layout.groups():
        tile, unused = layout.make_tile_layout(group), (np.zeros(2, np.int64), np.empty((1, 3, 3)))
        for n, cell in enumerate(group.cells):
            per_cell = ("corners", "rests", "places", "sum_places")
            one = tile._replace(**{name: getattr(tile, name)[n : n + 1] for name in per_cell})
            sees = layout.make_sight_rays(group) if visible else None
            seen = sees and sees._replace(rows=sees.rows[n : n + 1], cols=sees.cols[n : n + 1])
            scratch = kernel.make_cell_buffers(offsets, headings, layout.disc, masked=visible)
            marks, places = kept[:, [cell]], layout.window.cell_lattice_places
            kernel.fill_tile_covariances(one, seen, marks, weights, places, scratch, *unused)
            found = scratch[0].reshape(offsets, headings, -1)[:, :, :offsets].transpose(0, 2, 1)
            result[cell] = np.where(kept[:, cell].T[:, None], found, -1)
    return result


class PlainSad(Sad):
    """The estimator that compares all offsets."""

    def negligible_mismatch(self, resolution):
        return None
