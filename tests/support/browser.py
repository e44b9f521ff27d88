"""The page of the explorer in a real browser: a server on a small map, and a window on it."""

from __future__ import annotations

import json
import re
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from locplan.app.explorer.explorer import Explorer, open_explorer
from locplan.app.explorer.scene import StartSettings
from locplan.field import CovarianceField, FieldConfig, Fisher, load_or_compute
from locplan.maps import OccupancyGrid
from locplan.maps.environments import make
from locplan.robots import Lidar, Robot

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]
WAIT = 100_000
"""Time after which nothing appears any more, however busy the machine is [ms]."""
LIDAR = Lidar(range=6.0)

HAS_COLOUR = """async ([selector, colour]) => {
    await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
    return [...document.querySelectorAll(selector)].some((canvas) => {
        const copy = new OffscreenCanvas(canvas.width, canvas.height);
        const pen = copy.getContext("2d", { willReadFrequently: true });
        pen.drawImage(canvas, 0, 0);
        const pixels = pen.getImageData(0, 0, canvas.width, canvas.height).data;
        for (let k = 0; k < pixels.length; k += 4)
            if (colour.every((value, channel) => pixels[k + channel] === value)) return true;
        return false;
    });
}"""

COUNTS = """() => {
    const isSeen = (element) => {
        const { top, bottom, left, right } = element.getBoundingClientRect();
        return element.checkVisibility() && bottom > 0 && top < innerHeight && right > left;
    };
    const controls = [...document.querySelectorAll("button, input, select, summary, a[href]")];
    const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    let words = 0;
    while (walker.nextNode()) {
        const parent = walker.currentNode.parentElement;
        if (parent.closest("option:not(:checked), .unseen, script")) continue;
        if (isSeen(parent.closest("select") ?? parent))
            words += walker.currentNode.textContent.split(/\\s+/).filter(Boolean).length;
    }
    const map_share = document.querySelector("main").clientHeight / innerHeight;
    return { controls: controls.filter(isSeen).length, words, map_share };
}"""


def browser_file() -> str | None:
    """Return the browser of this machine, if there is one."""
    return next((file for name in BROWSERS if (file := shutil.which(name))), None)


def corridors(yaw: float = 0.0) -> tuple[OccupancyGrid, CovarianceField]:
    """Return two corridors, of which the shorter one is degenerate, and their field."""
    grid = make("two_corridors", resolution=0.1)
    grid = OccupancyGrid(grid.cells, grid.resolution, (1.0, -2.0, yaw), name="corridors")
    return grid, load_or_compute(grid, FieldConfig(Fisher(LIDAR), stride=0.4))


@contextmanager
def serve(
    grid: OccupancyGrid, field: CovarianceField, *, port: int = 0, **options: Any
) -> Iterator[Explorer]:
    """Serve the page of a map whose field is there."""
    opening = StartSettings(field.config, **({"robot": Robot(LIDAR)} | options))
    with open_explorer(grid, opening, port=port, field=field) as explorer:
        yield explorer


class Window:
    """A page in a window of the browser; it notes errors and addresses."""

    def __init__(self, page: Any) -> None:
        self.page = page
        self.faults: list[str] = []
        self.addresses: list[str] = []
        page.set_default_timeout(WAIT)
        page.on("console", self._note)
        page.on("pageerror", lambda error: self.faults.append(str(error)))
        page.on("request", lambda request: self.addresses.append(request.url))

    def _note(self, message: Any) -> None:
        if message.type == "error":
            self.faults.append(message.text)

    def open(self, address: str) -> Window:
        """Go to an address, and wait for both paths."""
        self.page.goto(address)
        self.wait('html[data-plan="fresh"]')
        return self

    def answer(self, answers: dict[str, Callable[[dict[str, Any], dict[str, Any]], Any]]) -> None:
        """Answer some questions in place of the server; call it before the page is opened.

        A function takes the question and the server's basis, and returns the answer, or None to
        answer never. That of "state" returns what differs in the server's state events.
        """
        basis: dict[str, Any] = {}

        def pass_on(socket: Any) -> None:
            server = socket.connect_to_server()

            def hear(text: str) -> None:
                message = json.loads(text)
                basis.update(message.get("basis", {}))
                if message.get("event") == "state" and "state" in answers:
                    message |= answers["state"](message, basis)
                socket.send(json.dumps(message))

            def ask(text: str) -> None:
                question = json.loads(text)
                if question["do"] not in answers:
                    return server.send(text)
                present = {**basis, "route": question.get("route")}
                answer = answers[question["do"]](question, present)
                if answer is not None:
                    socket.send(json.dumps({"re": question["id"], "basis": present, **answer}))
                return None

            server.on_message(hear)
            socket.on_message(ask)

        self.page.route_web_socket(re.compile("/socket$"), pass_on)

    def wait(self, selector: str, state: str = "attached") -> Any:
        """Wait until an element is there."""
        elements = self.page.locator(selector)
        elements.first.wait_for(state=state)
        return elements

    def text(self, selector: str) -> str:
        """Return the words of an element, with plain spaces."""
        return re.sub(r"\s+", " ", self.page.locator(selector).inner_text()).strip()

    def value(self, name: str) -> str:
        """Return a data attribute of the document."""
        return self.page.locator("html").get_attribute(f"data-{name}") or ""

    def wait_for_change(self, name: str, before: str) -> str:
        """Wait until a data attribute of the document is another one."""
        self.wait(f'html[data-{name}]:not([data-{name}="{before}"])')
        return self.value(name)

    def settle(self) -> None:
        """Wait until the paths shown are those of the present map and route."""
        self.wait('html[data-plan="fresh"]')

    def middle(self, selector: str) -> tuple[float, float]:
        """Return the middle of an element on the screen."""
        box = self.page.locator(selector).first.bounding_box()
        return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def drag(self, begin: tuple[float, float], dx: float, dy: float, *, drop: bool = True) -> None:
        """Drag by pixels from a place on the screen."""
        mouse, (x, y) = self.page.mouse, begin
        mouse.move(x, y)
        mouse.down()
        mouse.move(x + dx / 2, y + dy / 2)
        mouse.move(x + dx, y + dy)
        if drop:
            mouse.up()

    def place(self, name: str) -> tuple[float, float]:
        """Return the world position of a marker, as it is read out [m]."""
        label = self.page.locator(f'.marker[data-name="{name}"]').get_attribute("aria-label")
        x, y = re.findall(r"-?\d+\.\d+", label)
        return float(x), float(y)

    def draw(self, tool: str, dx: float = 60, dy: float = 40) -> None:
        """Draw with a tool from a place in the left room, and move again."""
        self.page.locator(f'[data-tool="{tool}"]').click()
        x, y = self.middle("main")
        self.drag((x - 300, y + 20), dx, dy)
        self.page.locator('[data-tool="move"]').click()

    def counts(self) -> dict[str, float]:
        """Count the controls and words in sight; and the map's share of the height."""
        return dict(self.page.evaluate(COUNTS))

    def has_colour(self, colour: tuple[int, int, int], selector: str = ".marks canvas") -> bool:
        """Whether a canvas has a pixel of a colour, after the next frame."""
        return bool(self.page.evaluate(HAS_COLOUR, [selector, colour]))

    def wait_for_colour(self, colour: tuple[int, int, int]) -> None:
        """Wait until the paths' canvas has a colour: a new theme takes a few frames."""
        end = time.monotonic() + WAIT / 1000
        while not self.has_colour(colour):
            assert time.monotonic() < end, f"no pixel of the paths has the colour {colour}"


def is_local(url: str) -> bool:
    """Whether an address leads to the explorer, or to nothing outside the page."""
    return re.match(r"(http|ws)://127\.0\.0\.1:|file:|blob:|data:", url) is not None
