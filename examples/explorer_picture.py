"""A picture of the explorer's page: the hall with TurtleBot 4's lidar, both paths, an ellipse.

Run: python examples/explorer_picture.py [FOLDER [MAP]]

It needs playwright and a Chromium of this machine, beside what the explorer needs.
"""

from __future__ import annotations

import shutil
import sys
from io import BytesIO
from pathlib import Path

from PIL import Image

import locplan

MAPS = Path(__file__).resolve().parent.parent / "maps"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
"""Commands that start a browser, the first that is there is taken."""
FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]
SIZE = {"width": 1400, "height": 900}
"""Size of the window [px]."""
POINTED = (400.0, 480.0)
"""Place of the cursor in the window [px], in the degenerate part of the hall."""
PATIENCE = 600_000
"""Longest time until both paths are there [ms]; the field is computed the first time."""


def browser_file() -> str | None:
    """The browser of this machine, if there is one."""
    return next((found for name in BROWSERS if (found := shutil.which(name))), None)


def photographed(address: str, browser: str) -> bytes:
    """The page at an address as a PNG, once both paths are there."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=browser, args=FLAGS)
        page = chromium.new_page(viewport=SIZE, color_scheme="light", reduced_motion="reduce")
        page.set_default_timeout(PATIENCE)
        page.goto(address)
        page.locator('html[data-plan="fresh"][data-spots="fresh"]').wait_for(state="attached")
        page.mouse.move(*POINTED)
        page.locator(".readout", has_text="Position").wait_for()
        picture = page.screenshot()
        chromium.close()
    return picture


def main(folder: str = "explorer_picture", map_name: str = "hall") -> None:
    """Write explorer.png into a folder, with 256 colours."""
    browser = browser_file()
    if browser is None:
        sys.exit(f"explorer_picture needs a browser; none of {', '.join(BROWSERS)} is here")
    grid = locplan.load_map(MAPS / f"{map_name}.yaml")
    with locplan.explore(grid, robot=locplan.Robot("turtlebot4"), open_browser=False) as explorer:
        picture = photographed(explorer.address, browser)
    file = Path(folder) / "explorer.png"
    file.parent.mkdir(parents=True, exist_ok=True)
    page = Image.open(BytesIO(picture)).convert("RGB")
    colours = page.quantize(256, kmeans=3)
    colours.save(file, optimize=True)
    print(f"wrote {file}, {file.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main(*sys.argv[1:3])
