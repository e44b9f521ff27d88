"""Every picture that locplan draws, on a map of yours, with the command below each.

Run: python examples/gallery.py [FOLDER [MAP.yaml [LIDAR [WORD ...]]]]

With words, only the entries whose command or picture has one of them are drawn.
"""

from __future__ import annotations

import shlex
import subprocess
import sys
from dataclasses import dataclass
from functools import partial
from html import escape
from pathlib import Path

import locplan
from locplan.planning import describe_map

EXAMPLES = Path(__file__).resolve().parent
PROJECT = EXAMPLES.parent
MAP = PROJECT / "maps" / "two_corridors.yaml"
DRIVE = PROJECT / "tests" / "data" / "small_drive.npz"
DRIVEN = PROJECT / "maps" / "office.yaml"
"""A recorded drive, and its map."""
QUERY_OF_OUR_MAP = (2.0, 3.0), (38.0, 3.0)


@dataclass(frozen=True)
class Entry:
    """A picture of the gallery."""

    title: str
    see: str
    """What to look at."""
    command: str
    """Command that draws it, with {map}, {lidar}, {start}, {goal} and {middle}.

    For recorded drives there are {drive} and its map, {driven}; {examples} is this file's folder.
    """
    picture: str
    """File that the command writes, relative to the gallery's folder, with {name} of the map."""


QUERY = "--start {start} --goal {goal} --lidar {lidar}"
COSTS = """
import sys, locplan
grid = locplan.load_map(sys.argv[1])
field = locplan.load_or_compute(grid, locplan.Fused(locplan.Lidar.preset('{lidar}')))
costs = locplan.Costmap.from_field(field, robot=0.25)
"""
"""Beginning of a program that draws with the library."""
ENTRIES = (
    Entry(
        "The map alone",
        "Walls are black, the inside of solid walls is grey, unknown space light grey.",
        """python -c "
import sys, locplan
locplan.load_map(sys.argv[1]).figure().savefig('map.png')
" {map}""",
        "map.png",
    ),
    Entry(
        "The map, and places for start and goal",
        "Numbered grid lines are world metres; S and G are places that a path joins.",
        "locplan info {map} -o info.png",
        "info.png",
    ),
    Entry(
        "Weak spots",
        "Dark places are where a scan match leaves the position open.",
        "locplan field {map} --lidar {lidar} -o position.png",
        "position.png",
    ),
    Entry(
        "Weak spots of the heading",
        "Round rooms and open space leave the heading open.",
        "locplan field {map} --lidar {lidar} --picture heading_std -o heading.png",
        "heading.png",
    ),
    Entry(
        "The paper's field",
        "The paper's e [m² rad] knows the range of the lidar only.",
        "locplan field {map} --picture e -o paper_e.png",
        "paper_e.png",
    ),
    Entry(
        "Look-alike offsets within the search window",
        "The probability that a match lies outside the central mode.",
        "locplan field {map} --lidar {lidar} --picture ambiguity -o ambiguity.png",
        "ambiguity.png",
    ),
    Entry(
        "The estimators where they differ",
        "What a disc of 6 m sees, and what a lidar of 30 m sees.",
        "python {examples}/estimators.py estimators {map}",
        "estimators/estimators.png",
    ),
    Entry(
        "The degeneracy that planners are charged",
        "Cells without colour are too near to a wall for the robot.",
        f"""python -c "{COSTS}
costs.figure().savefig('costmap.png')
" {{map}}""",
        "costmap.png",
    ),
    Entry(
        "One path over the degeneracy",
        "Notebooks show plans like this.",
        f"""python -c "{COSTS}
plan = locplan.plan(costs, ({{start}}), ({{goal}}))
plan.figure().savefig('path.png')
" {{map}}""",
        "path.png",
    ),
    Entry(
        "The shortest and the aware path",
        "The profile below shows where each path is degenerate.",
        f"locplan plan {{map}} {QUERY} --drives 0 -o plan",
        "plan/choice.png",
    ),
    Entry(
        "The best of a sampling-based planner over time",
        "Its J comes down towards any-angle's.",
        f"locplan plan {{map}} {QUERY} --planner BITstar:time_limit=2 --drives 0 -o sampled",
        "sampled/history.png",
    ),
    Entry(
        "Every trade-off between length and degenerate metres",
        "The knee is where a longer path begins to pay less.",
        f"locplan plan {{map}} {QUERY} --front -o front",
        "front/front.png",
    ),
    Entry(
        "The simulated choice",
        "The thick path is the one to take, the black one is the shortest.",
        f"locplan plan {{map}} {QUERY} -o chosen",
        "chosen/choice.png",
    ),
    Entry(
        "Drives of both paths",
        "The bands hold half and nine tenths of the drives.",
        f"locplan simulate {{map}} {QUERY} --drives 40 -o driven",
        "driven/simulation.png",
    ),
    Entry(
        "Random queries, driven",
        "Points below the diagonal gained by the aware path.",
        "locplan simulate {map} --random 6 --lidar {lidar} --drives 20 -o queries",
        "queries/01-{name}.png",
    ),
    Entry(
        "Settings of AMCL that hold",
        "The best preset is judged on paths that did not choose it.",
        "locplan tune {map} --lidar {lidar} -o tuned",
        "tuned/tuning.png",
    ),
    Entry(
        "Landmarks",
        "Numbered objects are placed where they help most; drives prove it.",
        "locplan landmarks {map} --start {start} --goal {goal} --lidar {lidar} --count 3 -o marked",
        "marked/landmarks.png",
    ),
    Entry(
        "Where a scan was taken",
        "Numbers are the likely places, best first.",
        "locplan locate {driven} --recording {drive} --scan 20 -o located",
        "located/located.png",
    ),
    Entry(
        "Where the scans of a drive were taken",
        "Each scan is located by itself, and compared with its recorded pose.",
        "locplan locate {driven} --recording {drive} --every 10 -o all_located",
        "all_located/located.png",
    ),
    Entry(
        "A mask for Nav2",
        "The costs that the planner is charged.",
        "locplan export {map} --to nav2-keepout --lidar {lidar} -o mask",
        "mask/preview.png",
    ),
    Entry(
        "Speed limits for Nav2",
        "The robot slows down where it is badly localized.",
        "locplan export {map} --to nav2-speed --lidar {lidar} -o speed",
        "speed/preview.png",
    ),
    Entry(
        "Routes for Nav2's route server",
        "The graph of given paths.",
        "locplan export {map} --to nav2-routes --start {start} --goal {goal} --lidar {lidar}"
        " -o ways",
        "ways/preview.png",
    ),
    Entry(
        "The degeneracy as a map for map servers",
        "Cells hold u in per cent.",
        "locplan export {map} --to ros-map --lidar {lidar} -o ros_map",
        "ros_map/preview.png",
    ),
    Entry(
        "A recorded drive, and where the robot was",
        "Crosses mark doubtful scans, circles mark jumps of odometry.",
        "locplan recording {drive} {driven} -o recorded",
        "recorded/recording.png",
    ),
    Entry(
        "A recorded drive, and where it is badly localized",
        "Where the narrow line is as dark as the wide one, the estimator is right.",
        "python {examples}/recorded_drive.py evaluated {driven} {drive}",
        "evaluated/drive.png",
    ),
    Entry(
        "AMCL, replayed on the recorded drive",
        "Blue lines beside the dashed one are where the filter was wrong.",
        "locplan simulate {driven} --recording {drive} --drives 5 -o replayed",
        "replayed/replay.png",
    ),
    Entry(
        "Settings of AMCL, judged on the recorded drive",
        "The best preset is judged on stretches that did not choose it.",
        "locplan tune {driven} --recording {drive} -o retuned",
        "retuned/tuning.png",
    ),
    Entry(
        "Planners compared",
        "The report says which is best, where and by how much.",
        "locplan compare {map} --random 4 --lidar {lidar} --planner grid --planner any-angle"
        " -o compared",
        "compared/report.html",
    ),
)


def main(
    folder: str = "gallery", map_file: str = str(MAP), lidar: str = "turtlebot4", *words: str
) -> None:
    """Run the commands in the folder, all or those with one of the words; write index.md."""
    target = Path(folder)
    target.mkdir(parents=True, exist_ok=True)
    places = _places(map_file)
    sections = []
    for entry in ENTRIES:
        if words and not any(word in f"{entry.command} {entry.picture}" for word in words):
            continue
        command = partial(entry.command.format, lidar=lidar, **places)
        picture = entry.picture.format(name=locplan.load_map(map_file).name)
        files = {"map": Path(map_file), "driven": DRIVEN, "drive": DRIVE, "examples": EXAMPLES}
        whole = {name: _quote(file, str(file.resolve())) for name, file in files.items()}
        program, *arguments = shlex.split(command(**whole))
        line = [*([] if program == "python" else ["-m", program]), *arguments]
        before = _written(target / picture)
        done = subprocess.run([sys.executable, *line], cwd=target, capture_output=True, text=True)
        now = _written(target / picture)  # also beside an answer of no, which is exit code 1
        drawn = now > before or (done.returncode == 0 and now > 0)
        print(f"drew {picture}" if drawn else f"no {picture}: {done.stderr.strip()[-300:]}")
        if drawn:
            short = {name: _quote(file, file.name) for name, file in files.items()}
            sections.append(_section(entry, picture, command(**short)))
    page = "\n".join(["# Gallery\n", "Every picture, with its command.\n", *sections])
    (target / "index.md").write_text(page, encoding="utf-8")
    print(f"wrote {target / 'index.md'}")


def _places(map_file: str) -> dict[str, str]:
    """Start, goal and a place half-way along the shortest path, as options."""
    start, goal = QUERY_OF_OUR_MAP
    if Path(map_file).resolve() != MAP:
        pair = describe_map(map_file).pairs[0]
        start, goal = (pair.start.x, pair.start.y), (pair.goal.x, pair.goal.y)
    path = locplan.plan(locplan.Costmap.blank(locplan.load_map(map_file)), start, goal).path
    middle = path.resample(path.length / 2, even=True).xy[1]
    named = {"start": start, "goal": goal, "middle": middle}
    return {name: f"{x:.2f},{y:.2f}" for name, (x, y) in named.items()}


def _quote(file: Path, name: str) -> str:
    """Return a file's name for a shell. Commands and reports show only a built-in map's name."""
    return shlex.quote(file.stem if file.resolve().parent == MAP.parent else name)


def _written(file: Path) -> int:
    """When a file was written, 0 if it is not there."""
    return file.stat().st_mtime_ns if file.is_file() else 0


def _section(entry: Entry, picture: str, command: str) -> str:
    """Return the part of the page on a picture, as Markdown."""
    shown = f"![{entry.title}]({picture})"
    if picture.endswith(".html"):
        file, title = escape(picture), escape(entry.title)
        frame = f'<iframe src="{file}" title="{title}" loading="lazy"></iframe>'
        shown = f'{frame}\n\n<a href="{file}">Open the report</a>'
    return f"## {entry.title}\n\n{entry.see}\n\n```sh\n{command.strip()}\n```\n\n{shown}\n"


if __name__ == "__main__":
    main(*sys.argv[1:])
