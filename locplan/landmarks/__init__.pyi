from ._figures import landmarks_figure as landmarks_figure
from ._landmarks import Landmarks as Landmarks, Setting as Setting
from ._objects import (
    Box as Box,
    LandmarkObject as LandmarkObject,
    Pole as Pole,
    Shape as Shape,
    cells_under as cells_under,
    parsed_object as parsed_object,
    with_objects as with_objects,
)
from ._place import place_landmarks as place_landmarks
from ._verification import Outcome as Outcome, Verification as Verification
from ._verify import verify_landmarks as verify_landmarks
