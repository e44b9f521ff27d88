from ._contents import Source as Source
from ._fit import MapFit as MapFit, fit_to_map as fit_to_map
from ._read import read_drive as read_drive
from ._recording import Recording as Recording
from ._summary import DriveSummary as DriveSummary
