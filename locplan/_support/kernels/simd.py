"""Vectors of unsigned integers for numba, and the operations of the kernels on them.

numba's loop vectorizer does not arrange a sparse list of template words with vertical offsets in
the lanes. An `operation` here carries an LLVM vector as a numba value, so that the surrounding loop
stays plain Python. LLVM lowers `ctpop` and the saturating sums to the processor's instructions
(AVX-512, AVX2, NEON), as well as its hint that memory will be read soon, `prefetch`.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic, models, register_model

LANES, SHORTS, OCTETS = 8, 32, 64
"""Numbers in a vector of 64, 16 and 8 bits each: all are 512 bits."""
WORD = 64
"""Number of bits in a word."""
MAX_SHORT, MAX_OCTET = 2**16 - 1, 2**8 - 1
"""Greatest numbers in lanes of 16 bits, where `add_distances` stays, and of 8, which wrap."""
ARRAY = None
"""An argument that is an array of any kind of numbers, of which the body gets a pointer."""
_READ, _KEEP, _DATA = 0, 3, 1
"""Arguments of LLVM's `prefetch`: for reading, kept in all caches, data and not code."""


class SimdVectorType(types.Type):
    """numba's type of a vector."""

    def __init__(self, bits: int, lanes: int) -> None:
        self.llvm = ir.VectorType(ir.IntType(bits), lanes)
        super().__init__(name=f"u{bits}x{lanes}")


@register_model(SimdVectorType)
class SimdVectorModel(models.PrimitiveModel):
    """numba's memory model of a vector: the same as LLVM's."""

    def __init__(self, dmm: Any, fe_type: Any) -> None:
        super().__init__(dmm, fe_type, fe_type.llvm)


_WORDS, _SHORTS, _OCTETS = (
    SimdVectorType(64, LANES),
    SimdVectorType(16, SHORTS),
    SimdVectorType(8, OCTETS),
)
_WORD, _INDEX = types.uint64, types.intp


def kernel_operation(result_type: Any, *argument_kinds: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator that makes a kernel function of a body which calls LLVM's builder."""

    def decorate(body: Callable[..., Any]) -> Any:
        @functools.wraps(body)
        def type_operation(_: Any, *argument_types: Any) -> Any:
            def generate_code(context: Any, builder: Any, signature: Any, args: Any) -> Any:
                values = [
                    context.make_array(kind)(context, builder, value).data
                    if isinstance(kind, types.Array)
                    else value
                    for kind, value in zip(signature.args, args, strict=True)
                ]
                built = body(builder, *values)
                return context.get_dummy_value() if built is None else built

            resolved_types = [
                kind or argument_type
                for kind, argument_type in zip(argument_kinds, argument_types, strict=True)
            ]
            return result_type(*resolved_types), generate_code

        return intrinsic(type_operation)

    return decorate


def _get_aligned_pointer(builder: Any, array: Any, index: Any, kind: Any) -> tuple[Any, int]:
    """Return the pointer to an index of an array, and the alignment of the array's items."""
    pointer = builder.bitcast(builder.gep(array, [index]), kind.as_pointer())
    return pointer, array.type.pointee.width // 8


def _load(builder: Any, array: Any, index: Any, kind: Any) -> Any:
    """Load a vector at an index of an array."""
    pointer, align = _get_aligned_pointer(builder, array, index, kind)
    return builder.load(pointer, align=align)


def _store(builder: Any, value: Any, array: Any, index: Any) -> None:
    """Store a vector at an index of an array."""
    pointer, align = _get_aligned_pointer(builder, array, index, value.type)
    builder.store(value, pointer, align=align)


def _splat(builder: Any, value: Any, kind: Any) -> Any:
    """Return a vector with the same number in all lanes."""
    undefined = ir.Constant(kind, ir.Undefined)
    lane = builder.insert_element(undefined, value, ir.IntType(32)(0))
    first = ir.Constant(ir.VectorType(ir.IntType(32), kind.count), [0] * kind.count)
    return builder.shuffle_vector(lane, undefined, first)


def _call_llvm_intrinsic(builder: Any, name: str, *values: Any) -> Any:
    """Call an LLVM intrinsic whose arguments have the same type."""
    kind = values[0].type
    suffix = f"v{kind.count}i{kind.element.width}" if isinstance(kind, ir.VectorType) else kind
    function_type = ir.FunctionType(kind, [kind] * len(values))
    function = builder.module.declare_intrinsic(f"llvm.{name}.{suffix}", fnty=function_type)
    return builder.call(function, values)


def _pack_compared_lanes(builder: Any, predicate: str, values: Any, limits: Any) -> Any:
    """Return a word with a bit for each lane of `values` that fulfils the predicate."""
    lane_flags = builder.icmp_unsigned(predicate, values, limits)
    return builder.zext(builder.bitcast(lane_flags, ir.IntType(values.type.count)), ir.IntType(64))


def _min(builder: Any, a: Any, b: Any) -> Any:
    """Return the lane-by-lane minimum."""
    return builder.select(builder.icmp_unsigned("<", a, b), a, b)


def _make_zeros_operation(vector: SimdVectorType) -> Any:
    """Return a function that makes a vector of zeros."""

    def zeros(builder: Any) -> Any:
        return ir.Constant(vector.llvm, [0] * vector.llvm.count)

    return kernel_operation(vector)(zeros)


zeros, zero_shorts, zero_octets = (
    _make_zeros_operation(_WORDS),
    _make_zeros_operation(_SHORTS),
    _make_zeros_operation(_OCTETS),
)


@kernel_operation(_WORDS, _WORDS, _WORD, ARRAY, _INDEX)
def add_matches(builder: Any, counts: Any, word: Any, words: Any, index: Any) -> Any:
    """Return ``counts + popcount(word & words[index : index + 8])``, lane by lane."""
    common_bits = builder.and_(
        _splat(builder, word, _WORDS.llvm), _load(builder, words, index, _WORDS.llvm)
    )
    return builder.add(counts, _call_llvm_intrinsic(builder, "ctpop", common_bits))


@kernel_operation(_WORDS, _WORDS, ARRAY, _INDEX, _INDEX)
def add_difference(
    builder: Any, counts: Any, values: Any, index: Any, subtracted_index: Any
) -> Any:
    """Return ``counts + values[index : index + 8] - values[less : less + 8]`` for int64 values."""
    total = builder.add(counts, _load(builder, values, index, _WORDS.llvm))
    return builder.sub(total, _load(builder, values, subtracted_index, _WORDS.llvm))


@kernel_operation(types.void, _WORDS, ARRAY, _INDEX)
def store_negative(builder: Any, a: Any, target: Any, index: Any) -> None:
    """Set ``target[index : index + 8] = -a`` in an array of int64."""
    _store(builder, builder.neg(a), target, index)


def _make_add_operation(vector: SimdVectorType, bits: int) -> Any:
    """Return a function that adds a vector to an array of numbers of so many bits."""
    wide = ir.VectorType(ir.IntType(bits), vector.llvm.count)

    def add_vector(builder: Any, target: Any, index: Any, total: Any) -> None:
        sums = builder.add(_load(builder, target, index, wide), builder.zext(total, wide))
        _store(builder, sums, target, index)

    return kernel_operation(types.void, ARRAY, _INDEX, vector)(add_vector)


add_to = _make_add_operation(_WORDS, 64)
"""``target[index : index + 8] += total`` for an array of int64."""
add_shorts_to = _make_add_operation(_SHORTS, 32)
"""``target[index : index + 32] += total`` for an array of uint32."""
add_octets_to = _make_add_operation(_OCTETS, 16)
"""``target[index : index + 64] += total`` for an array of uint16."""


@kernel_operation(types.int64, _WORD)
def popcount(builder: Any, word: Any) -> Any:
    """Return the number of ones in a 64-bit word."""
    return _call_llvm_intrinsic(builder, "ctpop", word)


@kernel_operation(types.int64, _WORD)
def find_lowest_bit(builder: Any, word: Any) -> Any:
    """Return the index of the lowest set bit in a 64-bit word, which must not be 0."""
    return builder.cttz(word, ir.IntType(1)(1))


@kernel_operation(_WORD, ARRAY, _INDEX)
def load_word(builder: Any, octets: Any, index: Any) -> Any:
    """Return the 64-bit word at ``octets[index : index + 8]`` (any alignment), from uint8."""
    return _load(builder, octets, index, ir.IntType(64))


def _make_masked_compare_operation(predicate: str, against: int) -> Any:
    """Return a function that flags the lanes of bytes which fulfil a predicate."""

    def lanes(builder: Any, octets: Any, at: Any, flip: Any, masks: Any, first: Any) -> Any:
        words = _load(builder, octets, at, _WORDS.llvm)
        words = builder.xor(words, _splat(builder, flip, _WORDS.llvm))
        words = builder.and_(words, _load(builder, masks, first, _WORDS.llvm))
        return _pack_compared_lanes(
            builder, predicate, words, ir.Constant(_WORDS.llvm, [against] * LANES)
        )

    return kernel_operation(_WORD, ARRAY, _INDEX, _WORD, ARRAY, _INDEX)(lanes)


set_lanes = _make_masked_compare_operation("!=", 0)
"""``set_lanes(octets, at, flip, masks, first)``: one bit for each of the eight words from byte
`at` on of an array of uint8 for which ``(word ^ flip) & masks[first:]`` is not zero."""
full_lanes = _make_masked_compare_operation("==", 2**64 - 1)
"""Variant of `set_lanes` with one bit for each word for which that value is all ones."""


@kernel_operation(_SHORTS, _SHORTS, ARRAY, _INDEX)
def add_shorts(builder: Any, total: Any, values: Any, index: Any) -> Any:
    """Return ``total + values[index : index + 32]`` of an array of uint16, lane by lane."""
    return builder.add(total, _load(builder, values, index, _SHORTS.llvm))


@kernel_operation(_SHORTS, _SHORTS, ARRAY, _INDEX, types.uint16, types.uint16)
def add_distances(builder: Any, total: Any, counts: Any, index: Any, value: Any, shift: Any) -> Any:
    """Return ``total + (abs(counts[index : index + 32] - value) >> shift)``, saturating.

    A sum that reaches `MAX_SHORT` stays there, so that "more than a limit" remains right for any
    number of terms.
    """
    count_lanes = _load(builder, counts, index, _SHORTS.llvm)
    value_lanes = _splat(builder, value, _SHORTS.llvm)
    above, below = (
        _call_llvm_intrinsic(builder, "usub.sat", count_lanes, value_lanes),
        _call_llvm_intrinsic(builder, "usub.sat", value_lanes, count_lanes),
    )
    distances = builder.lshr(builder.or_(above, below), _splat(builder, shift, _SHORTS.llvm))
    return _call_llvm_intrinsic(builder, "uadd.sat", total, distances)


@kernel_operation(_WORD, _SHORTS, types.uint16)
def flag_small_lanes(builder: Any, total: Any, limit: Any) -> Any:
    """Return one bit for each lane of `total` that is at most `limit`."""
    return _pack_compared_lanes(builder, "<=", total, _splat(builder, limit, _SHORTS.llvm))


@kernel_operation(_OCTETS, _OCTETS, ARRAY, _INDEX, types.uint8, types.uint8)
def add_gaps(
    builder: Any, total: Any, codes: Any, index: Any, reference_code: Any, max_gap: Any
) -> Any:
    """Return ``total + min(gap, max_gap)`` with the gaps of ``codes[index : index + 64]``.

    Codes are counted modulo 256, so that a gap is the shorter way round. The caller ensures that no
    sum exceeds `MAX_OCTET`.
    """
    array_codes = _load(builder, codes, index, _OCTETS.llvm)
    reference = _splat(builder, reference_code, _OCTETS.llvm)
    gap = _min(builder, builder.sub(array_codes, reference), builder.sub(reference, array_codes))
    return builder.add(total, _min(builder, gap, _splat(builder, max_gap, _OCTETS.llvm)))


def _make_compare_operation(predicate: str, bits: int, lanes: int) -> Any:
    """Return a function that flags the lanes of an array which fulfil a predicate."""
    vector = ir.VectorType(ir.IntType(bits), lanes)

    def compare_lanes(builder: Any, values: Any, index: Any, limit: Any) -> Any:
        limits = _splat(builder, limit, vector)
        return _pack_compared_lanes(
            builder, predicate, _load(builder, values, index, vector), limits
        )

    return kernel_operation(_WORD, ARRAY, _INDEX, types.Integer.from_bitwidth(bits, False))(
        compare_lanes
    )


lanes_at_most = _make_compare_operation("<=", 32, SHORTS)
"""``lanes_at_most(values, index, limit)``: one bit for each of ``values[index : index + 32]`` of an
array of uint32 up to `limit`."""
lanes_below = _make_compare_operation("<", 16, OCTETS)
"""``lanes_below(values, index, limit)``: one bit for each of ``values[index : index + 64]`` of an
array of uint16 below `limit`."""


@kernel_operation(types.void, ARRAY, _INDEX)
def prefetch(builder: Any, array: Any, index: Any) -> None:
    """Prefetch the memory line of ``array[index]``; any index is safe."""
    byte, word = ir.IntType(8).as_pointer(), ir.IntType(32)
    function_type = ir.FunctionType(ir.VoidType(), [byte, word, word, word])
    function = builder.module.declare_intrinsic("llvm.prefetch", [byte], function_type)
    address = builder.bitcast(builder.gep(array, [index]), byte)
    builder.call(function, [address, *map(word, (_READ, _KEEP, _DATA))])
