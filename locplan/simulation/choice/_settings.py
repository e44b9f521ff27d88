"""Settings of a choice: what binds its candidates, and what decides among them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from locplan._util.checks import Settings, instance, keep, number, one_of, positive, shown, whole
from locplan.errors import ConfigError
from locplan.maps import OccupancyGrid
from locplan.planners import Position
from locplan.robots import Amcl
from locplan.simulation._drives import MINIMISED, Minimise
from locplan.simulation.choice._race import LOOKS

CALM: dict[str, Any] = {
    **dict.fromkeys(("alpha1", "alpha2", "alpha3", "alpha4", "alpha5"), 0.05),
    "laser_model_type": "likelihood_field_prob",
}
TUNED = Amcl(**CALM)
"""Settings of a filter that are good for most robots indoors; the rest is the robot's own."""


@dataclass(frozen=True, kw_only=True, repr=False)
class ChoiceSettings(Settings):
    """Settings of a choice, which `locplan.choose` takes by name.

    Raises
    ------
    ConfigError
        If one is out of its range.

    Examples
    --------
    >>> ChoiceSettings(drives=16, bold=True)
    ChoiceSettings(drives=16, bold=True)
    """

    via: tuple[Position, ...] = ()
    """Positions that all candidates visit in this order [m]."""
    max_e: float | None = None
    """Maximum e of the cells that a candidate enters, above 0 [m^2 rad]; None sets no limit."""
    budget: float | None = None
    """Maximum integral of u of a candidate, >= 0 [m]; None sets no limit."""
    longest: float = 1.5
    """Maximum length of a candidate, in lengths of the shortest path, >= 1; paths that are given
    may be longer."""
    front: bool = False
    """Whether up to 5 paths of the Pareto front of length against degeneracy are candidates."""
    weight: float | None = None
    """Weight of the aware path that is planned where nothing is driven, by default the
    estimator's own, and of a further candidate where the robot is driven, >= 0."""
    criterion: str | None = None
    """Value that u is made of; None takes the estimator's own, see `Costmap.from_field`."""
    minimise: Minimise = "rmse"
    """Error that decides: "rmse" of the position, "goal-error" (that of the last metre), "heading",
    or "lost": in the race first of all few lost drives."""
    price: float = 0.3
    """What counts in the race beside the logarithm of the error: so much of that of the length,
    >= 0."""
    drives: int = 64
    """Maximum number of confirming drives of a path, 2 to 1024; 0 drives no path."""
    bold: bool = False
    """Whether a path that is only probably better is recommended, too."""
    time_limit: float | None = None
    """Time after which no further round of confirming drives begins, above 0 [s]; None sets
    none."""

    filter_map: OccupancyGrid | None = dataclasses.field(default=None, compare=False)
    """The filter's map in the same frame, where it differs from the one that is driven in."""
    rival: Amcl | None = TUNED
    """Filter that is driven along the shortest path, too, to tell whether settings gain more than
    paths; None drives none, nor is one driven beside a filter that is no AMCL. The default stands
    for the robot's own filter with all alphas 0.05 and likelihood_field_prob."""

    def __post_init__(self) -> None:
        keep(self, via=tuple(self.via), longest=number("longest", self.longest, 1.0))
        keep(self, price=number("price", self.price, 0.0))
        one_of("minimise", self.minimise, MINIMISED)
        for name in ("front", "bold"):
            instance(name, getattr(self, name), bool, "give true or false")
        if self.drives != 0:
            whole("drives (0 drives no path)", self.drives, 2, LOOKS[-1])
        for name in ("max_e", "time_limit"):
            if getattr(self, name) is not None:
                positive(name, getattr(self, name))
        for name in ("budget", "weight"):
            if getattr(self, name) is not None:
                number(name, getattr(self, name), 0.0)

    @classmethod
    def of(cls, settings: Mapping[str, Any]) -> ChoiceSettings:
        """Settings by name.

        Parameters
        ----------
        settings : mapping by name
            Fields of this class; others have their defaults.

        Raises
        ------
        ConfigError
            If there is no such setting, or one is out of its range.
        """
        known = [each.name for each in dataclasses.fields(cls)]
        for name in settings:
            if name not in known:
                raise ConfigError(
                    f"a choice has no setting {shown(name)}; it has {', '.join(known)}"
                )
        return cls(**settings)

    def rival_of(self, own: object) -> Amcl | None:
        """The rival of a robot's own filter; None without one, or if it is the same or no AMCL.

        Parameters
        ----------
        own : Filter
            The robot's filter, of any kind.
        """
        if not isinstance(own, Amcl):  # what gains is advised as AMCL's parameters
            return None
        rival = dataclasses.replace(own, **CALM) if self.rival == TUNED else self.rival
        return None if rival == own else rival

    @property
    def is_limited(self) -> bool:
        """Whether paths keep limits that a field sets."""
        return self.max_e is not None or self.budget is not None
