from ._objects import (
    Box as Box,
    LandmarkObject as LandmarkObject,
    Pole as Pole,
    with_objects as with_objects,
)
