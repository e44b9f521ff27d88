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
    """Distance of nodes of the graph that are joined, in metres; 2 by default. Free space sees one
    within two of these."""
    stations: Path | None = None
    """CSV file of stations (name,x,y), each of which gets a node."""
    vehicle: str = "locplan.robot"
    """Type of vehicle, locplan.robot by default; fleet managers know it as
    MANUFACTURER.SERIES."""
    speed: float | None = None
    """Speed by which J is divided for the travel times of edges, in m/s, which get such a maxSpeed;
    by default they have none."""

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
