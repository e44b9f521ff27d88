"""Route graphs for fleet managers."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from locplan._util.checks import number, positive
from locplan.errors import ConfigError
from locplan.export._registry import ExportJob, ExportSummary, Format


@dataclass(frozen=True, kw_only=True)
class LifOptions:
    """The options of a layout."""

    spacing: float = 2.0
    """Free space sees a node of the graph within two of these [m], and places that far apart are
    joined; 2 by default."""
    stations: Path | None = None
    """Stations of the layout are read from this CSV file (name,x,y); each gets a node."""
    vehicle: str = "locplan.robot"
    """The type of vehicle is locplan.robot by default; fleet managers know it as
    MANUFACTURER.SERIES."""
    speed: float | None = None
    """Edges get such a maxSpeed that their travel times are J divided by this speed [m/s]; by
    default they have none."""

    def __post_init__(self) -> None:
        from locplan.planners import read_stations

        number("spacing", self.spacing, 0.1)
        if not self.vehicle:
            raise ConfigError("vehicle must be a name, such as MANUFACTURER.SERIES")
        if self.speed is not None:
            positive("speed", self.speed, "metres a second")
        if self.stations is not None:
            read_stations(self.stations)


def write_lif(target: Path, job: ExportJob, options: LifOptions) -> ExportSummary:
    """Write lanes and stations as a layout."""
    from locplan.export._lif import lif
    from locplan.planners import read_stations

    stations = read_stations(options.stations) if options.stations else []
    graph = lif(
        target,
        job.costs,
        spacing=options.spacing,
        stations=stations,
        vehicle=options.vehicle,
        speed=options.speed,
    )
    nodes, edges, parts = len(graph.nodes), len(graph.edges), graph.components
    return ExportSummary(
        {"nodes": nodes, "edges": edges, "components": parts, "stations": len(stations)},
        (
            ("nodes, edges", f"{nodes:,}, {edges:,} each way"),
            ("stations", f"{len(stations):,}"),
            ("parts not joined", f"{parts:,}"),
        ),
    )


FORMATS = (
    Format(
        "lif",
        "a VDMA LIF layout for fleet managers",
        write_lif,
        LifOptions,
        suffixes=(".json",),
    ),
)
