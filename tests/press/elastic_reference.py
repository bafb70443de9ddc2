"""A rigid face on an elastic solid, solved on a fine grid: the reference for tactsim.press.elastic.

Conjugate gradients with convolution by FFT and pressure never below 0, at a given force (I. A. Polonsky and L. M.
Keer, Wear 231, 1999). It shares nothing with the press: no cells, no moments, no Gaussians. Lengths are mm, and E* =
E / (1 - nu^2) is 1 N/mm^2.
"""

import numpy as np
import scipy.fft
from scipy.special import erf

from tactsim.core import transform
from tactsim.press.clip import covers


def surface_movement(k, thickness, poisson):
    """Solve a bonded layer under the pressure cos(k x) without friction: how far its surface moves at x = 0.

    Plane strain, Airy's function f = (A cosh + B sinh + C z cosh + D z sinh)(k z) cos(k x), z from 0 at the base to
    the surface; 2 G u = -f_x + (1 - nu) psi_z, 2 G w = -f_z + (1 - nu) psi_x, psi_xz = f_xx + f_zz (Mindlin). Nothing
    moves at the base; at the surface there is the pressure and no shear.
    """
    h, elastic, two_g = thickness, 2 * (1 - poisson), 1 - poisson
    c, s = np.cosh(k * h), np.sinh(k * h)
    u_base, w_base = [k, 0, 0, elastic], [0, -k, elastic - 1, 0]
    pressure = -(k**2) * np.array([c, s, h * c, h * s])
    shear = [k * k * s, k * k * c, k * (c + k * h * s), k * (s + k * h * c)]
    factors = np.linalg.solve(np.array([u_base, w_base, pressure, shear]), [0, 0, -1, 0])
    w_top = [-k * s, -k * c, (elastic - 1) * c - k * h * s, (elastic - 1) * s - k * h * c]
    return -(w_top @ factors) / two_g


class Reference:
    """A solid's surface under a pad, in squares of about `fine` mm; thickness None for a half-space."""

    def __init__(self, pad, thickness, poisson, fine=0.1):
        left, right, low, high = pad.load_bounds
        self.pad = pad
        self.x, self.y = (
            a + (b - a) * (np.arange(n) + 0.5) / n
            for a, b, n in (
                (left, right, round((right - left) / fine)),
                (low, high, round((high - low) / fine)),
            )
        )
        dx, dy = self.x[1] - self.x[0], self.y[1] - self.y[0]
        self.square = dx * dy
        self.shape = tuple(scipy.fft.next_fast_len(2 * len(axis), True) for axis in (self.y, self.x))
        rows, columns = self.shape
        if thickness is None:  # A. E. H. Love, 1929: under a square of even pressure
            u, v = np.meshgrid(np.fft.fftfreq(columns, 1 / columns) * dx, np.fft.fftfreq(rows, 1 / rows) * dy)
            kernel = sum(
                sign * (p * np.arcsinh(q / abs(p)) + q * np.arcsinh(p / abs(q)))
                for sign, p, q in (
                    (1, u + dx / 2, v + dy / 2),
                    (-1, u + dx / 2, v - dy / 2),
                    (1, u - dx / 2, v - dy / 2),
                    (-1, u - dx / 2, v + dy / 2),
                )
            )
            self.answer = scipy.fft.rfft2(kernel / np.pi)
        else:  # what lies beyond the padding is some thicknesses away and moves nothing here
            k = 2 * np.pi * np.hypot(np.fft.rfftfreq(columns, dx), np.fft.fftfreq(rows, dy)[:, None])
            nodes = np.geomspace(1e-3, 30, 400) / thickness
            moved = [surface_movement(node, thickness, poisson) * node for node in nodes]
            near = np.interp(np.log(np.maximum(k, nodes[0])), np.log(nodes), moved, right=2.0)
            self.answer = near / np.maximum(k, nodes[0])

    def movement(self, pressure):
        """Give how far the surface moves, mm, under pressures on the squares, N/mm^2."""
        spectrum = scipy.fft.rfft2(pressure, self.shape) * self.answer
        return scipy.fft.irfft2(spectrum, self.shape)[: len(self.y), : len(self.x)]

    def covered(self, letter, pose):
        """Tell which squares a letter covers."""
        points = np.stack(np.meshgrid(self.x, self.y), axis=-1).reshape(-1, 2)
        return covers(letter.contours, transform(np.array(pose, dtype=float), points)).reshape(
            len(self.y), -1
        )

    def pressure(self, mask, force, gap=0.0):
        """Find the pressures, N/mm^2, under a rigid face that lies `gap` mm (over E*) behind its front."""
        p = np.where(mask, force / (mask.sum() * self.square), 0.0)
        direction, before, conjugate = np.zeros_like(p), 1.0, 0
        for _ in range(1000):
            miss = self.movement(p) + gap
            miss -= miss[p > 0].mean()
            norm = (miss[p > 0] ** 2).sum()
            direction = np.where(p > 0, miss + conjugate * norm / before * direction, 0.0)
            answer = self.movement(direction)
            answer -= answer[p > 0].mean()
            step = (miss * direction)[p > 0].sum() / (answer * direction)[p > 0].sum()
            last, before = p, norm
            p = np.where(mask, np.maximum(p - step * direction, 0), 0.0)
            enters = mask & (p == 0) & (miss < 0)
            conjugate = 0 if enters.any() else 1
            p = np.where(enters, p - step * miss, p)
            p *= force / (p.sum() * self.square)
            if np.abs(p - last).sum() * self.square < 1e-6 * force:
                return p
        raise AssertionError("the reference does not converge")

    def reading(self, pressure, sigma=1.0):
        """Spread pressures over the taxels: (taxels,) kPa. With sigma = 0 a square counts where it overlaps a taxel."""

        def felt(at, edges):
            if sigma:
                return np.diff(erf((edges - at[:, None, None]) / (sigma * np.sqrt(2))), axis=-1)[..., 0] / 2
            size = at[1] - at[0]
            return np.diff(np.clip((edges - at[:, None, None]) / size + 0.5, 0, 1), axis=-1)[..., 0]

        columns, rows = felt(self.x, self.pad.column_edges), felt(self.y, self.pad.row_edges)
        taxel = self.pad.taxel_width * self.pad.taxel_height
        return 1e3 * (rows.T @ pressure @ columns).ravel() * self.square / taxel
