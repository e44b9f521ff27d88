"""GeoJSON in metres of a map's frame: what all files of polygons, lines and points share."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from locplan._util.files import replacing
from locplan._util.tables import finite


def feature(
    kind: Literal["Point", "LineString", "Polygon"],
    coordinates: Any,
    about: Mapping[str, Any],
    **more: Any,
) -> dict[str, Any]:
    """A feature with its properties; null is what is not known."""
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", **more, "properties": finite(dict(about)), "geometry": geometry}


def closed(*rings: ArrayLike) -> list[list[list[float]]]:
    """Coordinates of a polygon of rings (n, 2) [m], to a tenth of a millimetre."""
    corners = (np.asarray(ring).round(4).tolist() for ring in rings)
    return [[*ring, ring[0]] for ring in corners]


def collection(name: str, features: Iterable[dict[str, Any]], **more: Any) -> dict[str, Any]:
    """A collection of features."""
    return {"type": "FeatureCollection", "name": name, **more, "features": [*features]}


def write_geojson(file: Path, found: Mapping[str, Any], *, indent: int | None = None) -> None:
    """Write a collection, as a whole or not at all."""
    text = json.dumps(found, allow_nan=False, indent=indent)
    with replacing(file) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")
