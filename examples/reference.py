"""Generate the reference pages from the code: commands, files, formats, settings, planners, lidars.

Run: python examples/reference.py [FOLDER [BENCHMARKS.json]]

Writes a Markdown page each. BENCHMARKS.json is the file of tests/benchmarks/table.py.
"""

from __future__ import annotations

import dataclasses
import json
import os
import re
import subprocess
import sys
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from importlib.metadata import PackageNotFoundError, metadata, requires
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import locplan
from locplan._support import runs
from locplan._support.output import ResultFiles
from locplan._support.public import read_field_docs
from locplan._support.records import Result
from locplan._support.runs import FILE_RUN_SUFFIX, RUN_FILE
from locplan._support.saved import StoredResult
from locplan.advice import Check, Tuning
from locplan.advice.landmarks import Landmarks
from locplan.advice.map_repair import RepairedMap
from locplan.app.cli.application import COMMANDS, EXIT_CODES, read_summary
from locplan.app.explorer import sharing
from locplan.comparison import journal
from locplan.comparison.result import Comparison
from locplan.export import batch
from locplan.export.registry import METADATA_FILE, METADATA_VERSION, NAV2_FILES, list_formats
from locplan.field import config as field_config, files as field_files
from locplan.planning import PLANNERS
from locplan.recordings import RecordingReport, Replay, files as recording_files
from locplan.recordings.location import LocatedDrive
from locplan.robots import LIDARS, files as robot_files
from locplan.robots.robot import list_settings
from locplan.simulation import Simulation
from locplan.simulation.query_routes import RoutesOnMaps

WIDTH = 500
"""Width of the help [characters], so that each option has one line."""
RESULTS: dict[str, dict[str, ResultFiles]] = {
    "check": {"": Check.files},
    "plan": {"": locplan.Recommendation.files, "--front": locplan.ParetoFront.files},
    "compare": {"": Comparison.files},
    "tune": {"": Tuning.files},
    "simulate": {
        "": Simulation.files,
        "--random": RoutesOnMaps.files,
        "--recording": Replay.files,
    },
    "recording": {"": RecordingReport.files},
    "locate": {"": LocatedDrive.files},
    "repair": {"": RepairedMap.files},
    "landmarks": {"": Landmarks.files},
}
"""Files of the results of each command, by the words that ask for them."""
COMMON_PURPOSES = {
    "servers.yaml": "parameters of the map server, for Nav2",
    "localizability.launch.xml": "starts the map server",
    "amcl.yaml": "the line that names the repaired map in AMCL's parameters",
    "errors.csv": "the errors along the paths",
    ".json": "the result in numbers",
    ".png": "the picture",
    ".pgm": "the image of the map",
}
"""Purpose of files that results do not explain, by name or suffix."""
FILE_FORMATS = {
    ".csv": "a table with one line of names. `NAME_low` and `NAME_high` are the 95 % interval of"
    " NAME. Unknown values are empty",
    ".json": "the result in numbers. Unknown values are null",
    ".npz": "arrays for Python; locplan loads them again",
    ".yaml": "a map, parameters of Nav2, or a robot, as ROS reads them",
    ".pgm": "the image of a map, as ROS's map_server reads it",
    ".geojson": "polygons or a route graph in the map's frame, in metres",
    ".tum": "poses as evo reads them: time, position, quaternion",
    ".png": "a picture",
    ".html": "a report in one file, without a server",
}
"""What a file contains, by its suffix."""


def make_pages(benchmarks: Path | None = None) -> dict[str, str]:
    """Return the text of each page by its name."""
    pages = {
        "files": make_files_page(),
        "formats": make_formats_page(),
        "settings": make_settings_page(),
        "planners": make_planners_page(),
        "lidars": make_lidars_page(),
        "dependencies": make_dependencies_page(),
        "benchmarks": make_benchmarks_page(benchmarks),
    }
    pages |= {f"commands/{name}": make_command_page(name) for name in COMMANDS}
    pages["commands"] = make_commands_page()
    return pages


def make_commands_page() -> str:
    """Return the page of all commands, with their summaries and the exit codes."""
    rows = [
        (f"[{name}](commands/{name}.md)", group, read_summary(name))
        for name, group in COMMANDS.items()
    ]
    codes = [(str(code), meaning) for code, meaning in EXIT_CODES.items()]
    return (
        "# Commands\n\n"
        "`locplan COMMAND --help` prints the text of each page.\n\n"
        f"{make_table(('command', 'group', 'purpose'), rows)}\n"
        "## Exit codes\n\n"
        "A missing path is a result, so `plan` exits with 0.\n\n"
        f"{make_table(('code', 'meaning'), codes)}"
    )


def make_command_page(name: str) -> str:
    """Return the page of a command: its help and its files."""
    environment = {**os.environ, "COLUMNS": str(WIDTH), "NO_COLOR": "1", "TERM": "dumb"}
    done = subprocess.run(
        [sys.executable, "-m", "locplan", name, "--help"],
        env=environment,
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=True,
    )
    text = f"# locplan {name}\n\n{convert_help(done.stdout)}"
    if name in RESULTS:
        text += f"## Files\n\n{make_files_sections(name, '###')}"
    return text


def convert_help(text: str) -> str:
    """Return the help of a command as Markdown: its boxes become tables."""
    usage, *paragraphs = text.split("╭", 1)[0].strip().split("\n\n")
    parts, examples, words = [], "", ""
    for paragraph in paragraphs:
        title, _, content = paragraph.partition("\n")
        if title.strip() == "Examples":
            lines = "\n".join(line.rstrip() for line in content.splitlines())
            examples = f"```sh\n{textwrap.dedent(lines)}\n```"
        elif title.strip() == "Words":
            pairs = [line.split(maxsplit=1) for line in content.splitlines()]
            words = make_table(("word", "meaning"), [(f"`{word}`", use) for word, use in pairs])
        else:
            parts.append(" ".join(paragraph.split()))
    parts += [examples, words, f"## Usage\n\n```text\n{usage.removeprefix('Usage: ')}\n```"]
    for title, content in re.findall(r"╭─ (.+?) ─+╮\n(.*?)╰", text, re.DOTALL):
        lines = re.findall(r"^│ (?:\* )? *(\S.*?) {2,}(\S.*?) *│", content, re.MULTILINE)
        rows = [(f"`{name}`", meaning) for name, meaning in lines]
        parts.append(f"## {title}\n\n{make_table(('name', 'meaning'), rows)}")
    return "\n\n".join(filter(None, parts)) + "\n"


def make_files_page() -> str:
    """Return the page of the files of all commands."""
    parts = [
        "# Files\n",
        f"With `--output FOLDER`, a command writes these files. `{RUN_FILE}` in the folder records"
        " the command, its settings, the version and the digest of each file. Next to a single"
        f" file, it is named `NAME{FILE_RUN_SUFFIX}`.\n",
        "Lengths are in metres, angles in radians, in the map's frame.\n",
        make_table(("suffix", "content"), [(f"`{s}`", text) for s, text in FILE_FORMATS.items()]),
    ]
    for name in RESULTS:
        parts += [f"## locplan {name}\n", make_files_sections(name, "###")]
    rows = [(file, str(version), reads) for file, version, reads in list_versions()]
    parts += [
        "## Versions\n",
        "Each file holds the version of locplan that wrote it, its kind, and the version of its"
        " content. This version of locplan writes and reads the following. A newer file ends with"
        " one line that asks for an update.\n",
        make_table(("file", "writes", "reads"), rows),
        "## locplan field\n",
        make_table(("file", "purpose"), list_purposes(batch.PURPOSES)),
        "## locplan export\n",
        "See [export formats](formats.md).\n",
    ]
    return "\n".join(parts)


def list_versions() -> list[tuple[str, int, str]]:
    """Return each file that locplan writes, the version of its content, and those that it reads."""
    results = [files.kind for by_words in RESULTS.values() for files in by_words.values()]
    stored = {kind.kind: kind for kind in find_subclasses(StoredResult) if "kind" in vars(kind)}
    return [
        *(
            (f"{name}, `{kind.kind}{kind.suffix}`", kind.version, f"up to {kind.version}")
            for name, kind in sorted(stored.items())
        ),
        ("field, `NAME.npz`", field_files.VERSION, f"up to {field_files.VERSION}"),
        ("settings, `NAME.json`", field_config.VERSION, f"up to {field_config.VERSION}, or none"),
        (
            "recording, `NAME.npz`",
            recording_files.VERSION,
            f"up to {recording_files.VERSION}, or none",
        ),
        ("robot, `NAME.yaml`", robot_files.VERSION, f"up to {robot_files.VERSION}, or none"),
        (f"run, `{RUN_FILE}`", runs.VERSION, f"up to {runs.VERSION}"),
        ("journal of a comparison, `NAME.jsonl`", journal.VERSION, f"{journal.VERSION}"),
        (f"export, `{METADATA_FILE}`", METADATA_VERSION, "not read"),
        ("page of the explorer, `NAME.html`", sharing.VERSION, "not read"),
        *(
            (f"result, `{name}.json`", Result.version, "up to 1" if name == "check" else "not read")
            for name in sorted({*results} - stored.keys())
        ),
    ]


def find_subclasses(kind: type) -> Iterator[type[StoredResult]]:
    """Yield a class's subclasses, their subclasses, and so on."""
    for subclass in kind.__subclasses__():
        yield subclass
        yield from find_subclasses(subclass)


def make_files_sections(name: str, heading: str) -> str:
    """Return a table of files for each kind of results of a command."""
    parts = []
    for words, files in RESULTS[name].items():
        if words:
            option = f"`{words}`" if words.startswith("-") else words
            parts.append(f"{heading} With {option}\n")
        parts.append(make_table(("file", "purpose"), list_files(files)))
    return "\n".join(parts)


def list_files(files: ResultFiles) -> list[tuple[str, str]]:
    """Return the files of results with their purposes, the most useful first."""
    purposes = dict(files.purposes)
    for name in (*files.names, *files.unfinished):
        if name not in purposes:
            purposes[name] = COMMON_PURPOSES.get(name) or COMMON_PURPOSES[Path(name).suffix]
    return list_purposes(purposes)


def list_purposes(purposes: dict[str, str]) -> list[tuple[str, str]]:
    """Return the rows of a table of files."""
    return [(f"`{name}`", purpose) for name, purpose in purposes.items()]


def make_formats_page() -> str:
    """Return the page of the export formats with their options."""
    parts = ["# Export formats\n", "`locplan export MAP --to FORMAT` writes one of these.\n"]
    for name, export_format in list_formats().items():
        paths = {"none": "no path", "one": "one path", "several": "paths"}[export_format.paths]
        suffixes = ", ".join(f"`{suffix}`" for suffix in export_format.suffixes)
        target = f"a file ({suffixes})" if suffixes else "a folder"
        parts += [
            f"## {name}\n",
            f"Writes {export_format.description.partition(';')[0]}, into {target}. It takes"
            f" {paths}.\n",
        ]
        docs = read_field_docs(export_format.options)
        rows = [
            (f"`--{field.metadata['flag'] or field.name.replace('_', '-')}`", default, docs[name])
            for field in dataclasses.fields(export_format.options)
            if "is_option" in field.metadata
            for name, default in [(field.name, format_value(field.default))]
        ]
        if rows:
            parts.append(make_table(("option", "default", "meaning"), rows))
    names = [*list_purposes(NAV2_FILES), (f"`{METADATA_FILE}`", "the input of the export")]
    parts += [
        "## Files for Nav2\n",
        "A folder holds the files that its format needs.\n",
        make_table(("file", "purpose"), names),
    ]
    return "\n".join(parts)


def make_settings_page() -> str:
    """Return the page of the settings of a robot."""
    table = list_settings(locplan.Robot())
    parts = [
        "# Robot settings\n",
        "`--set NAME=VALUE` changes a setting, such as `--set range=8`. In Python,"
        " `Robot.with_settings` does. The defaults of the lidar come from `--lidar`. Values in"
        " `--robot` files replace all defaults.\n",
    ]
    for part in dict.fromkeys(row[0] for row in table.rows):
        rows = [
            (f"`{name}`", unit, "" if value == "-" else value, meaning)
            for row_part, name, unit, value, meaning in table.rows
            if row_part == part
        ]
        parts += [
            f"## {part.capitalize()}\n",
            make_table(("setting", "unit", "default", "meaning"), rows),
        ]
    return "\n".join(parts)


def make_planners_page() -> str:
    """Return the page of the planners with their options."""
    rows = [
        (f"`{name}`", entry.minimises or "nothing, any path", ", ".join(entry.spaces))
        for name, entry in PLANNERS.items()
    ]
    parts = [
        "# Planners\n",
        "`--planner NAME:option=value` and `locplan.plan(..., planner=NAME)` take these names.\n",
        make_table(("planner", "minimises", "spaces"), rows),
    ]
    kinds = dict.fromkeys(entry.kind for entry in PLANNERS.values())
    for kind in kinds:
        entries = {name: entry for name, entry in PLANNERS.items() if entry.kind is kind}
        docs = read_field_docs(kind)
        entry = next(iter(entries.values()))
        defaults = entry.options()
        options = [
            (f"`{option}`", format_value(defaults[option]), docs.get(option, ""))
            for option in entry.typed_options()
        ]
        parts += [
            f"## Options of {', '.join(entries)}\n",
            make_table(("option", "default", "meaning"), options),
        ]
    parts.append("OMPL's planners also take OMPL's settings, such as `range`.\n")
    return "\n".join(parts)


def make_lidars_page() -> str:
    """Return the page of the built-in lidars."""
    heads = ("lidar", "range [m]", "from [m]", "view [deg]", "beams", "error [m]", "source")
    rows = [
        (f"`{name}`", *(format_value(value) for value in sheet)) for name, sheet in LIDARS.items()
    ]
    return (
        "# Lidars\n\n`--lidar NAME` and `locplan.Robot(NAME)` take these names. The values come"
        f" from data sheets.\n\n{make_table(heads, rows)}"
    )


def make_dependencies_page() -> str:
    """Return the page of the libraries that locplan and its extras install, with their licences."""
    rows = [(f"`{name}`", licence) for name, licence in sorted(list_licences().items())]
    return (
        "# Dependencies\n\nlocplan, its extras and their dependencies install these libraries. All"
        " licences allow use in a project under Apache-2.0.\n\n"
        f"{make_table(('library', 'licence'), rows)}"
    )


def list_licences() -> dict[str, str]:
    """Return the licence of each installed library that locplan's users install, by its name."""
    licences: dict[str, str] = {}
    waiting = [
        (requirement, marker_extra)
        for text in requires("locplan") or ()
        for requirement in [Requirement(text)]
        for marker_extra in ("", *(metadata("locplan").get_all("Provides-Extra") or ()))
        if marker_extra not in ("docs", "test")
    ]
    while waiting:
        requirement, extra = waiting.pop()
        name = canonicalize_name(requirement.name)
        is_needed = requirement.marker is None or requirement.marker.evaluate({"extra": extra})
        if name in ("locplan", *licences) or not is_needed:
            continue
        try:
            licences[name] = read_licence(name)
        except PackageNotFoundError:
            continue  # an extra that is not installed
        for text in requires(name) or ():
            waiting += [(Requirement(text), word) for word in ("", *requirement.extras)]
    return licences


def read_licence(name: str) -> str:
    """Return the licence that an installed library states."""
    facts = metadata(name)
    classifiers = facts.get_all("Classifier") or ()
    names = [text.rpartition(" :: ")[2] for text in classifiers if text.startswith("License ::")]
    stated = facts.get("License-Expression") or ", ".join(names)
    return str(stated or facts.get("License"))


def make_benchmarks_page(file: Path | None) -> str:
    """Return the page of a file of benchmarks, or of the command that makes one."""
    command = "python tests/benchmarks/table.py FOLDER"
    intro = f"# Benchmarks\n\n`{command}` runs all benchmarks and writes `benchmarks.json`.\n\n"
    if file is None:
        return intro + (
            "This site was built without that file. Pass it with `--benchmarks`:\n\n"
            f"```sh\n{command}\n"
            "python examples/site.py site --benchmarks FOLDER/benchmarks.json\n```\n"
        )
    content = json.loads(file.read_text("utf-8"))
    heads = ("benchmark", "seconds", "peer", "ratio", "limit", "share", "figures")
    rows = [tuple(format_value(value) for value in row.values()) for row in content["rows"]]
    machine = [(name, str(value)) for name, value in content["machine"].items()]
    return (
        f"{intro}A ratio is the peer's time divided by locplan's. A share is 1 at the limit."
        f" Larger is better.\n\n{make_table(heads, rows)}\n"
        f"## Machine\n\n{make_table(('', 'value'), machine)}"
    )


def make_table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table of Markdown."""
    lines = [heads, ["---"] * len(heads), *rows]
    cells = [[" ".join(cell.split()).replace("|", r"\|") for cell in line] for line in lines]
    return "".join(f"| {' | '.join(line)} |\n" for line in cells)


def format_value(value: object) -> str:
    """Return a value for a table; empty for none."""
    if value is None or value == "":
        return ""
    if isinstance(value, bool):
        return "on" if value else "off"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def main(folder: str = "reference", benchmarks: str | None = None) -> None:
    """Write all pages into a folder."""
    for name, text in make_pages(Path(benchmarks) if benchmarks else None).items():
        file = Path(folder) / f"{name}.md"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, "utf-8")
        print(f"wrote {file}")


if __name__ == "__main__":
    main(*sys.argv[1:])
