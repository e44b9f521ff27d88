"""Layers and filters of Nav2's costmaps, with the defaults that Nav2 fills in."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from locplan._util.checks import shown
from locplan.robots._parameters import GLOBAL_COSTMAP, LOCAL_COSTMAP, Nav2Parameters

DEFAULT_TYPES = {
    "static_layer": "nav2_costmap_2d::StaticLayer",
    "obstacle_layer": "nav2_costmap_2d::ObstacleLayer",
    "inflation_layer": "nav2_costmap_2d::InflationLayer",
}
"""Nav2's default layers in their order, with the types that it gives to just this list
(costmap_2d_ros.cpp, from humble on)."""


class Layer(NamedTuple):
    """A layer of a costmap."""

    name: str
    """Name in the costmap's parameters, such as inflation_layer or container.inflation_layer."""
    plugin: str
    """Type of the plugin; empty if the parameters do not have it."""
    enabled: Any
    """Whether it is enabled; the text that stands there if a launch file replaces it."""
    container: str = ""
    """Name of the PluginContainerLayer that holds it, if one does."""

    def is_a(self, kind: str) -> bool:
        """True if the layer is not disabled and its type has this name."""
        return self.enabled is not False and self.plugin.rpartition("::")[2] == kind


def costmap_layers(parameters: Nav2Parameters, costmap: str) -> list[Layer]:
    """Return the layers of a costmap, those in containers included; none without the costmap.

    Parameters
    ----------
    parameters : Nav2Parameters
        The parameters.
    costmap : str
        Name of the costmap's node.
    """
    own = parameters.of(costmap)
    is_named = any(not entry.is_shared for _, entry in parameters.entries(costmap))
    if "plugins" not in own and not is_named:
        return []
    names = parameters.names(costmap, "plugins", () if "plugins" in own else (*DEFAULT_TYPES,))
    types = DEFAULT_TYPES if names == [*DEFAULT_TYPES] else {}

    def layer(name: str, container: str = "") -> Layer:
        plugin = str(own.get(f"{name}.plugin", types.get(name, ""))).replace("/", "::")
        return Layer(name, plugin, own.get(f"{name}.enabled", True), container)

    layers = []
    for outer in map(layer, names):
        layers.append(outer)
        if outer.is_a("PluginContainerLayer"):
            inner = parameters.names(costmap, f"{outer.name}.plugins")
            layers += [layer(f"{outer.name}.{name}", outer.name) for name in inner]
    return layers


def inflating_layer(parameters: Nav2Parameters) -> str | None:
    """Return the name of the layer that inflates the global costmap's walls, or None.

    Layers update the costs in their order, so that a layer inflates only the layers before it. A
    layer in a container inflates only the layers in it, so that the map's must be there, too.

    Parameters
    ----------
    parameters : Nav2Parameters
        The parameters.
    """
    layers = costmap_layers(parameters, GLOBAL_COSTMAP)
    for at, layer in enumerate(layers):
        if layer.is_a("InflationLayer") and not _misses_walls(layers, at):
            return layer.name
    return None


def _misses_walls(layers: list[Layer], at: int) -> bool:
    """True if the map's layer is not before a layer, or not in its container.

    Outside of containers, a costmap without a StaticLayer may have walls of a layer of another
    type.
    """
    container = layers[at].container
    walls = [n for n, each in enumerate(layers) if each.is_a("StaticLayer")]
    if container:
        return not any(n < at and layers[n].container == container for n in walls)
    return bool(walls) and min(walls) > at


def layer_notes(parameters: Nav2Parameters) -> Iterator[str]:
    """Yield sentences on layers that Nav2 refuses, and on layers that inflate no walls.

    Parameters
    ----------
    parameters : Nav2Parameters
        The parameters.
    """
    layers = costmap_layers(parameters, GLOBAL_COSTMAP)
    if missing := [each.name for each in layers if not each.plugin]:
        listed = ", ".join(each.name for each in layers if not each.container)
        yield (
            f"Nav2 refuses the plugins of global_costmap ({listed}), since {', '.join(missing)}"
            f" {'has' if len(missing) == 1 else 'have'} no plugin type; add it, or list just Nav2's"
            " default layers"
        )
    inflating = inflating_layer(parameters)
    for layer in layers:
        if inflating is not None or not layer.is_a("InflationLayer"):
            continue
        if layer.container:
            yield (
                f"{layer.name} inflates only the layers before it in {layer.container}, and no"
                " StaticLayer is among them: the map's walls are not inflated"
            )
        else:
            yield (
                f"{layer.name} stands before the StaticLayer in plugins: the map's walls are not"
                " inflated; list it last"
            )


def zone_notes(parameters: Nav2Parameters) -> Iterator[str]:
    """Yield sentences on keepout and speed filters, whose zones are not known.

    The masks that locplan exports are none.

    Parameters
    ----------
    parameters : Nav2Parameters
        The parameters.
    """
    kinds = {
        "KeepoutFilter": "keeps the robot out of zones",
        "SpeedFilter": "limits the robot's speed in zones",
    }
    reported = set()
    for costmap in (GLOBAL_COSTMAP, LOCAL_COSTMAP):
        own = parameters.of(costmap)
        for name in (name for key in ("filters", "plugins") for name in _listed(own.get(key))):
            kind = str(own.get(f"{name}.plugin")).replace("/", "::").rpartition("::")[2]
            enabled = own.get(f"{name}.enabled", True)
            ours = name.startswith("localizability_")
            if kind in kinds and kind not in reported and enabled is not False and not ours:
                reported.add(kind)
                what = f"{name} {kinds[kind]} that `plan` and `check` do not know"
                if isinstance(enabled, str):
                    yield f"If your launch enables it (enabled: {shown(enabled)}), {what}"
                else:
                    yield f"{costmap.partition('/')[0]}: {what}"


def _listed(value: Any) -> list[str]:
    return [each for each in value if isinstance(each, str)] if isinstance(value, list) else []
