from . import presets as presets
from ._amcl import (
    DIFFERENTIAL as DIFFERENTIAL,
    MODELS as MODELS,
    OMNIDIRECTIONAL as OMNIDIRECTIONAL,
    Amcl as Amcl,
    Filter as Filter,
    Tracker as Tracker,
)
from ._edits import (
    edited_files as edited_files,
    edited_parameters as edited_parameters,
)
from ._lidar import (
    MAX_BEAMS as MAX_BEAMS,
    PRESETS as PRESETS,
    Lidar as Lidar,
)
from ._nav2 import (
    NOT_SIMULATED as NOT_SIMULATED,
    ParameterWarning as ParameterWarning,
    nav2_inflation as nav2_inflation,
    read_amcl as read_amcl,
)
from ._parameter_files import (
    file_and_robot as file_and_robot,
    read_parameters as read_parameters,
)
from ._parameters import (
    GLOBAL_COSTMAP as GLOBAL_COSTMAP,
    LOCAL_COSTMAP as LOCAL_COSTMAP,
    PLANNER_SERVER as PLANNER_SERVER,
    Nav2Parameters as Nav2Parameters,
)
from ._particles import (
    beam_scores as beam_scores,
    compared_ends as compared_ends,
    filter_settings as filter_settings,
)
from ._parts import (
    FARTHEST_OBJECT as FARTHEST_OBJECT,
    NEAREST_OBJECT as NEAREST_OBJECT,
    Disturbances as Disturbances,
    Footprint as Footprint,
    Inflation as Inflation,
    Kinematics as Kinematics,
    Odometry as Odometry,
)
from ._planner_drive import planner_types as planner_types
from ._robot import (
    Robot as Robot,
    format_radius as format_radius,
    list_settings as list_settings,
    radius_of as radius_of,
)
