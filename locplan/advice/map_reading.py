"""Corrections of a map's file: thresholds by its grey levels, resolution by lidar ranges."""

from __future__ import annotations

from dataclasses import dataclass, replace

from locplan.maps.files import MapSource, with_corrected_thresholds
from locplan.maps.grid import OccupancyGrid


@dataclass(frozen=True)
class MapCorrection:
    """Corrections of a map's file, and the corrected map."""

    grid: OccupancyGrid
    """The corrected map."""
    reasons: tuple[str, ...] = ()
    """Each change with its effect."""
    is_certain: bool = False
    """True if the file is wrong for certain, even if no drive improves."""
    scale: float = 1.0
    """Factor from the file's lengths to true lengths."""

    @classmethod
    def from_source(cls, grid: OccupancyGrid, source: MapSource | None) -> MapCorrection:
        """Return corrected thresholds if dark greys seem to be walls, or unknown is read as free.

        Parameters
        ----------
        grid : OccupancyGrid
            The map as read with the file's thresholds.
        source : MapSource or None
            The map's file and thresholds.
        """
        corrected, reasons = with_corrected_thresholds(grid, source), []
        if source is None or corrected is grid:
            return cls(grid)
        free, occupied = source.corrected_thresholds
        if source.has_dark_walls:
            reasons.append(f"occupied_thresh {occupied:g}, so that dark greys are walls")
        if source.has_free_grey:
            reasons.append(f"free_thresh {free:g}, so that map_saver's grey is unknown")
        return cls(corrected, reasons=tuple(reasons), is_certain=source.has_free_grey)

    @property
    def title(self) -> str:
        """The changes, in words."""
        return " and ".join(self.reasons)

    def with_scale(self, factor: float) -> MapCorrection:
        """Return the correction with another resolution; its grid keeps the file's lengths."""
        resolution = self.grid.resolution * factor
        sentence = f"resolution {resolution:.4g}, from the ranges of recorded drives"
        return replace(self, reasons=(*self.reasons, sentence), is_certain=True, scale=factor)

    @property
    def corrected_lengths(self) -> dict[str, object]:
        """The corrected lengths in the map's YAML; empty if the file is right."""
        if self.scale == 1:
            return {}
        true = self.rescale(self.grid)
        origin = [round(coordinate, 4) for coordinate in true.origin[:2]] + [true.origin[2]]
        return {"resolution": float(f"{true.resolution:.4g}"), "origin": origin}

    def rescale(self, grid: OccupancyGrid) -> OccupancyGrid:
        """Rescale a map from the file's lengths to true lengths."""
        x, y, yaw = grid.origin
        origin = x * self.scale, y * self.scale, yaw
        return replace(grid, resolution=grid.resolution * self.scale, origin=origin)
