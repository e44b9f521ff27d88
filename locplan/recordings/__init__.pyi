from ._ambiguous import (
    AmbiguousPlaces as AmbiguousPlaces,
    find_ambiguous_places as find_ambiguous_places,
)
from ._calibration import (
    calibrate_drive as calibrate_drive,
)
from ._evaluation import (
    DriveEvaluation as DriveEvaluation,
    evaluate_drive as evaluate_drive,
)
from ._figures import (
    drive_figure as drive_figure,
    replay_figure as replay_figure,
    trajectory_figure as trajectory_figure,
)
from ._fit import (
    MapFit as MapFit,
    check_place as check_place,
    fit_to_map as fit_to_map,
)
from ._locate import locate as locate, locate_drive as locate_drive
from ._location import LocatedDrive as LocatedDrive, Location as Location
from ._location_figures import (
    locate_figure as locate_figure,
    located_drive_figure as located_drive_figure,
)
from ._logs import Topics as Topics
from ._matches import (
    Matches as Matches,
    match_scans as match_scans,
)
from ._misfits import find_misfits as find_misfits
from ._odometry_noise import odometry_noise as odometry_noise
from ._range_fit import range_fit as range_fit
from ._recording import Recording as Recording
from ._recording_faults import (
    RecordingFaults as RecordingFaults,
    find_recording_faults as find_recording_faults,
)
from ._reference import referenced as referenced, trajectory_of as trajectory_of
from ._replay import Replay as Replay, replay as replay
from ._replayed_drive import (
    ReplayedDrive as ReplayedDrive,
    find_replay_limit as find_replay_limit,
)
from ._scan_noise import scan_noise as scan_noise
from ._smoothing import smooth as smooth
from ._study import (
    recording_output as recording_output,
    study_recording as study_recording,
)
from ._tracks import sparse_notes as sparse_notes
from ._trajectory import Jump as Jump, Trajectory as Trajectory
from ._tuning import tune_on_drive as tune_on_drive
from .files import read_recording as read_recording
from .simulated import record_drive as record_drive
