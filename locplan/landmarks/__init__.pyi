from ._features import Feature as Feature, KeyFeatures as KeyFeatures
from ._figures import (
    key_features_figure as key_features_figure,
    landmarks_figure as landmarks_figure,
)
from ._key_features import key_features as key_features
from ._landmarks import Landmarks as Landmarks, Trial as Trial
from ._objects import (
    Box as Box,
    LandmarkObject as LandmarkObject,
    Pole as Pole,
    Shape as Shape,
    cells_under as cells_under,
    parsed_object as parsed_object,
    with_objects as with_objects,
)
from ._outcomes import (
    FeatureDrives as FeatureDrives,
    Outcome as Outcome,
    Verification as Verification,
)
from ._place import place_landmarks as place_landmarks
from ._places import Rejected as Rejected, Sites as Sites
from ._routes import Setting as Setting
from ._search import Regularity as Regularity, Shift as Shift
from ._trials import best_of_trials as best_of_trials
