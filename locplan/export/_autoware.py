"""Degenerate areas as Autoware reads them: polygons of a Lanelet2 map, and their covariances.

The node environment_adaptor takes the polygons of type degenerate_area from the vector map, finds
an environment by their subtype, and puts its covariance in place of that of the pose. Read from
tier4/autoware_universe, localization/autoware_environment_adaptor/src/environment_classifier.cpp,
environment_adaptor.cpp and covariance_utils.hpp, and autowarefoundation/autoware_launch,
autoware_launch/config/localization/environment_adaptor.param.yaml. The node is proposed for
autowarefoundation/autoware_universe (pull request 12935), and in no release of it.

Its guide writes the areas as relations; but Lanelet2's reader makes polygons of ways with area=yes
alone (fzi-forschungszentrum-informatik/Lanelet2, lanelet2_io/src/OsmHandlerLoad.cpp, loadWays).
The map loader takes local_x and local_y for projector_type local (autowarefoundation/autoware_core,
map/autoware_map_loader/src/lanelet2_map_loader/lanelet2_map_loader.cpp). All was read, not run.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from locplan.export._areas import DegenerateArea

AGREES = 0.5
"""Agreement from which an area counts as uncertain along one line, which robots drive along."""
FIRST_ENVIRONMENT = 101
"""Id of the first area's environment; lower ones are left to those who tune them by hand."""
_DEGREE = 111_319.49
"""Metres of a degree at the equator, where editors show what has no place on Earth."""
_HEIGHT, _TILT = 0.0225, 0.000625
"""Variances of z [m^2] and of roll and pitch [rad^2] in Autoware's own file: a 2D map has none."""


def subtype_of(area: DegenerateArea) -> str:
    """The area's name as a part of a parameter's name."""
    return area.name.replace("-", "_")


def lanelet2_of(areas: Sequence[DegenerateArea]) -> str:
    """The areas as a Lanelet2 map (OSM), whose ids are negative: those of new objects."""
    ids = count(-1, -1)
    nodes, ways = [], []
    for area in areas:
        corners = []
        for x, y in without_holes(area.outline, area.holes).tolist():
            node = next(ids)
            corners.append(node)
            nodes += [
                f'  <node id="{node}" action="modify" visible="true"'
                f' lat="{y / _DEGREE:.11f}" lon="{x / _DEGREE:.11f}">',
                f'    <tag k="local_x" v="{x:.4f}"/>',
                f'    <tag k="local_y" v="{y:.4f}"/>',
                '    <tag k="ele" v="0"/>',
                "  </node>",
            ]
        tags = {"type": "degenerate_area", "subtype": subtype_of(area), "area": "yes"}
        tags["name"] = area.name
        ways.append(f'  <way id="{next(ids)}" action="modify" visible="true">')
        ways += [f'    <nd ref="{node}"/>' for node in corners]
        ways += [f"    <tag k={quoteattr(k)} v={quoteattr(v)}/>" for k, v in tags.items()]
        ways.append("  </way>")
    head = ['<?xml version="1.0" encoding="UTF-8"?>', '<osm version="0.6" generator="locplan">']
    head.append('  <MetaInfo format_version="1" map_version="1"/>')
    return "\n".join([*head, *nodes, *ways, "</osm>"]) + "\n"


def parameters_of(areas: Sequence[DegenerateArea]) -> str:
    """The parameters (YAML) that give each area's poses its covariance."""
    lines = ["/**:", "  ros__parameters:", "    default_environment_id: 0"]
    for number, area in enumerate(areas, start=FIRST_ENVIRONMENT):
        lines += [f"    area_subtype_{subtype_of(area)}:", f"      environment_id: {number}"]
    for number, area in enumerate(areas, start=FIRST_ENVIRONMENT):
        rows = [", ".join(f"{value:.6f}" for value in row) for row in body_covariance(area)]
        name = f"environment_{number}_output_pose_covariance"
        lines += [f"    {name}:  # {area.name}", "      [" + ",\n       ".join(rows) + "]"]
    return "\n".join(lines) + "\n"


def body_covariance(area: DegenerateArea) -> NDArray[np.float64]:
    """Covariance of x, y, z, roll, pitch, yaw in the robot's own frame, (6, 6) [m^2, rad^2].

    It is the median over the area. Where its places are uncertain along one line, the robot
    drives along it: x is forward. Elsewhere both axes have the larger variance.
    """
    along = area.position_std**2
    across = area.minor_position_std**2 if area.agreement >= AGREES else along
    turn = _TILT if np.isnan(area.heading_std) else area.heading_std**2
    return np.diag([along, across, _HEIGHT, _TILT, _TILT, turn])


def without_holes(
    outline: NDArray[np.float64], holes: Sequence[NDArray[np.float64]]
) -> NDArray[np.float64]:
    """One ring around an area without its holes, (n, 2): Lanelet2's polygons have none.

    A cut leads to each hole and back, from its leftmost corner straight to the left, where the
    outline lies or a hole that has been joined before.
    """
    ring = outline
    for hole in sorted(holes, key=lambda hole: float(hole[:, 0].min())):
        first = np.lexsort((hole[:, 1], hole[:, 0]))[0]
        hole = np.roll(hole, -int(first), axis=0)
        x, y = hole[0]
        start, end = ring, np.roll(ring, -1, axis=0)
        crosses = (start[:, 1] <= y) != (end[:, 1] <= y)
        rise = np.where(crosses, end[:, 1] - start[:, 1], 1.0)
        hit = start[:, 0] + (y - start[:, 1]) / rise * (end[:, 0] - start[:, 0])
        hit = np.where(crosses & (hit < x), hit, -np.inf)
        line = int(np.argmax(hit))
        cut = np.array([[hit[line], y]])
        ring = np.concatenate([ring[: line + 1], cut, hole, hole[:1], cut, ring[line + 1 :]])
    return ring
