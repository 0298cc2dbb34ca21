"""For every name of the front door that can be called: a call with good arguments, small enough to take a moment."""

from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import shadowjax as sj

TRIANGLES = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.4, 0.5, -0.3]])
FACES = np.array([[0, 1, 2], [0, 1, 3]])
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


@cache
def parts() -> dict[str, Any]:
    """Objects that examples share."""
    mesh = sj.Mesh.create(TRIANGLES, FACES)
    camera = sj.Camera.look_at((0.0, 2.0, 3.0), (0.0, 0.0, 0.0), phi_y=0.4, near=0.1, far=9.0)
    light = sj.DirectionalLight.create((0.2, -1.0, -0.1))
    grid = sj.camera_grid(camera, 4, 3)
    map_ = sj.build_shadow_map(sj.BruteForceCaster(), mesh, grid)
    points = jnp.asarray(np.array([[0.1, 0.0, -0.2], [0.3, 0.0, -0.4]], np.float32))
    normals = jnp.asarray(np.array([[0.0, 1.0, 0.0], [0.0, 1.0, 0.0]], np.float32))
    surface = sj.trace_surface(mesh, camera, 4, 3, sj.BruteForceCaster())
    shadows = sj.ShadowMapping(resolution=8).build(mesh, light, camera)
    return {
        "scene": sj.Scene(mesh, camera, (light,), "triangles", "two triangles"),
        "mesh": mesh, "camera": camera, "light": light, "grid": grid, "map": map_, "points": points,
        "normals": normals, "surface": surface, "shadows": shadows, "edges": sj.mesh_edges(mesh),
        "rays": sj.Rays.create(points + jnp.asarray([0.0, 1.0, 0.0]), (0.0, -1.0, 0.0)),
        "receiver": sj.plane_receiver(*np.eye(3, dtype=np.float32), np.zeros(2), np.ones(2), (3, 3))[0],
    }  # fmt: skip


def examples(folder: Path) -> dict[str, tuple[Callable[..., Any], Mapping[str, Any]]]:
    """The call, and its keywords, for each name; names of methods follow a dot."""
    (folder / "triangle.obj").write_text(OBJ)
    p = parts()
    x, y = jnp.asarray([1.0, 0.0, 0.0]), jnp.asarray([0.0, 1.0, 0.0])
    scene = {"mesh": p["mesh"], "light": p["light"], "camera": p["camera"]}
    seen = {"points": p["points"], "normals": p["normals"]}
    eye = {"position": x, "direction": y, "color": x}
    made: dict[str, Mapping[str, Any]] = {
        "AdaptiveShadowMapping": {
            "budget_bytes": 1 << 16, "tile_size": 8, "base_level": None, "max_level": None, "footprint": "jacobian",
            "texels_per_pixel": 2.0, "test": "depth", "bias": None, "levels_per_step": 1, "max_steps": 2,
            "per_texel": 1.0, "fixed": 1.0, "num_rows": 8, "caster": sj.BruteForceCaster(),
        },
        "AdaptiveShadowMapping().build": scene,
        "Bias": {"value": jnp.asarray(0.5), "unit": "world"},
        "Bias.create": {"value": 0.5, "unit": "world"},
        "BilinearPercentageCloser": {"kernel_size": 2},
        "BruteForceCaster": {"ray_chunk": 64},
        "Camera": {
            "position": x, "rotation": jnp.eye(3), "phi_y": jnp.asarray(0.4), "aspect": jnp.asarray(1.0),
            "near": jnp.asarray(0.1), "far": jnp.asarray(9.0),
        },
        "Camera.look_at": {
            "position": (0.0, 2.0, 3.0), "target": (0.0, 0.0, 0.0), "up": (0.0, 1.0, 0.0), "phi_y": 0.4, "near": 0.1,
            "far": 9.0, "aspect": 1.0, "dtype": jnp.float32, "origin": (0.0, 0.0, 0.0),
        },
        "ContactHardening": {"angle": 0.1, "size": 0.2, "num_taps": 3, "num_search_taps": 3, "max_width": 8.0},
        "Convolution": {"step": sj.FourierStep(), "prefilter": sj.Prefilter()},
        "CubeMap": {"margin": 2},
        "DirectionalLight": {"direction": y, "color": x},
        "DirectionalLight.create": {"direction": (0.0, -1.0, 0.0), "color": 1.0, "dtype": None},
        "Exact": {"caster": sj.BruteForceCaster()},
        "Exact().build": scene,
        "Exponential": {
            "exponent": 40.0, "prefilter": sj.Prefilter(), "space": "log", "fallback": "none", "threshold": 0.02,
            "fallback_size": 1,
        },
        "ExponentialVariance": {
            "positive": 20.0, "negative": 5.0, "prefilter": sj.Prefilter(), "min_variance": 1e-6, "bleed_low": 0.1,
            "bleed_high": 1.0, "footprint": 0.25, "slope_limit": 0.05,
        },
        "FacePartition": {"tight": True},
        "FixedNeighbour": {"offset": (0, 1)},
        "FourierStep": {"terms": 8, "damping": 1.0, "offset": 0.0, "scale": 2.0},
        "Hard": {},
        "HierarchicalMinimum": {"block_sizes": (2, 4)},
        "Hit": {"depth": jnp.ones(2), "face": jnp.zeros(2, jnp.int32), "barycentrics": jnp.ones((2, 3)) / 3},
        "JitteredLights": {"technique": sj.ShadowMapping(resolution=8), "radius": jnp.asarray(0.1), "num_lights": 2},
        "JitteredLights.create": {"technique": sj.ShadowMapping(resolution=8), "radius": 0.1, "num_lights": 2},
        "LogarithmicFit": {"tight": True},
        "Material": {"ambient": 0.2, "specular": 0.1, "shininess": 20.0},
        "MeanDepthConvolution": {"step": sj.FourierStep(), "prefilter": sj.Prefilter()},
        "Mesh": {
            "vertices": p["mesh"].vertices, "faces": p["mesh"].faces, "face_colors": p["mesh"].face_colors,
            "origin": (0.0, 1.0, 0.0),
        },
        "Mesh.create": {
            "vertices": TRIANGLES, "faces": FACES, "face_colors": (0.5, 0.5, 0.5), "dtype": jnp.float32,
            "origin": (0.0, 0.0, 0.0),
        },
        "MeshEdges": dict(vars(p["edges"])),
        "Moments": {
            "problem": "hamburger", "moment_bias": 1e-6, "prefilter": sj.Prefilter(), "bleed_low": 0.0,
            "bleed_high": 1.0,
        },
        "MultiDepth": {"policy": sj.Ring(), "kernel_size": 1},
        "Neighbourhood": {"keep": "max", "size": 3, "include_centre": True},
        "PercentageCloser": {"kernel_size": 3, "width_world": None},
        "PerspectiveFit": {"rule": "minimax", "tight": True},
        "PointLight": {"position": x, "color": x},
        "PointLight.create": {
            "position": (0.0, 1.0, 0.0), "color": (1.0, 0.5, 0.2), "dtype": None,
            "origin": (0, 0, 0),
        },
        "Prefilter": {"size": 5, "kernel": "gaussian", "sigma": 1.0, "sampling": "bilinear", "max_anisotropy": 4},
        "PropagatedNeighbours": {},
        "RayGrid": dict(vars(p["grid"])),
        "Rays": dict(vars(p["rays"])),
        "Rays.create": {"origins": TRIANGLES, "directions": (0.0, -1.0, 0.0), "t_min": 0.0, "t_max": 5.0},
        "Receiver": {"mesh": p["mesh"], "edges": p["edges"]},
        "Ring": {"num_depths": 4, "ring_radius": 1},
        "Scene": {
            "mesh": p["mesh"], "camera": p["camera"], "lights": (p["light"],), "name": "mine", "description": "two",
        },
        "ShadowMap": {"grid": p["grid"], "depth": p["map"].depth, "face": p["map"].face, "outlines": None},
        "ShadowMapping": {
            "filter": sj.Hard(), "resolution": 8, "partition": sj.SingleMap(), "caster": sj.BruteForceCaster(),
            "bias": sj.Bias.create(1.0), "layer": "first", "coverage": False, "edges": None,
        },
        "ShadowMapping().build": scene,
        "ShadowVolumes": {"method": "z-pass", "casters": "both", "stencil": sj.Stencil()},
        "ShadowVolumes().build": scene,
        "SpotLight": {**eye, "half_angle": jnp.asarray(0.5)},
        "SpotLight.create": {
            "position": (0.0, 3.0, 0.0), "direction": (0.0, -1.0, 0.0), "half_angle": 0.5, "color": 1.0, "dtype": None,
            "origin": (0.0, 0.0, 0.0),
        },
        "StableFit": {"steps": 16, "snap": True},
        "Stencil": {"bits": 8, "wraps": True},
        "StochasticNeighbour": {"seed": 1, "size": 3},
        "Supersampled": {},
        "UniformFit": {},
        "Variance": {
            "prefilter": sj.Prefilter(), "min_variance": 1e-6, "bleed_low": 0.1, "bleed_high": 1.0, "footprint": 0.25,
            "slope_limit": 0.05,
        },
        "SingleMap": {"warp": sj.UniformFit()},
        "Cascades": {
            "num_partitions": 2, "rule": "logarithmic", "weight": 0.5, "ratio": 2.0, "warp": sj.PerspectiveFit(),
            "tight": True, "blend": 0.0, "choose": "map", "cuts": None, "num_rows": 8, "caster": sj.BruteForceCaster(),
        },
        "Cascades.at": {"cuts": (1.0, 2.0)},
        "build_shadow_map": {"caster": sj.BruteForceCaster(), "mesh": p["mesh"], "grid": p["grid"], "layer": "first"},
        "camera_grid": {"camera": p["camera"], "width": 4, "height": 3},
        "astype": {"tree": p["mesh"], "dtype": jnp.float32},
        "checked_values": {},
        "compare": {"scene": p["scene"], "techniques": ("hard",), "width": 4, "height": 3, "resolution": 8},
        "load_scene": {
            "source": str(folder / "triangle.obj"), "up": "y", "ground": True, "light": p["light"],
            "light_direction": None, "camera": p["camera"], "num_triangles": None,
        },
        "measure": {
            "scene": p["scene"], "techniques": ("hard",), "width": 4, "height": 3, "resolution": 8,
            "samples_per_axis": 1, "caster": None, "repeats": 1, "progress": None, "view": None,
        },
        "render": {
            "scene": p["scene"], "technique": "hard", "width": 4, "height": 3, "resolution": 8, "samples_per_axis": 1,
            "caster": None, "material": None, "progress": None,
        },
        "coverage_depth": {
            "mesh": p["mesh"], "edges": p["edges"], "grid": p["grid"], "caster": sj.BruteForceCaster(), "max_pairs": 64,
        },
        "coverage_planes": {
            "mesh": p["mesh"], "edges": p["edges"], "grid": p["grid"], "encode": lambda depth: depth[None],
            "caster": sj.BruteForceCaster(), "max_pairs": 64,
        },
        "intersect": {"mesh": p["mesh"], "rays": p["rays"], "face": jnp.zeros(2, jnp.int32)},
        "load": {"path": str(folder / "triangle.obj"), "dtype": jnp.float32},
        "make_partition": {"name": "z4", "warp": sj.UniformFit()},
        "make_scene": {"name": "cubes", "num_triangles": None, "dtype": jnp.float32},
        "make_technique": {"name": "hard", "resolution": 8, "caster": sj.BruteForceCaster()},
        "mesh_edges": {"mesh": p["mesh"], "weld": True},
        "plane_receiver": {
            "origin": x, "axis_u": x, "axis_v": y, "lower": jnp.zeros(2), "upper": jnp.ones(2), "shape": (3, 3),
        },
        "shade": {
            "surface": p["surface"], "lights": (p["light"],), "visibilities": (jnp.ones((3, 4)),),
            "material": sj.Material(), "samples_per_axis": 1,
        },
        "shadow_picture": {
            "mesh": p["mesh"], "edges": p["edges"], "light": p["light"], "view": p["grid"],
            "caster": sj.BruteForceCaster(),
            "receiver": None, "max_pairs": 64,
        },
        "trace_surface": {
            "mesh": p["mesh"], "camera": p["camera"], "width": 4, "height": 3, "caster": sj.BruteForceCaster(),
            "smooth_groups": None, "samples_per_axis": 1,
        },
        "use_all_cores": {"num_cores": len(jax.local_devices(backend="cpu"))},
        "visibility_on": {"surface": p["surface"], "shadows": p["shadows"]},
        "shadows.visibility": seen,
    }  # fmt: skip
    return {name: (_found(name, p), given) for name, given in made.items()}


def _found(name: str, shared: Mapping[str, Any]) -> Callable[..., Any]:
    """What a name of an example stands for."""
    head, _, tail = name.partition(".")
    if head == "shadows":
        return getattr(shared["shadows"], tail)
    owner = getattr(sj, head.removesuffix("()"))
    owner = sj.ShadowMapping(resolution=8) if head == "ShadowMapping()" else owner() if head.endswith("()") else owner
    return getattr(owner, tail) if tail else owner
