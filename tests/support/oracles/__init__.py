"""Oracles: what the kernels compute, written as slowly and plainly as possible."""

from support.oracles import (
    beams,
    closed_loop,
    curves,
    landmarks,
    lattice,
    lines,
    matching,
    outlines,
    particles,
    sad,
    scan,
    search,
    trajectories,
    walls,
)

__all__ = [
    "beams",
    "closed_loop",
    "curves",
    "landmarks",
    "lattice",
    "lines",
    "matching",
    "outlines",
    "particles",
    "sad",
    "scan",
    "search",
    "trajectories",
    "walls",
]
