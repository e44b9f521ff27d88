from ._database import (
    Database as Database,
    make_database as make_database,
    places_every as places_every,
)
from ._matcher import Matcher as Matcher, Posteriors as Posteriors
from ._matching import (
    GLOBAL_EFFECTIVE_BEAMS as GLOBAL_EFFECTIVE_BEAMS,
    STEP as STEP,
    TURNS as TURNS,
    Matching as Matching,
)
from ._modes import (
    APART as APART,
    AWAY as AWAY,
    ENOUGH as ENOUGH,
    MIN_RETURNS as MIN_RETURNS,
    TURNED as TURNED,
    ends_of as ends_of,
    find_all_modes as find_all_modes,
    find_modes as find_modes,
    in_batches as in_batches,
    joined_to as joined_to,
    losses_at as losses_at,
    moved_to_least as moved_to_least,
    refined as refined,
    shortlisted as shortlisted,
    turning_lever as turning_lever,
)
from ._scan_database import (
    CLEARANCE as CLEARANCE,
    ScanDatabase as ScanDatabase,
    checked_database as checked_database,
)
