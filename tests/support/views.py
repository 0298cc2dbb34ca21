"""Random camera frusta under random lights, corner cases included, for tests of the warping theory."""

import jax.numpy as jnp
import numpy as np

from shadowjax.theory.aliasing.light_frustum import LightFrustum


def random_frusta(count: int, seed: int = 0, dtype=jnp.float64, largest: float = 6.0) -> LightFrustum:
    """Frusta with f/n from 1.01 to 10^largest; a quarter has γ = γ_lim, φ_y, nearly 0 or exactly 0 and π/2."""
    rng = np.random.default_rng(seed)
    near = 10 ** rng.uniform(-2, 2, count)
    far = near * 10 ** rng.uniform(np.log10(1.01), largest, count)
    phi = rng.uniform(0.1, 1.3, (2, count))
    gamma = rng.uniform(0, np.pi / 2, count)
    part = max(count // 12, 1)
    limit = np.arctan(np.tan(phi[0]) * (far + near) / (far - near))
    gamma[:part], gamma[part : 2 * part] = limit[:part], phi[0][part : 2 * part]
    gamma[2 * part : 3 * part] = 10 ** rng.uniform(-9, -1, part)
    gamma[-2:] = 0, np.pi / 2
    fields = (near, far, phi[0], np.minimum(gamma, np.pi / 2), phi[1])
    return LightFrustum.create(*(jnp.asarray(x, dtype=dtype) for x in fields))
