"""The explorer's page in a real browser: a server on a small map, and helpers to look and point."""

from __future__ import annotations

import json
import math
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import locplan
from locplan.app.explorer.explorer import opened
from locplan.app.explorer.scene import Opening
from locplan.field import CovarianceField, FieldConfig, Fisher, load_or_compute
from locplan.maps import OccupancyGrid
from locplan.maps.environments import make
from locplan.robots import Lidar

STATIC = Path(locplan.__file__).parent / "app" / "explorer" / "static"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]
WAIT = 300_000
"""Time after which something does not appear any more, however busy the machine is [ms]."""


HAS_COLOUR = """async (colour) => {
    await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
    const canvas = document.getElementById("overlay");
    const copy = new OffscreenCanvas(canvas.width, canvas.height);
    const pen = copy.getContext("2d", { willReadFrequently: true });
    pen.drawImage(canvas, 0, 0);
    const pixels = pen.getImageData(0, 0, canvas.width, canvas.height).data;
    for (let k = 0; k < pixels.length; k += 4)
        if (colour.every((value, channel) => pixels[k + channel] === value)) return true;
    return false;
}"""


KEEP_WORDS = """() => {
    window.words = [];
    const { fillText } = CanvasRenderingContext2D.prototype;
    CanvasRenderingContext2D.prototype.fillText = function (text, ...rest) {
        window.words.push(text);
        return fillText.call(this, text, ...rest);
    };
}"""


def browser_file() -> str | None:
    """The browser of this machine, if there is one."""
    return next((found for name in BROWSERS if (found := shutil.which(name))), None)


def corridors(yaw: float = 0.0) -> tuple[OccupancyGrid, CovarianceField]:
    """Two corridors, of which the shorter one is degenerate, and their field."""
    grid = make("two_corridors", resolution=0.1)
    grid = OccupancyGrid(grid.cells, grid.resolution, (1.0, -2.0, yaw), name="corridors")
    return grid, load_or_compute(grid, FieldConfig(Fisher(Lidar(range=6.0)), stride=0.4))


class Seen:
    """A page, and what went wrong on it."""

    def __init__(self, page: Any) -> None:
        self.page = page
        self.faults: list[str] = []
        self.addresses: list[str] = []
        page.set_default_timeout(WAIT)
        page.on("console", self._heard)
        page.on("pageerror", lambda error: self.faults.append(str(error)))
        page.on("request", lambda request: self.addresses.append(request.url))

    def _heard(self, message: Any) -> None:
        if message.type in ("error", "warning"):
            self.faults.append(message.text)

    def open(self, address: str) -> Seen:
        """Go to an address and wait for the first paths."""
        self.page.goto(address)
        self.wait('html[data-state="ready"]')
        self.page.locator("#aware-length", has_text="m").wait_for()
        return self

    def answer(self, answers: dict[str, Any]) -> None:
        """Answer some asks in the server's place; to be called before the page is opened.

        An answer is what the page is told, or a function of the ask and of what tells it.
        """

        def passed_on(socket: Any) -> None:
            behind = socket.connect_to_server()

            def asked(text: str) -> None:
                ask = json.loads(text)
                told = answers.get(ask["do"])
                if told is None:
                    behind.send(text)
                elif callable(told):
                    told(ask["id"], lambda message: socket.send(json.dumps(message)))
                else:
                    socket.send(json.dumps({"re": ask["id"], **told}))

            socket.on_message(asked)

        self.page.route_web_socket(re.compile("/socket$"), passed_on)

    def wait(self, selector: str, state: str = "attached") -> Any:
        """Wait until something is there."""
        found = self.page.locator(selector)
        found.first.wait_for(state=state)
        return found

    def text(self, selector: str) -> str:
        """The words of an element, with plain spaces."""
        return re.sub(r"\s+", " ", self.page.locator(selector).inner_text()).strip()

    def value(self, name: str) -> str:
        """A data attribute of the document."""
        return self.page.locator("html").get_attribute(f"data-{name}") or ""

    def await_change(self, name: str, before: str) -> str:
        """Wait until a data attribute of the document is another one."""
        self.wait(f'html[data-{name}]:not([data-{name}="{before}"])')
        return self.value(name)

    def middle(self, selector: str) -> tuple[float, float]:
        """The middle of an element on the screen."""
        box = self.page.locator(selector).first.bounding_box()
        return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def drag(self, selector: str, dx: float, dy: float, *, release: bool = True) -> None:
        """Drag an element by pixels."""
        x, y = self.middle(selector)
        self.page.mouse.move(x, y)
        self.page.mouse.down()
        self.page.mouse.move(x + dx / 2, y + dy / 2)
        self.page.mouse.move(x + dx, y + dy)
        if release:
            self.page.mouse.up()

    def has_drawn(self, colour: tuple[int, int, int]) -> bool:
        """Whether anything above the map is of a colour, after the next frame."""
        return bool(self.page.evaluate(HAS_COLOUR, colour))

    def place(self, name: str) -> tuple[float, float]:
        """World position of a marker, as it is read out [m]."""
        label = self.page.locator(f'.marker[data-name="{name}"]').get_attribute("aria-label")
        x, y = re.findall(r"-?\d+\.\d+", label)
        return float(x), float(y)

    def legend(self) -> list[str]:
        """The lines that a saved picture tells of its paths."""
        self.unfold("share-group")
        self.page.evaluate(KEEP_WORDS)
        with self.page.expect_download():
            self.page.locator("#picture").click()
        words = [each.replace("\u202f", " ") for each in self.page.evaluate("() => window.words")]
        return [each for each in words if re.match(r"[\w ]+: [\d.]+ m", each)]

    def unfold(self, group: str) -> None:
        """Open a group of the panel."""
        if self.page.locator(f"#{group}").get_attribute("open") is None:
            self.page.locator(f"#{group} > summary").click()


@contextmanager
def serve(
    grid: OccupancyGrid, field: CovarianceField, *, port: int = 0, **options: Any
) -> Iterator[Any]:
    """An explorer's server."""
    ends = {name: _placed(grid, along) for name, along in (("start", 2.0), ("goal", 38.0))}
    opening = Opening(field.config, **(ends | options))
    with opened(grid, opening, port=port, field=field) as explorer:
        yield explorer


def _placed(grid: OccupancyGrid, along: float) -> tuple[float, float]:
    """World position beside the degenerate corridor, at a distance along the map [m]."""
    x, y, yaw = grid.origin
    cos, sin = math.cos(yaw), math.sin(yaw)
    return x + cos * along - sin * 3.0, y + sin * along + cos * 3.0


def is_ours(url: str) -> bool:
    """True if an address leads to the explorer itself, or to nothing beyond the page."""
    return re.match(r"(http|ws)://127\.0\.0\.1:|file:|blob:|data:", url) is not None
