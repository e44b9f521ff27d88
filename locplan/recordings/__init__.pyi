from ._read import read_drive as read_drive
from ._recording import Recording as Recording, Source as Source
from ._summary import DriveSummary as DriveSummary
