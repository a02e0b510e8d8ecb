"""Real Fourier transforms along x (axis 0): the one module that imports pyfftw.

Plans are made with FFTW_ESTIMATE, which depends on the shape alone: the same input gives the same bits in every process
(measured plans do not). One thread each; the caller parallelises over other axes if it wants to.
"""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinetic_solver.arrays import Array


def derivative(field: Array, k: Array) -> Array:
    """∂/∂x along axis 0 of a periodic field of any rank; its sum over x vanishes. k: `PhaseSpaceGrid.wavenumbers` of the grid.

    The derivative of the Nyquist cosine (even nx) vanishes on the grid.
    """
    n = field.shape[0]
    factor = 1j * k
    if n % 2 == 0:
        factor[-1] = 0.0
    return np.fft.irfft(factor.reshape(-1, *[1] * (field.ndim - 1)) * np.fft.rfft(field, axis=0), n=n, axis=0)


def integral_spectrum(field: Array, k: Array) -> NDArray[np.complex128]:
    """rfft of the periodic antiderivative of field - mean(field), of mean 0; shape (nx//2 + 1,)."""
    spectrum = np.fft.rfft(field)
    spectrum[0] = 0.0
    spectrum[1:] /= 1j * k[1:]
    return spectrum


def relative_amplitudes(f: Array, axis: int = 0) -> Array:
    """The largest amplitude of each wave along `axis`, whatever the other indices, over the largest of all waves' amplitudes.

    f has any rank and is periodic along `axis`, with n points; shape (n//2 + 1,). This says how well the points resolve f: what a
    smooth f has in its shortest waves is the error of having no shorter ones. Test: tests/invariants/test_fourier.py.
    """
    others = tuple(i for i in range(f.ndim) if i != axis % f.ndim)
    amplitude = np.abs(np.fft.rfft(f, axis=axis)).max(axis=others)
    return np.asarray(amplitude / amplitude.max())


class RealTransform:
    """Forward and inverse transform along axis 0 of arrays of shape (nx, columns), with buffers of its own.

    `forward` returns a view of an internal buffer of shape (nx//2 + 1, columns), to be changed in place; `inverse`
    transforms what that buffer holds and returns a new array. Not thread-safe.
    """

    def __init__(self, nx: int, columns: int) -> None:
        pyfftw = _pyfftw()
        self._real = pyfftw.empty_aligned((nx, columns), dtype="float64")
        self.spectrum = pyfftw.empty_aligned((nx // 2 + 1, columns), dtype="complex128")
        flags = ("FFTW_ESTIMATE",)
        self._forward: Callable[[], Any] = pyfftw.FFTW(self._real, self.spectrum, axes=(0,), flags=flags)
        backward = pyfftw.FFTW(self.spectrum, self._real, axes=(0,), direction="FFTW_BACKWARD", flags=flags)
        self._inverse: Callable[[], Any] = functools.partial(backward, normalise_idft=False)

    def forward(self, f: Array) -> NDArray[np.complex128]:
        """The spectrum of f, in the buffer."""
        self._real[:] = f
        self._forward()
        return self.spectrum

    def inverse(self) -> Array:
        """What has the buffer's spectrum; a new array."""
        self._inverse()
        # Divided, not multiplied by the rounded 1/nx, whose error would add up: 1e-16 of the mass with every transform.
        return self._real / self._real.shape[0]


@functools.cache
def _pyfftw() -> Any:
    # pyfftw loads scipy.fftpack, and with it most of SciPy, and dask.array, to offer stand-ins that nothing here uses: a fifth of
    # the start-up of a run of (6). Where they are not installed it does without; a module that is None is not there.
    absent = [name for name in ("scipy.fftpack", "dask.array.fft") if name not in sys.modules]
    sys.modules.update(dict.fromkeys(absent))  # type: ignore[arg-type]
    try:
        import pyfftw
    finally:
        for name in absent:
            del sys.modules[name]
    return pyfftw
