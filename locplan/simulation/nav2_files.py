"""AMCL's parameters from a parameter file of Nav2."""

from __future__ import annotations

import dataclasses
import os
import warnings
from pathlib import Path

from locplan.errors import LocplanError
from locplan.export.parameters import read_parameters
from locplan.simulation.settings import Amcl

NOT_SIMULATED = {
    "recovery_alpha_slow": 0.0,
    "recovery_alpha_fast": 0.0,
    "do_beamskip": False,
    "robot_model_type": "nav2_amcl::DifferentialMotionModel",
}
"""What would matter, and the only value that is simulated."""


def read_amcl(path: str | os.PathLike[str]) -> Amcl:
    """The filter as a file of Nav2's parameters has it; what is not there has its default.

    Warns of what the file sets and is not simulated.

    Raises
    ------
    LocplanError
        If the file cannot be read, has no parameters of amcl, or a value is out of its range.
    """
    own = read_parameters(Path(path)).get("amcl")
    given = own.get("ros__parameters") if isinstance(own, dict) else None
    if not isinstance(given, dict):
        raise LocplanError(f"{path}: has no parameters of amcl; give the file that starts it")
    for name, simulated in NOT_SIMULATED.items():
        if given.get(name, simulated) != simulated:
            warnings.warn(f"{path}: {name} is simulated as {simulated}", stacklevel=2)
    known = {each.name for each in dataclasses.fields(Amcl)}
    try:
        return Amcl(**{name: value for name, value in given.items() if name in known})
    except LocplanError as error:
        raise LocplanError(f"{path}: amcl: {error}") from None
