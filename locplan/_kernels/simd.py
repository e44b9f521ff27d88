"""Vectors of eight 64-bit words for numba: load, store, and the population count of an AND.

numba's loop vectoriser does not arrange a sparse list of template words with vertical offsets in
the lanes. These few intrinsics carry an LLVM vector as a numba value, so that the loop around
them stays plain Python; LLVM lowers `ctpop` to what the processor has (AVX-512, AVX2, NEON).
So does its hint that memory will be read soon, `prefetch`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic, models, register_model

_READ, _KEEP, _DATA = 0, 3, 1
"""Arguments of LLVM's `prefetch`: for reading, kept in all caches, data and not code."""
LANES = 8
_VECTOR = ir.VectorType(ir.IntType(64), LANES)


class _U64x8(types.Type):
    def __init__(self) -> None:
        super().__init__(name="u64x8")


_u64x8 = _U64x8()


@register_model(_U64x8)
class _U64x8Model(models.PrimitiveModel):
    def __init__(self, dmm: Any, fe_type: Any) -> None:
        super().__init__(dmm, fe_type, _VECTOR)


def _pointer(context: Any, builder: Any, array_type: Any, array: Any, index: Any, to: Any) -> Any:
    data = context.make_array(array_type)(context, builder, array).data
    return builder.bitcast(builder.gep(data, [index]), to.as_pointer())


def _popcount(builder: Any, value: Any) -> Any:
    kind = "v8i64" if value.type == _VECTOR else "i64"
    function_type = ir.FunctionType(value.type, [value.type])
    function = builder.module.declare_intrinsic(f"llvm.ctpop.{kind}", fnty=function_type)
    return builder.call(function, [value])


def _splat(builder: Any, word: Any) -> Any:
    lane = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), word, ir.IntType(32)(0))
    first = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(lane, ir.Constant(_VECTOR, ir.Undefined), first)


@intrinsic
def zeros(typingctx: Any) -> Any:
    """Eight zeros."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return ir.Constant(_VECTOR, [0] * LANES)

    return _u64x8(), codegen


@intrinsic
def add_matches(typingctx: Any, counts: Any, word: Any, words: Any, index: Any) -> Any:
    """``counts + popcount(word & words[index : index + 8])``, lane by lane."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        counts_value, word_value, array, start = args
        pointer = _pointer(context, builder, signature.args[2], array, start, _VECTOR)
        window = builder.load(pointer, align=8)
        both = builder.and_(_splat(builder, word_value), window)
        return builder.add(counts_value, _popcount(builder, both))

    return _u64x8(_u64x8, types.uint64, words, types.intp), codegen


@intrinsic
def add_difference(typingctx: Any, counts: Any, values: Any, index: Any, less: Any) -> Any:
    """``counts + values[index : index + 8] - values[less : less + 8]`` of an array of int64."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        counts_value, array, at, less_at = args
        plus = _pointer(context, builder, signature.args[1], array, at, _VECTOR)
        minus = _pointer(context, builder, signature.args[1], array, less_at, _VECTOR)
        total = builder.add(counts_value, builder.load(plus, align=8))
        return builder.sub(total, builder.load(minus, align=8))

    return _u64x8(_u64x8, values, types.intp, types.intp), codegen


@intrinsic
def store_negative(typingctx: Any, a: Any, target: Any, index: Any) -> Any:
    """``target[index : index + 8] = -a`` for an array of int64."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        pointer = _pointer(context, builder, signature.args[1], args[1], args[2], _VECTOR)
        builder.store(builder.neg(args[0]), pointer, align=8)
        return context.get_dummy_value()

    return types.void(_u64x8, target, types.intp), codegen


@intrinsic
def add_to(typingctx: Any, target: Any, index: Any, a: Any) -> Any:
    """``target[index : index + 8] += a`` for an array of int64."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        pointer = _pointer(context, builder, signature.args[0], args[0], args[1], _VECTOR)
        builder.store(builder.add(builder.load(pointer, align=8), args[2]), pointer, align=8)
        return context.get_dummy_value()

    return types.void(target, types.intp, _u64x8), codegen


@intrinsic
def popcount(typingctx: Any, word: Any) -> Any:
    """Number of ones in a 64-bit word."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return _popcount(builder, args[0])

    return types.int64(types.uint64), codegen


@intrinsic
def load_word(typingctx: Any, octets: Any, index: Any) -> Any:
    """The 64-bit word at ``octets[index : index + 8]`` (any alignment) of an array of uint8."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        word = ir.IntType(64)
        pointer = _pointer(context, builder, signature.args[0], args[0], args[1], word)
        return builder.load(pointer, align=1)

    return types.uint64(octets, types.intp), codegen


@intrinsic
def lowest_bit(typingctx: Any, word: Any) -> Any:
    """Number of the lowest bit that is set in a 64-bit word, which must not be 0."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.cttz(args[0], ir.IntType(1)(1))

    return types.int64(types.uint64), codegen


def _lanes_where(predicate: str, against: int) -> Callable[..., Any]:
    def lanes(typingctx: Any, octets: Any, at: Any, flip: Any, masks: Any, first: Any) -> Any:
        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            words_at = _pointer(context, builder, signature.args[0], args[0], args[1], _VECTOR)
            masks_at = _pointer(context, builder, signature.args[3], args[3], args[4], _VECTOR)
            words = builder.xor(builder.load(words_at, align=1), _splat(builder, args[2]))
            words = builder.and_(words, builder.load(masks_at, align=8))
            constant = ir.Constant(_VECTOR, [against] * LANES)
            chosen = builder.icmp_unsigned(predicate, words, constant)
            return builder.zext(builder.bitcast(chosen, ir.IntType(LANES)), ir.IntType(64))

        return types.uint64(octets, types.intp, types.uint64, masks, types.intp), codegen

    return lanes


set_lanes = intrinsic(_lanes_where("!=", 0))
"""``set_lanes(octets, at, flip, masks, first)``: one bit for each of the eight words from byte
`at` on of an array of uint8 for which ``(word ^ flip) & masks[first:]`` is not zero."""
full_lanes = intrinsic(_lanes_where("==", 2**64 - 1))
"""Variant of `set_lanes` with one bit for each word for which that value is all ones."""


SHORTS = 32
_SHORTS = ir.VectorType(ir.IntType(16), SHORTS)
_SUMS = ir.VectorType(ir.IntType(32), SHORTS)


class _U16x32(types.Type):
    def __init__(self) -> None:
        super().__init__(name="u16x32")


_u16x32 = _U16x32()


@register_model(_U16x32)
class _U16x32Model(models.PrimitiveModel):
    def __init__(self, dmm: Any, fe_type: Any) -> None:
        super().__init__(dmm, fe_type, _SHORTS)


@intrinsic
def zero_shorts(typingctx: Any) -> Any:
    """Thirty-two zeros."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return ir.Constant(_SHORTS, [0] * SHORTS)

    return _u16x32(), codegen


@intrinsic
def add_shorts(typingctx: Any, total: Any, values: Any, index: Any) -> Any:
    """``total + values[index : index + 32]`` of an array of uint16, lane by lane."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        pointer = _pointer(context, builder, signature.args[1], args[1], args[2], _SHORTS)
        return builder.add(args[0], builder.load(pointer, align=2))

    return _u16x32(_u16x32, values, types.intp), codegen


@intrinsic
def add_shorts_to(typingctx: Any, target: Any, index: Any, total: Any) -> Any:
    """``target[index : index + 32] += total`` for an array of uint32."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        pointer = _pointer(context, builder, signature.args[0], args[0], args[1], _SUMS)
        sums = builder.add(builder.load(pointer, align=4), builder.zext(args[2], _SUMS))
        builder.store(sums, pointer, align=4)
        return context.get_dummy_value()

    return types.void(target, types.intp, _u16x32), codegen


@intrinsic
def lanes_at_most(typingctx: Any, values: Any, index: Any, limit: Any) -> Any:
    """One bit for each of ``values[index : index + 32]`` of an array of uint32 up to `limit`."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        pointer = _pointer(context, builder, signature.args[0], args[0], args[1], _SUMS)
        undefined, first = ir.Constant(_SUMS, ir.Undefined), ir.IntType(32)(0)
        lane = builder.insert_element(undefined, args[2], first)
        limits = builder.shuffle_vector(lane, undefined, ir.Constant(_SUMS, [0] * SHORTS))
        chosen = builder.icmp_unsigned("<=", builder.load(pointer, align=4), limits)
        return builder.zext(builder.bitcast(chosen, ir.IntType(SHORTS)), ir.IntType(64))

    return types.uint64(values, types.intp, types.uint32), codegen


@intrinsic
def prefetch(typingctx: Any, array: Any, index: Any) -> Any:
    """Ask for the line of memory that holds ``array[index]``; any index does no harm."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        data = context.make_array(signature.args[0])(context, builder, args[0]).data
        byte, word = ir.IntType(8).as_pointer(), ir.IntType(32)
        function_type = ir.FunctionType(ir.VoidType(), [byte, word, word, word])
        function = builder.module.declare_intrinsic("llvm.prefetch", [byte], function_type)
        address = builder.bitcast(builder.gep(data, [args[1]]), byte)
        builder.call(function, [address, *map(word, (_READ, _KEEP, _DATA))])
        return context.get_dummy_value()

    return types.void(array, types.intp), codegen
