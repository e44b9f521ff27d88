"""The robot: its lidar, footprint, kinematics, filter and odometry, and their files."""

from locplan.robots.amcl import Amcl, Filter
from locplan.robots.lidar import LIDARS, Lidar
from locplan.robots.parameters import read_parameters
from locplan.robots.parts import Disturbances, Footprint, Kinematics, Odometry
from locplan.robots.presets import PRECISE, SAFE, with_preset
from locplan.robots.robot import Robot, planning_radius

__all__ = [
    "LIDARS",
    "PRECISE",
    "SAFE",
    "Amcl",
    "Disturbances",
    "Filter",
    "Footprint",
    "Kinematics",
    "Lidar",
    "Odometry",
    "Robot",
    "planning_radius",
    "read_parameters",
    "with_preset",
]
