from ._checked import CheckReport as CheckReport
from ._explore import (
    Explorer as Explorer,
    check_installed as check_installed,
    explore as explore,
    opened as opened,
)
from ._scene import Limits as Limits, Opening as Opening
from ._session import Session as Session
