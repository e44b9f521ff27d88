"""Vectors of thirty-two 16-bit counts for numba: sums of differences that stop at the greatest.

A sum that reaches 65,535 stays there, so that "more than a limit" is right however much is added.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from locplan._kernels.simd import _SHORTS, SHORTS, _pointer, _u16x32

GREATEST = 2**16 - 1
"""Greatest count, at which sums stay."""


def _splat(builder: Any, value: Any) -> Any:
    undefined = ir.Constant(_SHORTS, ir.Undefined)
    lane = builder.insert_element(undefined, value, ir.IntType(32)(0))
    first = ir.Constant(ir.VectorType(ir.IntType(32), SHORTS), [0] * SHORTS)
    return builder.shuffle_vector(lane, undefined, first)


def _saturating(builder: Any, name: str, a: Any, b: Any) -> Any:
    function_type = ir.FunctionType(_SHORTS, [_SHORTS, _SHORTS])
    function = builder.module.declare_intrinsic(f"llvm.{name}.sat.v32i16", fnty=function_type)
    return builder.call(function, [a, b])


@intrinsic
def add_distances(
    typingctx: Any, total: Any, counts: Any, index: Any, value: Any, shift: Any
) -> Any:
    """``total + (abs(counts[index : index + 32] - value) >> shift)``, lane by lane, saturating."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        pointer = _pointer(context, builder, signature.args[1], args[1], args[2], _SHORTS)
        there, here = builder.load(pointer, align=2), _splat(builder, args[3])
        above = _saturating(builder, "usub", there, here)
        below = _saturating(builder, "usub", here, there)
        distances = builder.lshr(builder.or_(above, below), _splat(builder, args[4]))
        return _saturating(builder, "uadd", args[0], distances)

    return _u16x32(_u16x32, counts, types.intp, types.uint16, types.uint16), codegen


@intrinsic
def lanes_within(typingctx: Any, total: Any, limit: Any) -> Any:
    """One bit for each lane of `total` that is at most `limit`."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        chosen = builder.icmp_unsigned("<=", args[0], _splat(builder, args[1]))
        return builder.zext(builder.bitcast(chosen, ir.IntType(SHORTS)), ir.IntType(64))

    return types.uint64(_u16x32, types.uint16), codegen
