"""Fields, errors and fluctuation spectra of particles, against direct sums and ensembles whose statistics are known."""

from __future__ import annotations

import math
from itertools import pairwise

import numba
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.special import erf

from kinetic_solver.arrays import Array
from particles.estimators import (
    Complex,
    Sample,
    Sampler,
    density_modes,
    fields,
    frequency_spectrum,
    pair_correlation,
    structure_factor,
)

LENGTH = 9.0
K = 2 * math.pi / LENGTH


def centres(low: float, high: float, nv: int) -> Array:
    return low + (high - low) / nv * (np.arange(nv) + 0.5)


def particles(count: int, seed: int) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    return LENGTH * rng.random(count), rng.normal(0.4, 0.8, count)


def direct(x: Array, v: Array, weight: float, modes: int, faces: Array) -> tuple[Complex, Complex]:
    """The definitions of `Sample`, summed in extended precision."""
    k = 2 * np.arccos(np.longdouble(-1)) / np.longdouble(LENGTH) * np.arange(modes + 1)
    phase = np.multiply.outer(k, x.astype(np.longdouble))
    wave = np.cos(phase) - 1j * np.sin(phase)
    middle = (faces[0] + faces[-1]) / 2
    moments = np.array([(wave * (v - middle) ** p).sum(axis=1) for p in range(4)])
    bins = [wave[:, (v >= low) & (v < high)].sum(axis=1) for low, high in pairwise(faces)]
    scale = weight / LENGTH
    return (scale * moments).astype(complex), (scale / np.diff(faces) * np.array(bins).T).astype(complex)


@pytest.mark.parametrize(("nx", "nv"), [(1, 6), (2, 6), (8, 9), (65, 24), (401, 10)])
def test_sums(nx: int, nv: int) -> None:
    weight, faces = 0.3, np.linspace(-1.1, 1.7, nv + 1)
    x, v = particles(1500, seed=1)
    x[:3] = -0.7, LENGTH, 31.0
    sample = Sampler(LENGTH, nx, centres(-1.1, 1.7, nv), weight).sample(x, v)
    assert sample.middle == pytest.approx(0.3, abs=1e-15)
    modes, f_modes = direct(x, v, weight, (nx - 1) // 2, faces)
    assert sample.modes.shape == (4, (nx - 1) // 2 + 1)
    assert sample.f_modes.shape == ((nx - 1) // 2 + 1, nv)
    scale = weight / LENGTH * np.array([np.abs((v - 0.3) ** p).sum() for p in range(4)])
    assert (np.abs(sample.modes - modes) < 1e-12 * scale[:, None]).all()
    assert np.abs(sample.f_modes - f_modes).max() < 1e-12 * f_modes[0].real.max()
    assert sample.outside == np.sum((v < -1.1) | (v >= 1.7)) > 50


def test_far_from_rest() -> None:
    """θ and q keep their digits at a mean velocity 10⁷ times the thermal one; u, momentum and energy are about rest."""
    x, v = particles(3000, seed=6)
    nv, boost = centres(-4.0, 4.0, 32), 2.0**24
    near, far = (
        fields([Sampler(LENGTH, 9, nv + u, 0.3).sample(x, v + u) for _ in range(2)], LENGTH, 9, nv + u) for u in (0.0, boost)
    )
    rounding = 2.0**24 * 2.0**-52 * 10
    for name in ("density", "temperature", "heat_flux", "velocity_distribution"):
        assert far[name] == pytest.approx(near[name], rel=1e-9, abs=rounding), name
    assert far["mean_velocity"] - boost == pytest.approx(near["mean_velocity"], abs=rounding)
    mass, momentum, energy = (near[name] for name in ("mass", "momentum", "energy"))
    assert far["momentum"] == pytest.approx(momentum + boost * mass, rel=1e-14)
    assert far["energy"] == pytest.approx(energy + boost * momentum + boost**2 / 2 * mass, rel=1e-14)


def test_a_sampler_forgets_and_takes_few_particles() -> None:
    x, v = particles(2000, seed=2)
    sampler = Sampler(LENGTH, 21, centres(-2.3, 3.1, 12), 0.3)
    first = sampler.sample(x, v)
    few = sampler.sample(x[:5], v[:5])
    again = sampler.sample(x, v)
    assert np.array_equal(first.modes, again.modes)
    assert np.array_equal(first.f_modes, again.f_modes)
    assert few.modes[0, 0] == pytest.approx(5 * 0.3 / LENGTH, rel=1e-15)


def test_bits_do_not_depend_on_threads() -> None:
    x, v = particles(30_001, seed=3)
    before = numba.get_num_threads()
    results = []
    try:
        for threads in sorted({1, numba.config.NUMBA_NUM_THREADS}):
            numba.set_num_threads(threads)
            results.append(Sampler(LENGTH, 33, centres(-1.3, 2.1, 16), 0.3).sample(x, v))
    finally:
        numba.set_num_threads(before)
    for other in results[1:]:
        assert np.array_equal(results[0].modes, other.modes)
        assert np.array_equal(results[0].f_modes, other.f_modes)
        assert results[0].outside == other.outside


def test_memory() -> None:
    """80 MB of accumulators, however many modes and bins."""
    for nx, nv in ((65, 64), (201, 256), (801, 1024)):
        sampler = Sampler(LENGTH, nx, centres(-2.3, 3.1, nv), 0.3)
        assert sampler._bins.nbytes + sampler._modes.nbytes <= 80e6


def maxwellian_averages(faces: Array, mean: Array, variance: Array) -> Array:
    """Averages of a unit Maxwellian over the cells between `faces`, exactly; mean and variance of any shape, cells last."""
    cumulative = erf((faces - mean[..., None]) / np.sqrt(2 * variance[..., None])) / 2
    return np.diff(cumulative, axis=-1) / np.diff(faces)


def test_point_values_in_v_are_of_fourth_order() -> None:
    """Bin averages of a Maxwellian leave -(3/640) dv⁴ f'''' in f and w(v): of order 4 from both sides, and after it order 6."""
    density, mean, variance = 0.7, 0.4, 0.6
    modes = density * np.array([[1.0], [mean], [variance + mean**2], [mean**3 + 3 * mean * variance]], dtype=complex)

    def errors(nv: int) -> tuple[float, float]:
        faces, v = np.linspace(-6.0, 6.8, nv + 1), centres(-6.0, 6.8, nv)
        f_modes = density * maxwellian_averages(faces, np.array(mean), np.array(variance))[None].astype(complex)
        found = fields([Sample(modes, f_modes, 0)] * 2, LENGTH, 1, v)
        y2 = (v - mean) ** 2 / variance
        f = density * np.exp(-y2 / 2) / math.sqrt(2 * math.pi * variance)
        leading = -3 / 640 * (v[1] - v[0]) ** 4 * f * (y2**2 - 6 * y2 + 3) / variance**2
        assert found["velocity_distribution"] == pytest.approx(LENGTH * found["f"][0], rel=1e-14)
        assert found["temperature"] == pytest.approx(variance, rel=1e-14)
        assert found["heat_flux"] == pytest.approx(0.0, abs=1e-15)
        wrong = found["f"][0] - f
        return float(np.abs(wrong).max()), float(np.abs(wrong - leading).max())

    found = np.array([errors(nv) for nv in (80, 160, 320)])
    orders = np.log2(found[:-1] / found[1:])
    assert np.abs(orders[:, 0] - 4).max() < 0.05
    assert np.abs(orders[:, 1] - 6).max() < 0.1


DENSITY, MEAN, THETA = 0.7, 0.4, 0.6
FACES = np.linspace(-3.6, 4.4, 21)
V = centres(-3.6, 4.4, 20)
NX = 25


def true_velocity(x: Array) -> Array:
    return MEAN + 0.25 * np.sin(2 * K * x)


def true_temperature(x: Array) -> Array:
    return THETA * (1 + 0.3 * np.cos(K * x))


def inhomogeneous(rng: np.random.Generator, count: int) -> tuple[Array, Array]:
    """Independent particles of density 1 + 0.5 cos kx, Maxwellian about u(x) with variance θ(x)."""
    tries = LENGTH * rng.random(3 * count)
    x = tries[1.5 * rng.random(tries.size) < 1 + 0.5 * np.cos(K * tries)][:count]
    assert x.size == count
    return x, true_velocity(x) + np.sqrt(true_temperature(x)) * rng.normal(size=count)


def exact_fields() -> dict[str, Array]:
    """Of `inhomogeneous`: trigonometric polynomials, and f's cell averages cut off after M and made points as `fields` does."""
    x = LENGTH * np.arange(NX) / NX
    fine = LENGTH * np.arange(8 * NX) / (8 * NX)
    rho = DENSITY * (1 + 0.5 * np.cos(K * fine))
    averages = rho[:, None] * maxwellian_averages(FACES, true_velocity(fine), true_temperature(fine))
    cut = np.fft.rfft(averages, axis=0, norm="forward")[: (NX + 1) // 2]
    f = np.fft.irfft(cut, n=NX, axis=0, norm="forward")
    f[:, 1:-1] = (26 * f[:, 1:-1] - f[:, :-2] - f[:, 2:]) / 24
    w = LENGTH * averages.mean(axis=0)
    w[1:-1] = (26 * w[1:-1] - w[:-2] - w[2:]) / 24
    momentum, energy = (rho * true_velocity(fine)), rho * (true_velocity(fine) ** 2 + true_temperature(fine)) / 2
    return {
        "f": f,
        "density": DENSITY * (1 + 0.5 * np.cos(K * x)),
        "mean_velocity": true_velocity(x),
        "temperature": true_temperature(x),
        "velocity_distribution": w,
        "momentum": np.array(LENGTH * momentum.mean()),
        "energy": np.array(LENGTH * energy.mean()),
    }


def test_unbiased_with_true_errors() -> None:
    """40 replicas, 12 times over: each field's z-scores have the mean square (40 - 1)/(40 - 3) of Student's distribution."""
    count, replicas, trials = 8000, 40, 12
    rng = np.random.default_rng(4)
    sampler = Sampler(LENGTH, NX, V, DENSITY * LENGTH / count)
    exact = exact_fields()
    z: dict[str, list[Array]] = {name: [] for name in exact}
    heat = []
    for _ in range(trials):
        found = fields([sampler.sample(*inhomogeneous(rng, count)) for _ in range(replicas)], LENGTH, NX, V)
        assert found["mass"] == pytest.approx(DENSITY * LENGTH, rel=1e-13)
        assert found["mass_stderr"] < 1e-13
        heat.append(found["heat_flux"])
        for name, values in exact.items():
            wrong, error = found[name] - values, found[f"{name}_stderr"]
            if name in ("f", "velocity_distribution"):  # far out a bin holds too few particles for a normal error
                wrong, error = wrong[..., np.abs(V - MEAN) < 1.7], error[..., np.abs(V - MEAN) < 1.7]
            z[name].append(wrong / error)
    expected = (replicas - 1) / (replicas - 3)
    for name, scores in z.items():
        values = np.ravel(scores)
        # E z⁴ = 3 + 6/(ν - 4) in the units of the variance; bins and points are all but independent
        scatter = expected * math.sqrt((2 + 6 / (replicas - 5)) / values.size)
        assert abs((values**2).mean() - expected) < 4 * scatter, name
        assert abs(values.mean()) < 4 / math.sqrt(values.size), name
    flux = np.array(heat)  # none in a local Maxwellian; 12 trials give its error a wide Student's distribution
    assert (np.abs(flux.mean(axis=0)) < 6 * flux.std(axis=0, ddof=1) / math.sqrt(trials)).all()


def test_moments_of_f_are_those_of_the_particles() -> None:
    """Nothing outside, nobody in the outermost bins: the sum of f over v is the density, and over both the mass, to round-off."""
    x, v = particles(4000, seed=5)
    points = centres(-5.1, 5.9, 30)
    found = fields([Sampler(LENGTH, NX, points, 0.3).sample(x, v)], LENGTH, NX, points)
    dv = points[1] - points[0]
    assert found["f"].sum(axis=1) * dv == pytest.approx(found["density"], rel=1e-11)
    assert found["f"].mean(axis=0) * LENGTH == pytest.approx(found["velocity_distribution"], abs=1e-11)
    assert found["mass"] == pytest.approx(4000 * 0.3, rel=1e-13)
    assert found["momentum"] == pytest.approx(0.3 * v.sum(), rel=1e-12)
    assert found["energy"] == pytest.approx(0.15 * (v**2).sum(), rel=1e-12)
    for name in ("f", "density", "mean_velocity", "temperature", "velocity_distribution", "mass", "momentum", "energy"):
        assert found[f"{name}_stderr"].shape == found[name].shape
        assert np.isnan(found[f"{name}_stderr"]).all()


def test_two_replicas() -> None:
    """The mean of two, with half their difference for its error; u and θ of both together, not the mean of theirs."""
    sampler = Sampler(LENGTH, 7, V, 0.3)
    samples = [sampler.sample(*particles(count, seed)) for count, seed in ((900, 14), (500, 15))]
    one, two = (fields([sample], LENGTH, 7, V) for sample in samples)
    both = fields(samples, LENGTH, 7, V)
    for name in ("f", "density", "velocity_distribution", "mass", "momentum", "energy"):
        assert both[name] == pytest.approx((one[name] + two[name]) / 2, rel=1e-12, abs=1e-14), name
        assert both[f"{name}_stderr"] == pytest.approx(np.abs(one[name] - two[name]) / 2, rel=1e-10, abs=1e-14), name
    weights = np.array([one["density"], two["density"]]) / (one["density"] + two["density"])
    u = weights[0] * one["mean_velocity"] + weights[1] * two["mean_velocity"]
    between = weights.prod(axis=0) * (one["mean_velocity"] - two["mean_velocity"]) ** 2
    assert both["mean_velocity"] == pytest.approx(u, rel=1e-12)
    assert both["temperature"] == pytest.approx(
        weights[0] * one["temperature"] + weights[1] * two["temperature"] + between, rel=1e-12
    )


def test_homogeneous_moments_are_the_sample_moments() -> None:
    """nx = 1: the particles' own mean, variance and third central moment, which NumPy takes in two passes."""
    _, v = particles(3000, seed=6)
    v = v**2 - 0.7
    found = fields([Sampler(LENGTH, 1, V, 0.3).sample(np.zeros(3000), v)], LENGTH, 1, V)
    assert found["mean_velocity"] == pytest.approx(v.mean(), rel=1e-12)
    assert found["temperature"] == pytest.approx(v.var(), rel=1e-12)
    assert found["heat_flux"] == pytest.approx(0.3 / LENGTH * ((v - v.mean()) ** 3).sum(), rel=1e-11)


def test_bias_of_the_temperature() -> None:
    """θ(1 - 1/n), n = 100 particles of all replicas to a share L/(2M + 1): seen, and no more than that to O(1/n²)."""
    replicas, n = 2, 100
    count = n * NX // replicas
    rng = np.random.default_rng(7)
    sampler = Sampler(LENGTH, NX, V, 0.3)
    found = []
    for _ in range(1200):
        samples = [sampler.sample(LENGTH * rng.random(count), rng.normal(MEAN, math.sqrt(THETA), count)) for _ in range(replicas)]
        found.append(fields(samples, LENGTH, NX, V)["temperature"].mean() / THETA)
    mean, error = np.mean(found), np.std(found) / math.sqrt(len(found))
    assert mean < 1 - 5 * error
    assert abs(mean - (1 - 1 / n)) < 4 * error + 3 / n**2


def test_standard_errors() -> None:
    """Of ideal gas: ρ² (2M + 1)/(N R), θ/n and 2θ²/n; from 30 replicas, at n = 6000, to what they can tell."""
    replicas, count, trials = 30, 5000, 20
    rng = np.random.default_rng(8)
    sampler = Sampler(LENGTH, NX, V, 0.3)
    n = count * replicas / NX
    rho = 0.3 * count / LENGTH
    variances: dict[str, list[Array]] = {"density": [], "mean_velocity": [], "temperature": []}
    for _ in range(trials):
        samples = [sampler.sample(LENGTH * rng.random(count), rng.normal(MEAN, math.sqrt(THETA), count)) for _ in range(replicas)]
        found = fields(samples, LENGTH, NX, V)
        for name, values in variances.items():
            values.append(found[f"{name}_stderr"] ** 2)
    # ρ_0 does not fluctuate: 2M of the 2M + 1 waves do.
    expected = {"density": rho**2 / n * (NX - 1) / NX, "mean_velocity": THETA / n, "temperature": 2 * THETA**2 / n}
    scatter = math.sqrt(2 / (replicas - 1) / (trials * NX))
    for name, values in variances.items():
        assert abs(np.mean(values) / expected[name] - 1) < 4 * scatter + 2 / (count / NX), name


def test_modes_of_an_ideal_gas() -> None:
    """N⟨|c|²⟩ = 1 for independent particles, whatever their velocities and weight; their g(r) is 1."""
    count, times, replicas = 300, 200, 6
    rng = np.random.default_rng(9)
    sampler = Sampler(LENGTH, 21, V, 0.3)
    c = np.array(
        [
            [density_modes(sampler.sample(LENGTH * rng.random(count), rng.normal(size=count))) for _ in range(replicas)]
            for _ in range(times)
        ]
    )
    assert c.shape == (times, replicas, 8)
    structure, error = structure_factor(c, count)
    expected = 1 / math.sqrt(times * replicas)
    assert np.abs(structure - 1).max() < 4.5 * expected
    assert math.sqrt((error**2).mean()) == pytest.approx(expected, rel=4 / math.sqrt(2 * 5 * 8))
    r = np.linspace(0, LENGTH, 40)
    scatter = 2 / (count - 1) * expected * np.sqrt((np.cos(np.multiply.outer(r, K * np.arange(1, 9))) ** 2).sum(axis=1))
    assert (np.abs(pair_correlation(structure, count, LENGTH, r)) < 4.5 * scatter).all()


def test_fewer_modes_than_eight() -> None:
    x, v = particles(50, seed=10)
    assert density_modes(Sampler(LENGTH, 1, V, 0.3).sample(x, v)).shape == (0,)
    c = density_modes(Sampler(LENGTH, 11, V, 0.3).sample(x, v))
    assert c == pytest.approx(np.exp(-1j * K * np.multiply.outer(np.arange(1, 6), x)).mean(axis=1), rel=1e-12)


COUNT, DT = 700, 0.05
RATE = np.array([1.3, 2.1, 3.2])
FREQUENCY = np.array([4.0, -2.5, 7.0])
STRUCTURE = np.array([2.6, 0.7, 5.1])


def rotating_noise(times: int, replicas: int, seed: int) -> NDArray[np.complex128]:
    """Stationary complex Ornstein-Uhlenbeck noise: N⟨c(t + τ) c*(t)⟩ = S exp(-λ|τ| - iωτ), every DT exactly."""
    rng = np.random.default_rng(seed)
    c = np.empty((times, replicas, RATE.size), dtype=complex)
    for m in range(RATE.size):
        kept = np.exp((-RATE[m] - 1j * FREQUENCY[m]) * DT)
        noise = (rng.normal(size=(times, replicas)) + 1j * rng.normal(size=(times, replicas))) * math.sqrt(
            STRUCTURE[m] / COUNT / 2
        )
        noise[1:] *= math.sqrt(1 - abs(kept) ** 2)
        c[:, :, m] = lfilter([1.0], [1.0, -kept], noise, axis=0)
    return c


def test_structure_factor() -> None:
    """S and its error of correlated noise, from the replicas and from the time of each alone."""
    times, replicas = 20_000, 40
    c = rotating_noise(times, replicas, seed=11)
    structure, error = structure_factor(c, COUNT)
    decay = np.exp(-2 * RATE * DT)  # of |c|²
    single = STRUCTURE * np.sqrt((1 + decay) / (1 - decay) / times)
    true_error = single / math.sqrt(replicas)
    assert (np.abs(structure - STRUCTURE) < 4 * true_error).all()
    assert (np.abs(error / true_error - 1) < 4 / math.sqrt(2 * (replicas - 1))).all()
    alone = [structure_factor(c[:, [r]], COUNT) for r in range(replicas)]
    z = np.array([(value - STRUCTURE) / sigma for value, sigma in alone])
    assert (z**2).mean() == pytest.approx(19 / 17, abs=4 * 19 / 17 * math.sqrt((2 + 6 / 15) / z.size))
    variance = np.mean([sigma**2 for _, sigma in alone], axis=0)
    # between spans of 1000 times the correlation left is below 1 %
    assert (np.abs(variance / single**2 - 1) < 4 * math.sqrt(2 / 19 / replicas) + 0.01).all()
    value, sigma = structure_factor(c[:1, :1], COUNT)
    assert value == pytest.approx(COUNT * np.abs(c[0, 0]) ** 2, rel=1e-14)
    assert np.isnan(sigma).all()


def test_frequency_spectrum() -> None:
    """The Lorentzian 2λS/((ω - ω0)² + λ²) about ω0 = ku of either sign, its integral S, and its errors."""
    times, replicas = 16_384, 40
    c = rotating_noise(times, replicas, seed=12)
    omega, spectrum, error = frequency_spectrum(c, COUNT, DT)
    assert (np.diff(omega) > 0).all()
    assert omega[1] - omega[0] == pytest.approx(2 * math.pi * 8 / (times * DT), rel=1e-12)
    integral = spectrum.sum(axis=0) * (omega[1] - omega[0]) / (2 * math.pi)
    # the error of ⟨|c|²⟩ whose correlation is exp(-2λτ), Hann windows covering the run but for its ends
    assert (np.abs(integral / STRUCTURE - 1) < 4 * np.sqrt(1.1 / (RATE * DT * times * replicas))).all()

    # Of noise every DT the Lorentzian and its images at distances 2π/DT add up to this: near the line they add (a² + φ²)/12
    kept, phase = np.exp(-RATE * DT), (omega[:, None] - FREQUENCY) * DT
    exact = STRUCTURE * DT * (1 - kept**2) / np.abs(1 - kept * np.exp(1j * phase)) ** 2
    lorentzian = 2 * RATE * STRUCTURE / ((omega[:, None] - FREQUENCY) ** 2 + RATE**2)
    near = np.abs(omega[:, None] - FREQUENCY) < 3 * RATE
    images = ((RATE * DT) ** 2 + phase**2) / 12
    assert (np.abs(exact / lorentzian - 1 - images)[near] < 1e-3).all()
    # Hann windows smooth over 1.5 ω-spacings of 0.06: to 0.3 % of a line λ = 1.3 wide, a tenth of the error
    z = ((spectrum - exact) / error)[near]
    student = (replicas - 1) / (replicas - 3)
    # neighbours in ω have correlation (2/3)² after a Hann window, their squares its square: 1.4 times the variance
    shared = 1 + 2 * (2 / 3) ** 4
    assert abs((z**2).mean() - student) < 4 * student * math.sqrt((2 + 6 / (replicas - 5)) * shared / z.size)

    singles = [frequency_spectrum(c[:, [r]], COUNT, DT) for r in range(replicas)]
    scatter = np.var([s for _, s, _ in singles], axis=0, ddof=1)
    claimed = np.mean([e for _, _, e in singles], axis=0) ** 2
    ratio = (scatter / claimed)[near]
    # a mean of 15 exponentials has excess kurtosis 6/15
    assert ratio.mean() == pytest.approx(1.0, abs=4 * math.sqrt((2 + 6 / 15) / (replicas - 1) * shared / ratio.size))


def pair_sum(x: Array, modes: int, r: Array) -> Array:
    """g(r) of one configuration from all ordered pairs, each delta function cut off after `modes` waves."""
    count = x.size
    apart = (x[:, None] - x[None, :])[~np.eye(count, dtype=bool)]
    m = np.arange(1, modes + 1)
    kernel = (1 + 2 * np.cos(K * np.multiply.outer(np.subtract.outer(r, apart), m)).sum(axis=2)) / LENGTH
    return LENGTH / (count * (count - 1)) * kernel.sum(axis=1)


def test_pair_correlation() -> None:
    """Exact against the sum over pairs: of any particles, and of a lattice, whose peaks are at its spacing."""
    r = np.linspace(0, LENGTH, 49)
    rng = np.random.default_rng(13)
    m = np.arange(1, 26)
    for x in (LENGTH * rng.random(7) ** 2, 0.31 + LENGTH * np.arange(6) / 6):
        c = np.exp(-1j * K * np.multiply.outer(m, x)).mean(axis=1)
        structure, _ = structure_factor(c[None, None], x.size)
        g = 1 + pair_correlation(structure, x.size, LENGTH, r)
        assert g == pytest.approx(pair_sum(x, m.size, r), abs=1e-12)
    # of the lattice 25 = 4 · 6 + 1 modes: S is 6 at multiples of 6 and 0 between
    assert structure == pytest.approx(np.where(m % 6 == 0, 6.0, 0.0), abs=1e-12)
    inner = g[4:-4]
    peaks = 4 + 1 + np.flatnonzero((inner[1:-1] > inner[:-2]) & (inner[1:-1] > inner[2:]) & (inner[1:-1] > 0.5 * inner.max()))
    assert r[peaks] == pytest.approx(LENGTH / 6 * np.arange(1, 6), abs=1e-12)
