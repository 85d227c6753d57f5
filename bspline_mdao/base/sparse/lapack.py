"""SciPy's BLAS and LAPACK, callable from compiled kernels that hold no lock and are cached on disk.

A kernel that refers to a function by its address cannot be cached between processes. Here the address is an ordinary
number passed to the kernel; `call` turns it into a call of a Fortran routine.

Theory: ``docs/theory/sparse.rst``.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.linalg.cython_blas
import scipy.linalg.cython_lapack  # noqa: F401
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.base import BaseContext
from numba.core.typing import Signature
from numba.extending import get_cython_function_address, intrinsic
from numpy.typing import DTypeLike

__all__ = [
    "LEFT",
    "LOWER",
    "NOT_TRANSPOSED",
    "NOT_UNIT",
    "RIGHT",
    "TRANSPOSED",
    "Routines",
    "call",
    "routines",
]

LOWER, NOT_UNIT, LEFT, RIGHT, TRANSPOSED, NOT_TRANSPOSED = (np.uint8(ord(letter)) for letter in "LNLRTN")


class Routines(NamedTuple):
    """Addresses of the routines for a Cholesky factorisation."""

    potrf: int
    trsm: int
    syrk: int
    gemm: int
    trsv: int
    gemv: int


@functools.cache  # looked up once: a small substitution takes no longer than the look-up
def routines(dtype: DTypeLike) -> Routines:
    """Routines for real numbers of a precision, single or double."""
    letter = "s" if np.dtype(dtype) == np.float32 else "d"
    potrf = get_cython_function_address("scipy.linalg.cython_lapack", f"{letter}potrf")
    names = ("trsm", "syrk", "gemm", "trsv", "gemv")
    others = [get_cython_function_address("scipy.linalg.cython_blas", letter + name) for name in names]
    return Routines(potrf, *others)


@intrinsic
def call(typing_context, address, arguments):
    """Call the Fortran routine at an address: ``call(address, (LOWER, n, array, n, info))``."""
    # Everything is passed by reference: numpy characters (uint8), integers (as 32-bit ones), real numbers, and arrays,
    # as the address of the first entry.
    signature = types.void(types.intp, arguments)

    def generate(
        context: BaseContext, builder: ir.IRBuilder, signature: Signature, values: Sequence[ir.Value]
    ) -> ir.Value:
        pointers = [
            _reference(context, builder, kind, builder.extract_value(values[1], place))
            for place, kind in enumerate(signature.args[1].types)
        ]
        function_type = ir.FunctionType(ir.VoidType(), [pointer.type for pointer in pointers])
        builder.call(builder.inttoptr(values[0], function_type.as_pointer()), pointers)
        return context.get_dummy_value()

    return signature, generate


def _reference(context: BaseContext, builder: ir.IRBuilder, kind: types.Type, value: ir.Value) -> ir.Value:
    """Pointer to an argument of a Fortran routine."""
    if isinstance(kind, types.Array):
        return context.make_array(kind)(context, builder, value).data
    if isinstance(kind, types.Integer) and kind.bitwidth > 8:
        value = builder.trunc(value, ir.IntType(32)) if kind.bitwidth > 32 else value
    return cgutils.alloca_once_value(builder, value)
