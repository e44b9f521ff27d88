"""A robot and stations for quick checks of `maps.furnished_room`."""

from __future__ import annotations

from locplan import Lidar, Robot

TUNED_FILTER = {
    **{f"alpha{n}": 0.05 for n in range(1, 6)},
    "laser_model_type": "likelihood_field_prob",
}


LIDAR = Lidar(range=6.0, beams=120)


FEW_PARTICLES = {"min_particles": 200, "max_particles": 400}


ROBOT = Robot(LIDAR).with_settings({**TUNED_FILTER, **FEW_PARTICLES})


CORNERS = {"door": (1.0, 1.0), "desk": (7.0, 1.0), "shelf": (1.0, 5.0)}
