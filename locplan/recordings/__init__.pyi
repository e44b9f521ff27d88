from ._contents import Source as Source
from ._evaluation import (
    Agreement as Agreement,
    DriveEvaluation as DriveEvaluation,
    evaluate_drive as evaluate_drive,
)
from ._fit import MapFit as MapFit, fit_to_map as fit_to_map
from ._matches import Matches as Matches, match_scans as match_scans
from ._read import read_drive as read_drive
from ._recording import Recording as Recording
from ._summary import DriveSummary as DriveSummary
