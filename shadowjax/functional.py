"""Shadow maps as functions from arrays to arrays: what the objects of this package call, for `jit`, `vmap` and `grad`.

No object of this package goes in or comes out. Each function stands next to the object that calls it:

- the map of a directional light: `map_rays`, `cast_depth`, `to_map`;
- several depths a texel: `multi_depth`, `multi_depth_shift`, `composite_test`;
- filters that count tests: `shadow_test`, `percentage_closer`;
- filters that average values made of depths of [0, 1] (`unit_depth`): `encode_…` makes what is stored of a map, and
  `decode_…` visibility of the averages that receivers read; with the bounds and series they are made of;
- averages: `extend` and `blur` with `gaussian_weights` or `box_weights`, `blur_exponents` for logarithms, `mip_levels`,
  `summed_area_table`;
- reads of a map: `read_nearest`, `read_bilinear`, `read_mip`, `read_mip_anisotropic`, `read_summed_area`;
- `tone_count`, the number of distinct visibilities of a picture.

Sizes and names are static; every other number may be traced, but for the damping of Fourier series.
"""

from shadowjax.filters.convolution import (
    decode_convolution,
    decode_mean_depth,
    encode_convolution,
    encode_mean_depth,
    fourier_bases,
    fourier_test,
    fourier_visibility,
)
from shadowjax.filters.exponential import blur_exponents, decode_exponential, encode_exponential, exponential_test
from shadowjax.filters.exponential_variance import (
    decode_exponential_variance,
    encode_exponential_variance,
    warp_depth,
)
from shadowjax.filters.hard import composite_test
from shadowjax.filters.hard import is_lit as shadow_test
from shadowjax.filters.moment import (
    decode_moments,
    encode_moments,
    hamburger_visibility,
    hausdorff_visibility,
    power_moments,
)
from shadowjax.filters.pcf import percentage_closer
from shadowjax.filters.policies import multi_depth, multi_depth_shift
from shadowjax.filters.prefilter import unit_depth
from shadowjax.filters.variance import (
    chebyshev_visibility,
    decode_variance,
    depth_moments,
    encode_variance,
    linear_step,
    variance_of,
)
from shadowjax.maps.blur import blur, box_weights, extend, gaussian_weights
from shadowjax.maps.pyramid import mip_level, mip_levels, read_mip, read_mip_anisotropic
from shadowjax.maps.sampling import read_bilinear, read_nearest
from shadowjax.maps.summed_area import read_summed_area, summed_area_table
from shadowjax.partitions.single import map_rays, to_map
from shadowjax.rays.array_cast import cast_depth
from shadowjax.theory.tones import tone_count

__all__ = [
    "blur",
    "blur_exponents",
    "box_weights",
    "cast_depth",
    "chebyshev_visibility",
    "composite_test",
    "decode_convolution",
    "decode_exponential",
    "decode_exponential_variance",
    "decode_mean_depth",
    "decode_moments",
    "decode_variance",
    "depth_moments",
    "encode_convolution",
    "encode_exponential",
    "encode_exponential_variance",
    "encode_mean_depth",
    "encode_moments",
    "encode_variance",
    "exponential_test",
    "extend",
    "fourier_bases",
    "fourier_test",
    "fourier_visibility",
    "gaussian_weights",
    "hamburger_visibility",
    "hausdorff_visibility",
    "linear_step",
    "map_rays",
    "mip_level",
    "mip_levels",
    "multi_depth",
    "multi_depth_shift",
    "percentage_closer",
    "power_moments",
    "read_bilinear",
    "read_mip",
    "read_mip_anisotropic",
    "read_nearest",
    "read_summed_area",
    "shadow_test",
    "summed_area_table",
    "to_map",
    "tone_count",
    "unit_depth",
    "variance_of",
    "warp_depth",
]
