from ._amcl import (
    DIFFERENTIAL as DIFFERENTIAL,
    MODELS as MODELS,
    OMNIDIRECTIONAL as OMNIDIRECTIONAL,
    Amcl as Amcl,
)
from ._disturbances import (
    FARTHEST_OBJECT as FARTHEST_OBJECT,
    NEAREST_OBJECT as NEAREST_OBJECT,
    Disturbances as Disturbances,
    Odometry as Odometry,
)
from ._footprint import Footprint as Footprint
from ._kinematics import Inflation as Inflation, Kinematics as Kinematics
from ._lidar import MAX_BEAMS as MAX_BEAMS, Lidar as Lidar
from ._lidar_presets import PRESETS as PRESETS, Preset as Preset
from ._nav2 import ParameterWarning as ParameterWarning, read_amcl as read_amcl
from ._parameter_edits import edited_parameters as edited_parameters
from ._parameters import (
    GLOBAL_COSTMAP as GLOBAL_COSTMAP,
    LOCAL_COSTMAP as LOCAL_COSTMAP,
    PLANNER_SERVER as PLANNER_SERVER,
    Nav2Parameters as Nav2Parameters,
    file_and_robot as file_and_robot,
    read_parameters as read_parameters,
)
from ._robot import Robot as Robot
