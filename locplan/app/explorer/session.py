"""Session of the explorer: a map, its field and costs, shared by one or more pages."""

from __future__ import annotations

import secrets
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from locplan._support.checks import check_threads
from locplan._support.tables import nan_to_none
from locplan.app.explorer.first_route import RouteStops, choose_first_route
from locplan.app.explorer.layers import PictureLayer, make_layers
from locplan.app.explorer.messages import Cancelled, CancelToken, Question, QuestionJob
from locplan.app.explorer.plans import has_drafts
from locplan.app.explorer.repairs import compute_scene, make_blank_scene, repair_scene
from locplan.app.explorer.scene import MapScene, StartSettings
from locplan.app.explorer.searches import PathSearches, PathTree, ResultStore
from locplan.app.explorer.sites import Change, ExploredSite
from locplan.app.explorer.weak_spots import NamedSpot, name_weak_spots
from locplan.errors import format_one_line
from locplan.field.field import CovarianceField
from locplan.maps.grid import OccupancyGrid
from locplan.planning.any_angle import AnyAngle


@dataclass(frozen=True)
class PageDownload:
    """A file for the page to download."""

    name: str
    """File name."""
    content: bytes
    """Content of the file."""


class Session:
    """A map with changes, and a thread that updates its field.

    Scenes are replaced as a whole, so that an answer works on one scene throughout.
    Methods can be called from several threads.

    Parameters
    ----------
    grid : OccupancyGrid
        The map.
    opening : Opening
        The settings of the session.
    """

    def __init__(self, grid: OccupancyGrid, opening: StartSettings) -> None:
        self.opening = opening
        self.original = ExploredSite(grid, opening.config, opening.robot)
        self.changes = opening.changes
        self.scene = make_blank_scene(self.original.with_changes(self.changes))
        self.busy: tuple[int, int] | None = None
        """Finished and total steps of the field; 0 of 0 before they are known."""
        self.route: RouteStops | None = None
        """The first route; None before there is one."""
        if opening.start and opening.goal:
            self.route = RouteStops(opening.start, opening.goal, opening.via)
        self.searches = ResultStore(opening.limits.search_bytes)
        self.files = ResultStore(opening.limits.file_bytes)
        self.scenes = ResultStore(opening.limits.scene_bytes)
        self.n_plans = 0
        """Number of plans requested by pages."""
        self.listeners: list[Callable[[dict[str, Any]], None]] = []
        self.lock = threading.RLock()
        self._worker = ThreadPoolExecutor(1, "field")
        self._pool = ThreadPoolExecutor(check_threads(opening.threads), "first points")
        self._cancel = CancelToken()
        self._work: Future[None] | None = None

    @property
    def grid(self) -> OccupancyGrid:
        """The map with its changes."""
        return self.scene.site.grid

    @property
    def field(self) -> CovarianceField | None:
        """The field, or None before there is one."""
        return self.scene.field

    @property
    def weak_spots(self) -> list[NamedSpot] | None:
        """The weak spots of the scene; None before they are known."""
        return self.files.get(("spots", self.scene.digest))  # type: ignore[no-any-return]

    def begin(self, field: CovarianceField | None = None) -> None:
        """Start to compute the field.

        Parameters
        ----------
        field : CovarianceField, optional
            Field of the map, if it is already known.
        """
        with self.lock:
            self._cancel = cancel = CancelToken()
            self.busy = 0, 0
            scenes = self._compute(self.scene.site, cancel, field)
            self._work = self._worker.submit(self._show_scenes, scenes, cancel)

    def apply_changes(self, changes: Sequence[Change]) -> MapScene:
        """Apply changes to the original site, and return the first changed scene.

        Parameters
        ----------
        changes : sequence
            All changes, see `read_changes`.
        """
        site = self.original.with_changes(changes)
        with self.lock:
            self._cancel.cancel()
            self._cancel = cancel = CancelToken()
            stored: MapScene | None = self.scenes.get(site.key)
            earlier: list[MapScene] = [self.scene, *self.scenes.results]
            base = next((scene for scene in earlier if scene.has_field(site.config)), None)
            scenes: Iterator[MapScene] = iter(())
            if stored is not None:
                scene = stored
            elif base is not None:
                progress, forget = self._make_progress_callback(cancel), self.searches.forget
                scenes = repair_scene(base, site, self.opening, self._pool, progress, forget)
                scene = next(scenes)
            else:
                scene, scenes = make_blank_scene(site), self._compute(site, cancel)
                self.busy = 0, 0
            self.changes = tuple(changes)
            self._show_scene(scene)
            self._work = self._worker.submit(self._show_scenes, scenes, cancel)
            return scene

    def wait(self) -> None:
        """Wait until the field is up to date; raise the error if its computation failed."""
        while (work := self._work) is not None:
            with suppress(Cancelled):
                work.result()
            if work is self._work:
                return

    def close(self) -> None:
        """Stop the work after its current step."""
        self._cancel.cancel()
        for pool in (self._worker, self._pool):
            pool.shutdown(wait=False, cancel_futures=True)

    def prepare(self) -> None:
        """Load the kernels, while the browser loads the page."""
        AnyAngle().prepare()
        PathTree.prepare()

    def send_event(self, event: dict[str, Any]) -> None:
        """Send an event to all pages.

        Parameters
        ----------
        event : dict
            The event, fit for JSON.
        """
        for listener in list(self.listeners):
            listener(event)

    def find_layers(self, digest: str) -> Mapping[str, PictureLayer]:
        """Return the layers of a field that is or was shown; empty for other fields.

        Parameters
        ----------
        digest : str
            Digest of the field.
        """
        scene, key = self.scene, ("layers", digest)
        field = scene.field
        if field is None or scene.digest != digest:
            stored: Mapping[str, PictureLayer] = self.files.get(key) or {}
            return stored
        return self.files.get_or_create(
            key,
            lambda: make_layers(field),
            lambda layers: sum(layer.texels.nbytes for layer in layers.values()),
        )

    def add_download(self, name: str, content: bytes) -> str:
        """Store a file for the page to fetch, and return its key.

        Parameters
        ----------
        name : str
            File name for the browser.
        content : bytes
            The content.
        """
        key = secrets.token_urlsafe(16)
        self.files.put(("download", key), PageDownload(name, content), len(content))
        return key

    def answer(
        self, do: str, *, progress: Callable[..., None] | None = None, **values: Any
    ) -> dict[str, Any]:
        """Return the answer to a question as the page gets it, fit for JSON.

        Parameters
        ----------
        do : str
            Name of the question.
        progress : callable, optional
            Called with (done, total) and, optionally, a word for the work.
        **values
            The values of the question.

        Raises
        ------
        LocplanError
            If a value is out of its range.
        """
        from locplan.app.explorer.questions import QUESTIONS

        job = QuestionJob(progress or (lambda *_: None), lambda: None)
        return nan_to_none(QUESTIONS[do].answer(self, Question(do, 0, values), job))

    def _compute(
        self, site: ExploredSite, cancel: CancelToken, field: CovarianceField | None = None
    ) -> Iterator[MapScene]:
        """Yield the scene of a site, with its field computed unless it is given."""
        yield compute_scene(site, self.opening, self._make_progress_callback(cancel), field)

    def _make_progress_callback(self, cancel: CancelToken) -> Callable[[int, int], None]:
        def report(n_done: int, total: int) -> None:
            cancel.check()
            self.busy = n_done, total
            self.send_event({"event": "progress", "done": n_done, "total": total})

        return report

    def _show_scene(self, scene: MapScene) -> None:
        self.scene = scene
        if scene.field is not None and scene.is_field_complete:
            self.busy = None
            self.scenes.put(scene.site.key, scene, scene.n_bytes)
        self.searches.forget(lambda key: key[1] == scene.key)
        self.send_event({"event": "state"})

    def _show_scenes(self, scenes: Iterator[MapScene], cancel: CancelToken) -> None:
        """Show scenes as they are computed, then find weak spots and a first route."""
        try:
            for scene in scenes:
                with self.lock:
                    cancel.check()
                    self._show_scene(scene)
            self._find_spots_and_route(cancel)
        except Exception as error:
            if cancel.is_cancelled:  # also if a pool was closed meanwhile
                raise Cancelled from None
            self.busy = None
            text = format_one_line(" ".join(str(error).split()) or type(error).__name__)
            self.send_event({"event": "error", "error": text})
            self.send_event({"event": "state"})
            raise

    def _find_spots_and_route(self, cancel: CancelToken) -> None:
        """Find the weak spots of the scene, and the first route if there is none."""
        scene = self.scene
        if self.weak_spots is None:
            is_checked = all(
                self.original.digests[name] == scene.basis[name] for name in ("map", "robot")
            )
            spots = name_weak_spots(scene, self.opening.report if is_checked else None)
            rings = [ring for spot in spots for ring in spot.spot.rings]
            self.files.put(("spots", scene.digest), spots, sum(ring.nbytes for ring in rings))
            self.send_event({"event": "state"})
        if self.route is None:
            searches = PathSearches(
                ResultStore(self.opening.limits.search_bytes), scene, cancel.check
            )
            is_draft = has_drafts(self.opening, scene.site.grid)
            self.route = choose_first_route(searches, self.opening, is_draft=is_draft)
            self.send_event({"event": "state"})
