"""A real transform along x and back, by pyFFTW as the solver does it and by scipy.fft, at sizes of runs; one core.

Both answers are checked against each other, and going there and back against doing nothing.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import sys

import numpy as np
import scipy.fft

from benchmarks.timing import best
from kinetic_solver.arrays import Array
from kinetic_solver.operators.fourier import RealTransform

SIZES = ((49, 29), (125, 39), (243, 374), (343, 78), (1001, 64), (2401, 202))
"""nx × nv: of an easy scene, of scenes/pipe.toml, and of hard cases (docs/accuracy.md)."""


def by_scipy(f: Array) -> Array:
    return np.asarray(scipy.fft.irfft(scipy.fft.rfft(f, axis=0, workers=1), n=f.shape[0], axis=0, workers=1))


def main() -> int:
    failed = False
    print("   nx ×   nv   pyFFTW, ms   scipy.fft, ms   ratio   largest difference")
    for nx, nv in SIZES:
        f = np.random.default_rng(nx).normal(size=(nx, nv))
        transform = RealTransform(nx, nv)

        def by_fftw(f: Array = f, transform: RealTransform = transform) -> Array:
            transform.forward(f)
            return transform.inverse()

        spectrum = transform.forward(f).copy()
        difference = float(np.abs(spectrum - scipy.fft.rfft(f, axis=0)).max() / np.abs(spectrum).max())
        back = max(float(np.abs(way(f) - f).max()) for way in (lambda f: by_fftw(f), by_scipy))
        failed |= difference > 1e-14 or back > 1e-13
        ours = min(best(by_fftw, 15) for _ in range(5))
        theirs = min(best(lambda f=f: by_scipy(f), 15) for _ in range(5))
        print(f"{nx:5} × {nv:4} {ours * 1e3:12.3f} {theirs * 1e3:15.3f} {theirs / ours:7.2f} {max(difference, back):20.0e}")
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
