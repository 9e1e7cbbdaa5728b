r"""Random rough ground from a power spectral density, as an isotropic surface.

A road or field profile is described by its one-sided displacement PSD over the spatial frequency n (cycles/m),

    G_d(n) = G_d(n0) (n / n0)^-w,    n0 = 0.1 cycles/m    (ISO 8608).

We want a *surface* h(x, y) whose profile along any straight line has that PSD. Let S2(nx, ny) be the two-sided
two-dimensional PSD, so that the variance is the integral of S2 over the whole plane. The two-sided PSD of the profile
along x is the integral over the cross wave number, and the one-sided one is twice that:

    G_d(nx) = 2 \int S2(sqrt(nx^2 + ny^2)) dny.

With S2 = A n^-(w+1), n = sqrt(nx^2 + ny^2), the integral is A nx^-w sqrt(pi) Gamma(w/2) / Gamma((w+1)/2), hence

    A = G_d(n0) n0^w Gamma((w+1)/2) / (2 sqrt(pi) Gamma(w/2)).

The surface carries the waves between two limits, n1 <= n <= n2, whatever their direction. A profile therefore has
exactly G_d from n1 up to where the missing waves beyond n2 begin to be felt (for w = 2 by the factor
sqrt(1 - (nx/n2)^2)), and also sees, below n1, waves that it crosses at an angle. No isotropic surface avoids that:
a profile PSD that falls towards lower frequencies would need a negative S2.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

REFERENCE_CYCLES_M = 0.1
"""n0 of ISO 8608, cycles/m."""


def profile_psd_m3(cycles_m: FloatArray, *, psd_m3: float, waviness: float) -> FloatArray:
    """One-sided displacement PSD G_d(n) of a profile, m^3."""
    return np.asarray(psd_m3 * (cycles_m / REFERENCE_CYCLES_M) ** -waviness, dtype=np.float64)


def surface_coefficient(*, psd_m3: float, waviness: float) -> float:
    """A of the surface PSD S2 = A n^-(w+1) whose profiles have G_d (module docstring)."""
    gammas = math.gamma((waviness + 1.0) / 2.0) / math.gamma(waviness / 2.0)
    return float(psd_m3 * REFERENCE_CYCLES_M**waviness * gammas / (2.0 * math.sqrt(math.pi)))


def surface_variance_m2(*, psd_m3: float, waviness: float, band_cycles_m: tuple[float, float]) -> float:
    """Variance of the surface: the integral of 2 pi n S2(n) over the band, m^2."""
    low, high = band_cycles_m
    coefficient = 2.0 * math.pi * surface_coefficient(psd_m3=psd_m3, waviness=waviness)
    power = 1.0 - waviness
    if abs(power) < 1e-9:
        return coefficient * math.log(high / low)
    return float(coefficient * (high**power - low**power) / power)


def rough_surface(
    generator: np.random.Generator,
    *,
    shape: tuple[int, int],
    cell_m: float,
    psd_m3: float,
    waviness: float,
    band_cycles_m: tuple[float, float],
) -> FloatArray:
    """Draw a surface of ``shape`` (rows along y, columns along x), m.

    White noise of unit variance on a grid has the two-sided PSD cell^2; it is filtered by sqrt(S2) / cell. The
    transform is periodic, so the surface is cut from a larger one.
    """
    padded = tuple(_fast_length(size) for size in shape)
    spectrum = np.fft.rfft2(generator.standard_normal(padded))
    along_y = np.fft.fftfreq(padded[0], cell_m)[:, np.newaxis]
    n = np.hypot(along_y, np.fft.rfftfreq(padded[1], cell_m)[np.newaxis, :])
    inside = (n >= band_cycles_m[0]) & (n <= band_cycles_m[1])
    coefficient = surface_coefficient(psd_m3=psd_m3, waviness=waviness)
    gain = np.zeros_like(n)
    gain[inside] = math.sqrt(coefficient) / cell_m * n[inside] ** (-0.5 * (waviness + 1.0))
    spectrum *= gain
    surface = np.fft.irfft2(spectrum, s=padded, axes=(0, 1))
    return np.ascontiguousarray(surface[: shape[0], : shape[1]])


def _fast_length(size: int) -> int:
    """Smallest even product of 2, 3 and 5 that is at least ``size``: lengths a Fourier transform is fast at."""
    candidate = size + size % 2
    while True:
        rest = candidate
        for factor in (2, 3, 5):
            while rest % factor == 0:
                rest //= factor
        if rest == 1:
            return candidate
        candidate += 2
