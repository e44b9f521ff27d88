"""Vectors of sixty-four 8-bit counts for numba: sums of distances between codes on a circle.

Codes are counted modulo 256, so that the distance of two of them is the shorter way round. LLVM
splits the vectors into what the processor has.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic, models, register_model

from locplan._kernels.simd import _pointer

OCTETS = 64
GREATEST = 2**8 - 1
"""Greatest count; the caller must see to it that no sum passes it."""
_OCTETS = ir.VectorType(ir.IntType(8), OCTETS)
_WIDE = ir.VectorType(ir.IntType(16), OCTETS)


class _U8x64(types.Type):
    def __init__(self) -> None:
        super().__init__(name="u8x64")


_u8x64 = _U8x64()


@register_model(_U8x64)
class _U8x64Model(models.PrimitiveModel):
    def __init__(self, dmm: Any, fe_type: Any) -> None:
        super().__init__(dmm, fe_type, _OCTETS)


def _splat(builder: Any, value: Any, kind: Any) -> Any:
    undefined = ir.Constant(kind, ir.Undefined)
    lane = builder.insert_element(undefined, value, ir.IntType(32)(0))
    first = ir.Constant(ir.VectorType(ir.IntType(32), OCTETS), [0] * OCTETS)
    return builder.shuffle_vector(lane, undefined, first)


def _least(builder: Any, a: Any, b: Any) -> Any:
    return builder.select(builder.icmp_unsigned("<", a, b), a, b)


@intrinsic
def zero_octets(typingctx: Any) -> Any:
    """Sixty-four zeros."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return ir.Constant(_OCTETS, [0] * OCTETS)

    return _u8x64(), codegen


@intrinsic
def add_gaps(typingctx: Any, total: Any, codes: Any, index: Any, code: Any, most: Any) -> Any:
    """``total + min(gap, most)``, the gaps from ``codes[index : index + 64]`` to one code."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        pointer = _pointer(context, builder, signature.args[1], args[1], args[2], _OCTETS)
        there, here = builder.load(pointer, align=1), _splat(builder, args[3], _OCTETS)
        gap = _least(builder, builder.sub(there, here), builder.sub(here, there))
        capped = _least(builder, gap, _splat(builder, args[4], _OCTETS))
        return builder.add(args[0], capped)

    return _u8x64(_u8x64, codes, types.intp, types.uint8, types.uint8), codegen


@intrinsic
def add_octets_to(typingctx: Any, target: Any, index: Any, total: Any) -> Any:
    """``target[index : index + 64] += total`` for an array of uint16."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        pointer = _pointer(context, builder, signature.args[0], args[0], args[1], _WIDE)
        sums = builder.add(builder.load(pointer, align=2), builder.zext(args[2], _WIDE))
        builder.store(sums, pointer, align=2)
        return context.get_dummy_value()

    return types.void(target, types.intp, _u8x64), codegen


@intrinsic
def lanes_below(typingctx: Any, values: Any, index: Any, limit: Any) -> Any:
    """One bit for each of ``values[index : index + 64]`` of an array of uint16 below `limit`."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        pointer = _pointer(context, builder, signature.args[0], args[0], args[1], _WIDE)
        limits = _splat(builder, args[2], _WIDE)
        chosen = builder.icmp_unsigned("<", builder.load(pointer, align=2), limits)
        return builder.bitcast(chosen, ir.IntType(OCTETS))

    return types.uint64(values, types.intp, types.uint16), codegen
