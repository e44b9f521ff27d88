from . import environments as environments
from ._built_in import BUILT_IN as BUILT_IN, is_built_in as is_built_in
from ._extent import extent_text as extent_text, own_axes as own_axes
from ._faults import MapFaults as MapFaults, faults as faults
from ._files import (
    MapWarning as MapWarning,
    as_meant as as_meant,
    find_maps as find_maps,
    load_map as load_map,
    meant_header as meant_header,
    name_of as name_of,
    read_map as read_map,
    save_map as save_map,
    source_files as source_files,
)
from ._grid import OccupancyGrid as OccupancyGrid, check_grid as check_grid
from ._misleading import MapFault as MapFault, boxes_of as boxes_of, of_mask as of_mask
from ._occupancy import FREE as FREE, OCCUPIED as OCCUPIED, UNKNOWN as UNKNOWN
from ._solid import Solidity as Solidity, hollowed as hollowed, solidity as solidity
from ._source import MapSource as MapSource
