"""Fields of many maps, one after the other."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from locplan.errors import LocplanError
from locplan.field import CovarianceField
from locplan.field_files import SUFFIX, is_field
from locplan.files import PICTURES, check_folder_target, check_target, make_folder
from locplan.grid import OccupancyGrid
from locplan.map_files import find_maps, load_map, name_of
from locplan.reporting import field_summary


@dataclass(frozen=True)
class Job:
    """A map, and where its field and its picture go, if anywhere."""

    map_file: Path
    output: Path | None = None
    picture: Path | None = None

    def check(self) -> None:
        """Raise a LocplanError unless both can be written."""
        if self.output:
            check_folder_target(self.output, SUFFIX, is_field)
        if self.picture:
            check_target(self.picture, *PICTURES)

    def run(self, compute: Callable[[OccupancyGrid], CovarianceField]) -> CovarianceField:
        """Load the map, compute its field, and write what is wanted."""
        field = compute(load_map(self.map_file))
        if self.output:
            field.save(self.output)
        if self.picture:
            from locplan import plotting

            plotting.save_figure(plotting.field_figure(field), self.picture)
        return field


def jobs_for(maps: Sequence[Path], output: Path | None, picture: Path | None) -> list[Job]:
    """One job a map: of the map files named, and of those in the folders named.

    Fields and pictures go into the folders `output` and `picture`, each by the name of its map.

    Raises
    ------
    LocplanError
        If a folder holds no map or cannot be made, or two maps have one name.
    """
    files = find_maps(*maps)
    names = [name_of(file) for file in files]
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice and (output or picture):
        raise LocplanError(f"several maps are named {twice[0]}: their files would collide")
    for folder in filter(None, (output, picture)):
        make_folder(folder)
    return [
        Job(
            file,
            output / f"{name}{SUFFIX}" if output else None,
            picture / f"{name}.png" if picture else None,
        )
        for file, name in zip(files, names, strict=True)
    ]


def run_all(
    jobs: Sequence[Job], compute: Callable[[OccupancyGrid], CovarianceField]
) -> Iterator[dict[str, Any]]:
    """Each job's summary, with its file, the seconds it took, and the error if it failed."""
    for job in jobs:
        started = time.perf_counter()
        about: dict[str, Any] = {"file": str(job.map_file), "map": name_of(job.map_file)}
        try:
            job.check()
            about |= field_summary(job.run(compute)) | {"error": None}
        except LocplanError as error:
            about["error"] = str(error)
        yield about | {"seconds": round(time.perf_counter() - started, 3)}
