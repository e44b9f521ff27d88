"""A hint to the processor that memory will be read soon."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

_READ, _KEEP, _DATA = 0, 3, 1
"""Arguments of LLVM's `prefetch`: for reading, kept in all caches, data and not code."""


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
