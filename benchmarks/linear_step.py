"""Where the exact linear step spends its time, against matrix products and memory; one core.

Checks the step against its definition, phase by phase in NumPy, before it times it.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import math
import sys

import numpy as np

from benchmarks.collision_operator import machine
from benchmarks.timing import best
from kinetic_solver.grid import PhaseSpaceGrid
from kinetic_solver.operators.fourier import RealTransform
from kinetic_solver.operators.linear import LinearStep
from kinetic_solver.operators.velocity import OrnsteinUhlenbeckKernel
from kinetic_solver.scene import Model

H = 0.05


def definition(f: np.ndarray, grid: PhaseSpaceGrid, model: Model) -> np.ndarray:
    tau = math.tanh(model.friction * H / 2) / model.friction
    k = grid.wavenumbers[:, None]
    rest = H - 2 * tau
    uniform = np.exp(-1j * k * model.gravity / model.friction * rest - k**2 * model.noise / model.friction * rest)
    shift = np.exp(-1j * k * tau * grid.v)
    spectrum = (np.fft.rfft(f, axis=0) * shift) @ OrnsteinUhlenbeckKernel(grid, model).matrix(H).T
    return np.fft.irfft(spectrum * shift * uniform, n=grid.nx, axis=0)


def main() -> int:
    model = Model(gravity=1.3, friction=0.7, noise=0.9)
    gemm, _, memory = machine()
    print(f"one core: {gemm:.1f} GFlop/s in matrix products, {memory:.1f} GB/s from memory")
    print("  nx ×   nv   error     step, ms   transforms   product   phases, copies   product, GFlop/s   transforms, GFlop/s")
    failed = False
    for nx, nv in ((63, 128), (125, 183), (243, 374), (243, 729)):
        grid = PhaseSpaceGrid(nx, nv, 8 * math.pi, -8.0, 10.0)
        f = (1 + 0.5 * np.cos(grid.wavenumbers[1] * grid.x))[:, None] * np.exp(-((grid.v - 1) ** 2))
        step = LinearStep(grid, model, OrnsteinUhlenbeckKernel(grid, model))
        expected = definition(f, grid, model)
        error = np.abs(step(f, H) - expected).max() / expected.max()
        failed |= error > 1e-13
        whole = best(lambda step=step, f=f: step(f, H))
        transform = RealTransform(nx, nv)
        transforms = best(lambda t=transform, f=f: (t.forward(f), t.inverse()))
        kernel = np.ascontiguousarray(OrnsteinUhlenbeckKernel(grid, model).matrix(H).T)
        parts = np.concatenate([transform.spectrum.real, transform.spectrum.imag])
        product = best(lambda parts=parts, kernel=kernel: parts @ kernel)
        fft_flops = 2 * 2.5 * nx * nv * math.log2(nx)
        print(
            f"{nx:4} × {nv:4}   {error:.0e} {whole * 1e3:10.3f} {transforms / whole:11.0%} {product / whole:11.0%}"
            f" {1 - (transforms + product) / whole:13.0%} {2 * len(parts) * nv**2 / product / 1e9:17.1f}"
            f" {fft_flops / transforms / 1e9:20.1f}"
        )
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
