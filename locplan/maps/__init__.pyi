from . import environments as environments
from ._files import find_maps as find_maps
from ._files import load_map as load_map
from ._files import name_of as name_of
from ._files import save_map as save_map
from ._grid import FREE as FREE
from ._grid import OCCUPIED as OCCUPIED
from ._grid import UNKNOWN as UNKNOWN
from ._grid import OccupancyGrid as OccupancyGrid
from ._ros_parameters import read_parameters as read_parameters

__all__ = [
    "FREE",
    "OCCUPIED",
    "UNKNOWN",
    "OccupancyGrid",
    "environments",
    "find_maps",
    "load_map",
    "name_of",
    "read_parameters",
    "save_map",
]
