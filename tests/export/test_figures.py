import numpy as np
from matplotlib.colors import to_rgb
from PIL import Image
from support.maps import ascii_map

from locplan import Costmap, Zone, Zones
from locplan._support.drawing import RED
from locplan.export import nav2_keepout


def test_preview_shows_no_go_zones(tmp_path):
    """The red of no-go zones is in the picture with a zone, and not in the one without."""
    grid = ascii_map("#" * 20, *["#" + "." * 18 + "#"] * 8, "#" * 20, resolution=0.2)
    zones = Zones([Zone("no-go", [[1.6, 0.7], [2.1, 0.7], [2.1, 1.1], [1.6, 1.1]])])
    red = np.round(np.multiply(to_rgb(RED), 255))
    for drawn in (zones, Zones()):
        costs = Costmap.from_layers(grid, u=np.full(grid.shape, 0.5), robot=0.1, zones=drawn)
        nav2_keepout(tmp_path / "mask", costs)
        colours = np.asarray(Image.open(tmp_path / "mask" / "preview.png").convert("RGB"))
        assert (colours == red).all(axis=-1).any() == bool(drawn)
