import ast
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parent.parent / "locplan"
FLOORS = (
    {"errors", "_kernels.simd", "_kernels.search", "_kernels.rays"},
    {"_kernels.bitplanes", "_kernels.any_angle", "_kernels.pareto", "_kernels.curves"},
    {"_kernels.templates", "_kernels.arcs", "_kernels.lidar", "_kernels.likelihood"},
    {"_kernels.measured", "_kernels.particles"},
    {
        "_kernels.drives",
        "_kernels.motions",
        "_kernels.information",
        "_kernels.offsets",
        "_kernels.route",
    },
    {"_kernels.posterior"},
    {"_kernels.matches"},
    {"estimators", "intervals", "sensor"},
    {"_kernels.sad", "files", "progress", "covariance", "grid", "path", "config"},
    {"search_window", "lattice", "map_files", "drawing", "surfaces", "tables", "template"},
    {"config_files"},
    {"template_matching", "environments"},
    {"estimators.scene"},
    {"estimators.sad", "estimators.fisher", "estimators.scan"},
    {"tiles"},
    {"field_files"},
    {"field", "cache"},
    {"store", "blindness", "cluster", "samples"},
    {"costmap"},
    {"metrics", "footprint", "about"},
    {"planners.result", "planners.motions"},
    {"planners.grid", "planners.kinds"},
    {"planners.any_angle", "planners.cost_to_go", "planners.trade_offs"},
    {"planners.budget", "planners.pareto"},
    {
        "planners.limits",
        "planners.sampling.logs",
        "planners.sampling.settings",
        "planners.sampling.setup",
        "planners.sampling.stopping",
    },
    {"planners.sampling.leading", "planners.sampling.roadmap"},
    {"planners.sampling.solver"},
    {"planners.sampling"},
    {"planners"},
    {"captions", "paper", "comparison.runs", "comparison.queries", "comparison.specs"},
    {"comparison.movingai", "comparison.journal", "comparison.shelf", "comparison.frames"},
    {"comparison.statistics", "comparison.worker"},
    {"comparison.pairs", "comparison.convergence", "comparison.workers", "comparison.report.data"},
    {"comparison.engine", "comparison.ompl_log", "comparison.cases", "comparison.verdicts"},
    {"simulation.drives", "simulation.ranking", "simulation.settings"},
    {"simulation.arguments", "simulation.motion", "simulation.predictors"},
    {"simulation.simulator"},
    {"simulation.places", "simulation.routes"},
    {"simulation.calibration", "simulation.evaluation"},
    {"plotting.maps"},
    {"plotting.exports", "plotting.fields", "plotting.plans", "plotting.matching"},
    {"plotting.simulations"},
    {"plotting"},
    {"simulation.reports"},
    {"plotting.comparisons"},
    {"comparison.report.html"},
    {"comparison.report.marks"},
    {"comparison.report.pictures", "comparison.report.tables"},
    {"comparison.report"},
    {"comparison.result"},
    {"comparison.comparing"},
    {"comparison"},
    {"export.cdr", "export.folders", "export.servers", "export.travel_costs", "export.value_maps"},
    {"export.messages", "export.parameters", "export.plain_files", "export.roadmap"},
    {"export.ros_maps"},
    {"export.bags", "export.geojson", "export.nav2"},
    {"export"},
    {"simulation", "simulation.nav2_files"},
    {"reporting"},
    {"batch"},
    {"cli.options"},
    {"cli.simulated"},
    {
        "cli.compare",
        "cli.exports",
        "cli.fields",
        "cli.figures",
        "cli.plans",
        "cli.simulations",
        "cli.evidence",
    },
    {"cli"},
)
FLOOR_OF = {name: number for number, floor in enumerate(FLOORS) for name in floor}
ONLY_IN = {
    "matplotlib": {
        f"plotting.{name}"
        for name in ("comparisons", "exports", "fields", "maps", "matching", "plans", "simulations")
    },
    "ompl": {
        f"planners.sampling.{name}"
        for name in ("leading", "logs", "roadmap", "settings", "setup", "solver")
    },
    "yaml": {"map_files", "export.parameters", "export.servers", "export.value_maps"},
    "mcap": {"export.bags"},
    "cloudpickle": {"comparison.specs", "comparison.workers"},
    "pandas": {"comparison.frames"},
    "typer": {
        f"cli.{name}"
        for name in (
            "compare",
            "evidence",
            "exports",
            "fields",
            "figures",
            "options",
            "plans",
            "simulated",
            "simulations",
        )
    }
    | {"cli"},
    "zarr": {"field_files"},
    "filelock": {"cache", "store"},
    "distributed": {"cluster"},
}


def modules() -> dict[str, Path]:
    result = {}
    for path in PACKAGE.rglob("*.py"):
        name = ".".join(path.relative_to(PACKAGE).with_suffix("").parts)
        name = name.removesuffix(".__init__")
        if name not in ("__init__", "_kernels"):
            result[name] = path
    return result


def imported(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def test_every_module_has_a_floor():
    assert set(modules()) == set(FLOOR_OF)


@pytest.mark.parametrize("name", sorted(FLOOR_OF))
def test_modules_import_from_lower_floors_only(name):
    own = {i.removeprefix("locplan.") for i in imported(modules()[name]) if "locplan." in i}
    for other in (own & set(FLOOR_OF)) - {name}:
        assert FLOOR_OF[other] < FLOOR_OF[name], f"{name} imports {other}"


@pytest.mark.parametrize("library", sorted(ONLY_IN))
def test_some_libraries_have_one_home(library):
    for name, path in modules().items():
        if name not in ONLY_IN[library]:
            assert not any(i.split(".")[0] == library for i in imported(path)), name


def test_modules_stay_readable():
    for path in modules().values():
        assert len(path.read_text().splitlines()) <= 350, path.name


def test_the_command_line_starts_without_the_heavy_libraries():
    code = (
        "import sys, locplan.cli;"
        "heavy = {'numpy', 'numba', 'matplotlib', 'cv2', 'ompl', 'scipy'};"
        "print(sorted(heavy & set(sys.modules)))"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.stdout.strip() == "[]"
