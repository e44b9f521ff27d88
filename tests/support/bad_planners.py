"""Planners that fail in every way there is, for the engine of comparisons.

They have a file of their own, since each worker process imports it: that of the tests takes longer.
"""

import dataclasses
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from locplan.errors import LocplanError
from locplan.planning import plan


def crash(costs, start, goal):
    os.kill(os.getpid(), signal.SIGSEGV)


def leave(costs, start, goal):
    os._exit(3)


def spin(costs, start, goal):
    while True:
        pass


def sleep(costs, start, goal):
    time.sleep(1000)


def hog(costs, start, goal):
    kept = []
    while True:
        kept.append(np.ones(4_000_000))


def fail(costs, start, goal):
    raise ValueError("no idea\nat all")


def refuse(costs, start, goal):
    raise LocplanError("not on this map")


def depart(costs, start, goal):
    sys.exit("bye")


def boast(costs, start, goal):
    return dataclasses.replace(plan(costs, start, goal), path=None, metrics=None)


def trespass(costs, start, goal):
    found = plan(costs, start, goal)
    straight = dataclasses.replace(found.path, xy=np.array([start, goal]))
    return dataclasses.replace(found, path=straight)


def stray(costs, start, goal):
    return plan(costs, start, (3.5, 3.5))


def print_something(costs, start, goal):
    print("planning ...")
    return "a path"


def counting(costs, start, goal, folder, seed=0):
    """Leaves a file for every call."""
    Path(folder, f"{time.monotonic_ns()}").touch()
    return plan(costs, start, goal)


def slow(costs, start, goal, folder):
    Path(folder, f"{os.getpid()}").touch()
    time.sleep(1000)


def first_waits(costs, start, goal, folder):
    """Whoever comes first waits to be killed."""
    try:
        with Path(folder, "victim").open("x") as file:
            file.write(str(os.getpid()))
    except FileExistsError:
        return plan(costs, start, goal)
    signal.pause()


def spawning(costs, start, goal, folder):
    child = subprocess.Popen(["sleep", "1000"])
    Path(folder, f"{child.pid}").touch()
    time.sleep(1000)


def spawn_and_crash(costs, start, goal, folder):
    child = subprocess.Popen(["sleep", "1000"])
    Path(folder, f"{child.pid}").touch()
    crash(costs, start, goal)
