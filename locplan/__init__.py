"""Plan paths along which a robot with a 2D lidar can still localize itself.

>>> import locplan
>>> grid = locplan.maps.environments.make("two_corridors", resolution=0.1)
>>> robot = locplan.Robot("turtlebot3")
>>> field = locplan.covariance_field(grid, locplan.Fused(robot.lidar))
>>> costs = locplan.Costmap.from_field(field, robot=robot)
>>> plan = locplan.plan(costs, start=(2.0, 3.0), goal=(38.0, 3.0))
>>> plan.status
'solved'
"""

import logging

from locplan._support.public import attach_lazy_names

__version__ = "0.2.0.dev0"
logging.getLogger("locplan").addHandler(logging.NullHandler())  # the application adds another
__getattr__, __dir__, __all__ = attach_lazy_names(__name__, __file__)
