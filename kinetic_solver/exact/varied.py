"""What arrives at places from a start whose mean velocity or temperature depends on x.

Of the starting points of what is now at x, as many as are wanted have the weight exp(SΦ0) N(d; 0, X), d = x - y - m(y) and X(y)
being displacement from the mean and its variance. Streams that have overtaken one another are separate peaks. Intervals of y
are halved until bounds on d and X say that the weight is negligible all over them or nearly even, and those that are left
until Legendre series of the integrands have converged: nothing narrow is missed, and nothing is computed where nothing is.

E(x) = exp(SΦ(x, t)) follows from E_x = S∫F dv without the cancellation between streams that integration by parts would bring:
E(x) = ∫Sρ0(y) exp(SΦ0(y)) Prob(arriving left of x | y) dy, all terms positive; where the probability is 1 the integral is known.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinetic_solver import initial
from kinetic_solver.arrays import Array
from kinetic_solver.exact.mixture import SIGMAS, Mixture
from kinetic_solver.exact.panels import Panels, check, joined, resolved
from kinetic_solver.exact.setting import LOOK, Setting, derivative, jumps, slopes

PLACES = 16
"""At once. Chosen, for memory."""
EVEN = 10.0
"""By how many powers of e a weight may differ over a panel that is not halved for its unevenness: a peak between nodes would
still show at some of them."""
LONG = 6.0
"""Half a panel over the shortest wave's 1/k at most, or four widths of a pulse: no pulse hides between nodes."""
NARROW = 6.0
"""Widths of a Gaussian in v that a panel may span: 20 nodes then integrate it to rounding."""


class _Terms(NamedTuple):
    y: Array
    log: Array
    """Of the weight times √(2πX), less what `Mixture.log_scale` is without."""
    d: Array
    xx: Array
    mean: Array
    variance: Array


class Varied:
    """Sums over the starting points, at one time."""

    def __init__(self, at: Setting) -> None:
        self.at = at
        ((_, self.u0, self.theta0),) = at.beams
        start = at.scene.initial
        self._of_u = slopes(start.velocity_modes, at.length)
        self._of_theta = slopes(start.temperature_modes, at.length, self.theta0)
        u, theta = at.fields(at.length * np.arange(LOOK) / LOOK, self.u0, self.theta0)
        k, b = at.spread, at.spread.drift_time
        slack = b * self._of_u[0] * at.length / LOOK
        self.width = math.sqrt(float(theta.max()) * b * b + k.displacement_variance)
        far = SIGMAS * self.width + slack
        # Where most would come from if the first beam were all of it: exp(Sρ̄y) moves that ahead.
        self.origin = b * self.u0 - at.growth * (self.theta0 * b * b + k.displacement_variance)
        # exp(SΦ0) favours dense places ahead, by at most its slope times the variance,
        slow, fast = b * float(u.min() - self.u0), b * float(u.max() - self.u0)
        self.low = slow - far - at.steepest * self.width**2 + at.growth * (self.theta0 * b * b + k.displacement_variance)
        self.high = fast + far - self.origin + b * self.u0
        # and by no more than it varies once the Gaussians have been moved.
        cold, warm = (at.growth * b * b * float(extreme - self.theta0) for extreme in (theta.min(), theta.max()))
        swing = at.swing + at.growth * (fast - slow + (warm - cold) / 2)
        far = self.width * math.sqrt(SIGMAS**2 + 2 * swing) + slack
        self.low, self.high = max(self.low, slow - warm - far), min(self.high, fast - cold + far)
        self._speed = k.decay * math.sqrt(float(theta.max())) + math.sqrt(k.velocity_variance) + k.decay * float(np.ptp(u))

    def count(self) -> float:
        """Nodes that f takes at a place, or about as many."""
        return (self.high - self.low) / self.at.spacing(self.at.coldest, precise=True)

    def mixtures(self, x: Array, precise: bool) -> Iterator[Mixture]:
        """Of one place after another. `precise`: for f, not only moments."""
        for first in range(0, x.size, PLACES):
            yield from self._some(x[first : first + PLACES], precise)

    def _some(self, x: Array, precise: bool) -> Iterator[Mixture]:
        at = self.at
        panels, passed, top = self._candidates(x)

        def integrands(some: Panels) -> tuple[Array, NDArray[np.bool_]]:
            terms = self._terms(x[some.owner][:, None], some.nodes)
            weight = np.exp(terms.log - top[some.owner][:, None]) / np.sqrt(terms.xx) * self._density(x, some)
            values = [weight, weight * (terms.mean / self._speed) ** 3]
            if at.s:
                values.append(self._arrived(x, some, terms, top))
            wide = np.zeros(some.size, dtype=bool)
            if precise:
                wide = np.ptp(terms.mean, axis=1) > NARROW * np.sqrt(terms.variance.min(axis=1))
            return np.array(values), wide

        panels = resolved(panels, integrands, at.time)
        terms = self._terms(x[panels.owner][:, None], panels.nodes)
        weight = np.exp(terms.log - top[panels.owner][:, None]) / np.sqrt(2 * np.pi * terms.xx) * panels.weights
        weight *= self._density(x, panels)
        scale = np.exp(-top)
        if at.s:
            scale = passed + np.bincount(
                panels.owner, (self._arrived(x, panels, terms, top) * panels.weights).sum(axis=1), minlength=x.size
            )
        ends = np.searchsorted(panels.owner, np.arange(x.size + 1))
        for i in range(x.size):
            part = slice(ends[i], ends[i + 1])
            yield Mixture(
                weight[part].reshape(1, -1) / scale[i],
                at.base,
                terms.mean[part].ravel(),
                terms.variance[part].ravel(),
                np.array([top[i] + math.log(scale[i])]),
            )

    def _terms(self, x: Array, offset: Array) -> _Terms:
        at, k = self.at, self.at.spread
        y = (x - k.displacement_shift - self.origin) - offset
        u, theta = at.fields(y, self.u0, self.theta0)
        xx, xv, vv = at.covariance(theta)
        # d + Sρ̄X, d's distance from where exp(Sρ̄y) moves it, in which nothing large cancels
        moved = offset - k.drift_time * (u - self.u0 - at.growth * k.drift_time * (theta - self.theta0))
        log = at.waves(y) + at.tilt(u, theta) - moved**2 / (2 * xx)
        mean = at.apart(u, theta) + xv / xx * moved
        return _Terms(y, log, moved - at.growth * xx, xx, mean, vv)

    def _density(self, x: Array, panels: Panels) -> Array:
        """At the nodes; with a step, of the side of its jump on which the panel lies."""
        origin = (x - self.at.spread.displacement_shift - self.origin)[panels.owner]
        if self.at.scene.initial.step is None:
            return initial.density(self.at.scene, origin[:, None] - panels.nodes)
        return initial.density(self.at.scene, origin - panels.centre)[:, None]

    def _arrived(self, x: Array, panels: Panels, terms: _Terms, top: Array) -> Array:
        """E's integrand over exp(top). The probability is the weight's own Gaussian, by which nothing large cancels, times what
        changes slowly."""
        from scipy.special import erfcx, log_ndtr

        xi = terms.d / np.sqrt(terms.xx)
        behind = np.maximum(xi, 0.0)
        slow = np.where(xi < 0, np.log(erfcx(-np.minimum(xi, 0.0) / math.sqrt(2)) / 2), behind**2 / 2 + log_ndtr(behind))
        return np.asarray(self.at.s * self._density(x, panels) * np.exp(terms.log - top[panels.owner][:, None] + slow))

    def _candidates(self, x: Array) -> tuple[Panels, Array, Array]:
        """Panels that hold all of the weight and have no sharper peak than shows; of E what lies beyond them, over exp(top); and
        top, the logarithm of about the largest weight of each place."""
        at, k = self.at, self.at.spread
        origin = x - k.displacement_shift - self.origin
        even = np.broadcast_to(np.linspace(self.low, self.high, 9), (x.size, 9))
        places = jumps(at.scene, float(origin.min()) - self.high, float(origin.max()) - self.low)
        at_jumps = np.clip(x[:, None] - places - k.displacement_shift - self.origin, self.low, self.high)
        panels = Panels.between(np.concatenate([even, at_jumps], axis=1))
        top = np.full(x.size, -np.inf)
        kept: list[Panels] = []
        passed: list[Panels] = []
        while panels.size:
            check(panels.size + sum(part.size for part in kept), at.time)
            log, bound, d = self._bounds(origin, panels)
            np.maximum.at(top, panels.owner, log)
            drop = bound < top[panels.owner] - SIGMAS**2 / 2
            fine = ~drop & (bound - log < EVEN) & (panels.half * at.k_max < LONG)
            passed.append(panels.chosen(drop & (d > 0)))
            kept.append(panels.chosen(fine))
            panels = panels.chosen(~drop & ~fine).halved()
        whole: Array = np.zeros(x.size)
        if at.s:
            whole = self._integral_to(origin, np.full(x.size, self.high), top)
            gone = joined(passed)
            near, far = (self._integral_to(origin[gone.owner], end, top[gone.owner]) for end in (gone.low, gone.high))
            whole += np.bincount(gone.owner, near - far, minlength=x.size)
        return joined(kept), whole, top

    def _integral_to(self, origin: Array, offset: Array, top: Array) -> Array:
        """E's integral from far behind to a point, over exp(top), where the weight is negligible before it, by parts."""
        from scipy.special import log_ndtr

        terms = self._terms(origin + self.at.spread.displacement_shift + self.origin, offset)
        return np.asarray(np.exp(self._logarithm(origin, offset) - top + log_ndtr(terms.d / np.sqrt(terms.xx))))

    def _logarithm(self, origin: Array, offset: Array) -> Array:
        """SΦ0, as `_Terms.log` has it."""
        return self.at.logarithm(self.origin + offset, origin - offset)

    def _bounds(self, origin: Array, panels: Panels) -> tuple[Array, Array, Array]:
        """Of each panel: the weight's logarithm in its middle, a bound on it, and d in the middle."""
        at, b, start = self.at, self.at.spread.drift_time, self.at.scene.initial
        half, middle = panels.half, panels.centre
        terms = self._terms(origin[panels.owner] + at.spread.displacement_shift + self.origin, middle)
        first, second = self._of_u
        steep = np.minimum(
            1 + b * first, np.abs(1 + b * derivative(start.velocity_modes, terms.y, at.length)) + b * second * half
        )
        first, second = self._of_theta
        slope = self.theta0 * np.abs(derivative(start.temperature_modes, terms.y, at.length))
        wider = terms.xx + b * b * half * np.minimum(first, slope + second * half)
        nearest = np.maximum(0.0, np.abs(terms.d) - steep * half)
        ahead = self._logarithm(origin[panels.owner], panels.low)  # SΦ0 grows with y
        return terms.log, ahead - nearest**2 / (2 * wider), terms.d
