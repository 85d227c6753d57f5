"""What one core of this machine can do: memory bandwidth and fused multiply-adds, measured with the same compiler."""

from __future__ import annotations

import time

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

from bspline_mdao.base.numerics.simd import LANES, VECTOR, Emitter

N_CHAINS = 16
"""Independent chains of multiply-adds, which hide the latency of one."""


@njit(cache=True, fastmath=True)
def _triad(a, b, c):
    for i in range(a.size):
        a[i] = b[i] + 3.0 * c[i]


class Triad:
    """STREAM triad ``a = b + s c`` on arrays beyond all caches; 24 bytes per element, as STREAM counts them."""

    def __init__(self, size: int = 8_000_000):
        self.arrays = np.ones((3, size))

    def __call__(self):
        """Run it once."""
        _triad(*self.arrays)

    @property
    def n_bytes(self) -> int:
        """Bytes of one run."""
        return self.arrays.nbytes


@intrinsic
def _multiply_add(typingctx, n, start):
    """Run ``n`` rounds of multiply-adds on vectors, `N_CHAINS` chains at a time; returns one of the results."""

    def codegen(context, builder, signature, args):
        emit = Emitter(builder)
        chains = [emit.variable() for _ in range(N_CHAINS)]
        factor, term = (ir.Constant(VECTOR, [value] * LANES) for value in (0.999, 0.001))
        for m, chain in enumerate(chains):
            first = builder.fadd(args[1], ir.Constant(ir.DoubleType(), float(m)))
            builder.store(builder.insert_element(ir.Constant(VECTOR, [0.0] * LANES), first, ir.IntType(32)(0)), chain)
        with emit.loop(args[0], 1):
            for chain in chains:
                builder.store(emit.add(emit.multiply(builder.load(chain), factor), term), chain)
        total = builder.load(chains[0])
        for chain in chains[1:]:
            total = emit.add(total, builder.load(chain))
        return emit.lane(emit.lane_sums([total])[0], 0)

    return types.float64(n, start), codegen


@njit(cache=True)
def _multiply_adds(n):
    return _multiply_add(n, 1.0)


class MultiplyAdds:
    """Fused multiply-adds on registers."""

    def __init__(self, n_rounds: int = 1_000_000):
        self.n_rounds = n_rounds

    def __call__(self):
        """Run them once."""
        return _multiply_adds(self.n_rounds)

    @property
    def count(self) -> int:
        """Multiply-adds of one run."""
        return self.n_rounds * N_CHAINS * LANES


def rate(work, amount: float, repeats: int = 10) -> float:
    """Largest rate of several runs of `Triad` or `MultiplyAdds`: the amount of one by its seconds."""
    work()
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - start)
    return amount / min(seconds)


def bandwidth() -> float:
    """Memory bandwidth of one core (bytes a second), by STREAM's triad."""
    triad = Triad()
    return rate(triad, triad.n_bytes)


if __name__ == "__main__":
    print(f"{bandwidth() / 1e9:.1f} GB/s")
    print(f"{rate(MultiplyAdds(), MultiplyAdds().count) / 1e9:.1f} GFMA/s")
