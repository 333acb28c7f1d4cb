import numpy as np
import pytest
import torch
from known_refraction import normal_transmittance

from lensforge.optics.dielectric import fresnel_transmittances, refract, transmitted_cosine_squared

N = 1.4936


def fresnel_transmittance(cosine: torch.Tensor, ratio: float | torch.Tensor) -> torch.Tensor:
    t_s, t_p, excess = fresnel_transmittances(cosine, ratio)
    assert torch.allclose(t_p - t_s, excess * (1.0 - cosine**2), rtol=1e-9, atol=1e-14)
    return 0.5 * (t_s + t_p)


def _cosines(*degrees: float) -> torch.Tensor:
    return torch.cos(torch.deg2rad(torch.tensor(degrees, dtype=torch.float64)))


def test_fresnel_at_normal_incidence_and_brewster() -> None:
    assert fresnel_transmittance(_cosines(0), 1 / N).item() == pytest.approx(4 * N / (1 + N) ** 2, rel=1e-14)
    assert normal_transmittance(N) ** 2 == pytest.approx(0.923, abs=5e-4)  # the paper's limit
    brewster = np.arctan(N)  # the parallel part passes whole; the other reflects ((n^2-1)/(n^2+1))^2
    expected = 1 - 0.5 * ((N**2 - 1) / (N**2 + 1)) ** 2
    assert fresnel_transmittance(_cosines(np.rad2deg(brewster)), 1 / N).item() == pytest.approx(expected, rel=1e-13)


def test_transmittance_is_the_same_in_both_directions() -> None:
    into = _cosines(0, 20, 50, 80, 89.9)
    out = torch.sqrt(transmitted_cosine_squared(into, 1 / N))
    assert torch.allclose(fresnel_transmittance(into, 1 / N), fresnel_transmittance(out, N), rtol=1e-12)


def test_the_critical_angle_is_where_the_sine_reaches_one() -> None:
    critical = np.rad2deg(np.arcsin(1 / N))
    inside, outside = transmitted_cosine_squared(_cosines(critical - 1e-9, critical + 1e-9), N)
    assert inside > 0 > outside


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


@pytest.mark.parametrize("index", [1.2, 1.5, 2.4, 4.0])
def test_fresnel_by_its_sines_and_tangents(index: float) -> None:
    """r_s = sin(a-b)/sin(a+b), r_p = tan(a-b)/tan(a+b): Fresnel's own form, angles instead of cosines."""
    for ratio, limit in ((1 / index, 89.9), (index, np.rad2deg(np.arcsin(1 / index)) - 1e-3)):
        degrees = np.linspace(0.01, limit, 200)
        a = np.deg2rad(degrees)
        b = np.arcsin(ratio * np.sin(a))
        expected = 1 - 0.5 * ((np.sin(a - b) / np.sin(a + b)) ** 2 + (np.tan(a - b) / np.tan(a + b)) ** 2)
        transmittance = fresnel_transmittance(torch.cos(torch.from_numpy(a)), ratio).numpy()
        assert np.allclose(transmittance, expected, rtol=1e-9, atol=1e-12)


def test_no_difference_of_index_no_refraction_to_the_last_bit_of_grazing() -> None:
    cosine = torch.tensor([1.0, 1e-3, 1e-9, 1e-150], dtype=torch.float64)
    assert torch.equal(transmitted_cosine_squared(cosine, 1.0), cosine**2)
    assert torch.allclose(fresnel_transmittance(cosine, 1.0), torch.ones_like(cosine), rtol=1e-15)


def test_each_ray_may_meet_another_index() -> None:
    indices = torch.tensor([1.0, 1.33, 1.5, 2.4], dtype=torch.float64)
    cosine = _cosines(30, 30, 30, 30)
    normals = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64).expand(4, 3)
    directions = torch.stack([torch.sqrt(1 - cosine**2), torch.zeros(4), cosine], dim=1)
    together = refract(directions, normals, 1 / indices)
    for row, index in enumerate(indices.tolist()):
        alone = slice(row, row + 1)
        assert torch.equal(together[alone], refract(directions[alone], normals[alone], 1 / index))
        assert together[row, 0].item() == pytest.approx(0.5 / index, rel=1e-15)
        transmittance = fresnel_transmittance(cosine, 1 / indices)[row]
        assert torch.equal(transmittance, fresnel_transmittance(cosine[alone], 1 / index)[0])
