import numpy as np
import pytest
import torch

from lensforge.optics.dielectric import (
    fresnel_transmittance,
    normal_transmittance,
    refract,
    transmitted_sine_squared,
)

N = 1.4936


def _cosines(*degrees: float) -> torch.Tensor:
    return torch.cos(torch.deg2rad(torch.tensor(degrees, dtype=torch.float64)))


def test_snell_table() -> None:
    # air to n = 1.5, as textbooks print it
    sine = transmitted_sine_squared(_cosines(10, 30, 45, 60), 1 / 1.5).sqrt().numpy()
    assert np.allclose(np.rad2deg(np.arcsin(sine)), [6.6478, 19.4712, 28.1255, 35.2644], atol=1e-4)


def test_fresnel_at_normal_incidence_and_brewster() -> None:
    assert fresnel_transmittance(_cosines(0), 1 / N).item() == pytest.approx(4 * N / (1 + N) ** 2, rel=1e-14)
    assert normal_transmittance(N) ** 2 == pytest.approx(0.923, abs=5e-4)  # the paper's limit
    brewster = np.arctan(N)  # the parallel part passes whole; the other reflects ((n^2-1)/(n^2+1))^2
    expected = 1 - 0.5 * ((N**2 - 1) / (N**2 + 1)) ** 2
    assert fresnel_transmittance(_cosines(np.rad2deg(brewster)), 1 / N).item() == pytest.approx(expected, rel=1e-13)


def test_transmittance_is_the_same_in_both_directions() -> None:
    into = _cosines(0, 20, 50, 80, 89.9)
    out = torch.sqrt(1 - transmitted_sine_squared(into, 1 / N))
    assert torch.allclose(fresnel_transmittance(into, 1 / N), fresnel_transmittance(out, N), rtol=1e-12)


def test_the_critical_angle_is_where_the_sine_reaches_one() -> None:
    critical = np.rad2deg(np.arcsin(1 / N))
    inside, outside = transmitted_sine_squared(_cosines(critical - 1e-9, critical + 1e-9), N)
    assert inside < 1 < outside


def test_refracted_rays_are_unit_coplanar_and_obey_snell() -> None:
    rng = np.random.default_rng(0)
    n = torch.from_numpy(rng.normal(size=(500, 3)))
    d = torch.from_numpy(rng.normal(size=(500, 3)))
    n, d = (v / v.norm(dim=1, keepdim=True) for v in (n, d))
    d = torch.where((d * n).sum(1, keepdim=True) < 0, -d, d)
    out = refract(d, n, 1 / N)
    assert torch.allclose(out.norm(dim=1), torch.ones(500, dtype=torch.float64), atol=1e-14)
    assert torch.allclose(torch.cross(out, n, dim=1) * N, torch.cross(d, n, dim=1), atol=1e-14)
    assert torch.allclose(refract(out, n, N), d, atol=1e-13)
