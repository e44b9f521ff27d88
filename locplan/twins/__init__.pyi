from ._locate import locate as locate
from ._located_drive import LocatedDrive as LocatedDrive, locate_drive as locate_drive
from ._location import Location as Location, Mode as Mode
from ._location_figures import (
    locate_figure as locate_figure,
    located_drive_figure as located_drive_figure,
)
from ._matching import Matching as Matching
from ._scan_database import ScanDatabase as ScanDatabase
