"""How a map's file should be read: thresholds by its greys, and the resolution by ranges."""

from __future__ import annotations

from dataclasses import dataclass, replace

from locplan.maps.files import MapSource, with_corrected_thresholds
from locplan.maps.grid import OccupancyGrid


@dataclass(frozen=True)
class MapReading:
    """How a map's file should be read, and what is to be changed in it."""

    grid: OccupancyGrid
    """The map that is meant."""
    reasons: tuple[str, ...] = ()
    """What each change is, and what it does."""
    is_sure: bool = False
    """Whether something is wrong whatever drives say."""
    scale: float = 1.0
    """Factor that its lengths should have."""

    @classmethod
    def from_source(cls, grid: OccupancyGrid, source: MapSource | None) -> MapReading:
        """By other thresholds, where dark greys seem to be walls, or unknown is read as free.

        Parameters
        ----------
        grid : OccupancyGrid
            The map as its file says.
        source : MapSource or None
            How it was read.
        """
        corrected, reasons = with_corrected_thresholds(grid, source), []
        if source is None or corrected is grid:
            return cls(grid)
        free, occupied = source.corrected_thresholds
        if source.has_dark_walls:
            reasons.append(f"occupied_thresh {occupied:g}, so that dark greys are walls")
        if source.has_free_grey:
            reasons.append(f"free_thresh {free:g}, so that map_saver's grey is unknown")
        return cls(corrected, reasons=tuple(reasons), is_sure=source.has_free_grey)

    @property
    def title(self) -> str:
        """The changes, in words."""
        return " and ".join(self.reasons)

    def with_scale(self, factor: float) -> MapReading:
        """The same with another resolution; its grid stays in the lengths of the file."""
        resolution = self.grid.resolution * factor
        sentence = f"resolution {resolution:.4g}, as the ranges of recorded drives say"
        return replace(self, reasons=(*self.reasons, sentence), is_sure=True, scale=factor)

    @property
    def lengths(self) -> dict[str, object]:
        """The entries of the map's YAML for its true lengths; none where the file has them."""
        if self.scale == 1:
            return {}
        true = self.in_metres(self.grid)
        origin = [round(coordinate, 4) for coordinate in true.origin[:2]] + [true.origin[2]]
        return {"resolution": float(f"{true.resolution:.4g}"), "origin": origin}

    def in_metres(self, grid: OccupancyGrid) -> OccupancyGrid:
        """A map in the lengths of the file, in true ones."""
        x, y, yaw = grid.origin
        origin = x * self.scale, y * self.scale, yaw
        return replace(grid, resolution=grid.resolution * self.scale, origin=origin)
