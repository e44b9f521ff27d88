"""Occupancy grid maps: read, written, generated, and checked for faults."""

from locplan.maps import environments
from locplan.maps.files import MapWarning, find_maps, load_map, read_map, save_map
from locplan.maps.grid import OccupancyGrid
from locplan.maps.map_faults import MapFaults, faults, hollow_walls, measure_solidity
from locplan.maps.occupancy import FREE, OCCUPIED, UNKNOWN
from locplan.maps.zones import Zone, Zones

__all__ = [
    "FREE",
    "OCCUPIED",
    "UNKNOWN",
    "MapFaults",
    "MapWarning",
    "OccupancyGrid",
    "Zone",
    "Zones",
    "environments",
    "faults",
    "find_maps",
    "hollow_walls",
    "load_map",
    "measure_solidity",
    "read_map",
    "save_map",
]
