"""Export for Nav2: masks, parameters, zones and an edited map in one folder."""

from __future__ import annotations

import itertools
import re
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast, get_args

from locplan._support.files import make_folder
from locplan.app.explorer.plans import read_weight
from locplan.app.explorer.scene import MapScene
from locplan.errors import ConfigError
from locplan.export.nav2 import nav2_keepout
from locplan.export.registry import DEFAULT_DISTRO, Distro
from locplan.maps.files import save_map

if TYPE_CHECKING:
    from locplan.app.explorer.messages import Question, QuestionJob
    from locplan.app.explorer.session import Session

MAP_FILE = "edited_map.yaml"
"""Name of the file of an edited map."""


def export_masks(
    session: Session, scene: MapScene, question: Question, job: QuestionJob
) -> dict[str, Any]:
    """Write the masks of the scene as `locplan.export.nav2_keepout` does, and an edited map.

    If an export exists, the new folder gets a number. With `force`, it replaces the earlier one.
    """
    opening, site = session.opening, scene.site
    scene.check_field()
    if opening.folder is None:
        raise ConfigError("exports need an output folder; open the page with one")
    distro = cast(Distro, question.choice("distro", get_args(Distro), DEFAULT_DISTRO))
    costs = scene.costs.with_weight(read_weight(question, scene))
    job.progress(0, 1)
    make_folder(opening.folder)
    name = f"{make_map_file_name(site.grid.name)}-nav2"
    target = opening.folder / name if opening.force else _find_unused_folder(opening.folder, name)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        nav2_keepout(
            target,
            costs,
            distro=distro,
            params=opening.parameter_files or None,
            force=opening.force,
        )
        if site.grid.digest != session.original.grid.digest:
            save_map(site.grid, target / MAP_FILE)
    files = sorted(file for file in target.rglob("*") if file.is_file())
    return {
        "folder": str(target),
        "files": [file.relative_to(target).as_posix() for file in files],
        "warnings": [*dict.fromkeys(str(warning.message) for warning in caught)],
    }


def make_map_file_name(name: str) -> str:
    """Return a map's name as a file name: letters, digits, dots, dashes and underscores."""
    return re.sub(r"[^\w.-]+", "_", name).strip("._-")[:80] or "map"


def _find_unused_folder(folder: Path, name: str) -> Path:
    """Return an unused path in a folder, with a number if the name is taken."""
    names = itertools.chain([name], (f"{name}-{number}" for number in itertools.count(2)))
    targets = (folder / unused for unused in names)
    return next(path for path in targets if not path.exists() and not path.is_symlink())
