from ._database import (
    Database as Database,
    make_database as make_database,
    places_every as places_every,
)
from ._matching import (
    GLOBAL_EFFECTIVE_BEAMS as GLOBAL_EFFECTIVE_BEAMS,
    STEP as STEP,
    TURNS as TURNS,
    Matcher as Matcher,
    Matching as Matching,
    Posteriors as Posteriors,
)
from ._modes import (
    APART as APART,
    AWAY as AWAY,
    ENOUGH as ENOUGH,
    MIN_RETURNS as MIN_RETURNS,
    TURNED as TURNED,
    ScanOnMap as ScanOnMap,
    in_batches as in_batches,
)
from ._scan_database import (
    CLEARANCE as CLEARANCE,
    ScanDatabase as ScanDatabase,
    checked_database as checked_database,
)
