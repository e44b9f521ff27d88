from . import environments as environments
from ._files import (
    MapWarning as MapWarning,
    find_maps as find_maps,
    load_map as load_map,
    name_of as name_of,
    read_map as read_map,
    save_map as save_map,
    source_files as source_files,
)
from ._grid import OccupancyGrid as OccupancyGrid, check_grid as check_grid, own_axes as own_axes
from ._misleading import misleading as misleading
from ._occupancy import FREE as FREE, OCCUPIED as OCCUPIED, UNKNOWN as UNKNOWN
from ._source import MapSource as MapSource
